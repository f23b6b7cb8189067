"""Sessions, leases, the system log and the session manager in the administration: to view, stop and
download.

Nothing here can be edited: only sessions/leases/ changes who drives, and records are final. No list
reads states: it shows Session.summary.
"""

import datetime
import uuid
from collections.abc import Callable
from typing import Any

from django.contrib import admin, messages
from django.contrib.auth.decorators import permission_required
from django.core.exceptions import PermissionDenied
from django.db.models import Model, QuerySet
from django.http import HttpRequest, HttpResponse, StreamingHttpResponse
from django.shortcuts import get_object_or_404
from django.template.loader import render_to_string
from django.urls import URLPattern, path
from django.utils import timezone
from django.utils.safestring import SafeString
from django.utils.translation import gettext, gettext_lazy as _, ngettext
from django.views.decorators.cache import never_cache

from accounts import audit
from accounts.admin_filters import ReadOnlyAdmin
from robots.admin import NOTHING, link_to
from robots.admin_pages.access import OfRobots, WithDriver
from robots.admin_pages.overview import register_section
from robots.models import Robot
from sessions import system_log
from sessions.api import admin as api_key_admin
from sessions.downloads import as_csv, as_json
from sessions.leases import store
from sessions.models import (
    STALE_SECONDS,
    Lease,
    ManagerBeat,
    NetworkSample,
    Session,
    SessionEvent,
    Snapshot,
    StateChunk,
    SystemLog,
)
from sessions.page_channel import check_pages, robot_group
from sessions.recording.network_summary import summarise_network
from sessions.safety_test.page import safety_test_page

EVENTS_SHOWN = 500
SNAPSHOTS_SHOWN = 60
SESSIONS_SHOWN = 10
VIEW = "telepresence_sessions.view_session"
TIMES = (
    *("queued_at", "offered_at", "granted_at", "driving_at"),
    *("first_motion_at", "lost_at", "turn_ends_at", "ended_at"),
)
RECORDED = ("minutes", "distance", "states", "missing")
PAGES = (api_key_admin.ApiKeyAdmin,)  # of modules of their own; Django looks for pages in this one


def _summary_column(name: str, title: Any, shown: Callable[[Any], str] = str) -> Any:
    """Return a column with one value of `Session.summary`."""

    @admin.display(description=title)
    def column(_page: admin.ModelAdmin, session: Session) -> str:
        value = session.summary.get(name)
        return NOTHING if value is None else shown(value)

    return column


def _shares(counts: dict[str, int]) -> str:
    total = sum(counts.values())
    ordered = sorted(counts.items(), key=lambda pair: -pair[1])
    return ", ".join(f"{name} {count / total:.0%}" for name, count in ordered) or NOTHING


class OwnersRows(OfRobots, ReadOnlyAdmin):
    """Rows that belong to a robot, for users who may see all, and for the robot's owner."""

    robot = "robot"


@admin.register(Session)
class SessionAdmin(OwnersRows):
    """Sessions: who drove which robot when, how it ended, and the record.

    A robot's owner sees its sessions without visitor and record, and may stop them. Visitors and
    records are for users with the right to see sessions, and for the study's researchers.
    """

    list_display = (
        "begun",
        "visitor_link",
        "robot_link",
        "state",
        "outcome",
        "minutes",
        "distance",
        "states",
        "methods",
        "device_name",
    )
    list_display_links = ("begun",)
    list_filter = ("state", "outcome", "robot", "queued_at")
    linked = ("robot__id__exact",)
    list_select_related = ("visitor", "robot")
    list_per_page = 50
    search_fields = (
        "visitor__username",
        "visitor__display_name",
        "visitor__email",
        "robot__name",
        "robot__title",
        "outcome_reason",
    )
    search_help_text = _("Search by visitor, robot, reason or session ID.")
    date_hierarchy = "queued_at"
    actions = ("stop_sessions", "download_csv", "download_json")
    readonly_fields = (
        "visitor_link",
        "robot_link",
        *RECORDED,
        "methods",
        "ways",
        "device_details",
        "network",
        "snapshots",
        "events",
    )
    fieldsets = (
        (None, {"fields": ("visitor_link", "robot_link", "state", "outcome", "outcome_reason")}),
        (_("Times"), {"fields": TIMES}),
        (_("Record"), {"fields": (*RECORDED, "methods", "ways", "closed_at")}),
        (_("Device and network"), {"fields": ("device_details", "network")}),
        (_("Photos"), {"fields": ("snapshots",)}),
        (_("Events"), {"fields": ("events",)}),
    )

    # --- who may ----------------------------------------------------------------------------------

    def has_stop_permission(self, request: HttpRequest) -> bool:
        """Allow it to users who may change sessions, and to owners, who only see their robots'."""
        return bool(request.user.has_perm("telepresence_sessions.change_session")) or (
            not self.sees_all(request) and self.is_of(request, None)
        )

    def has_record_permission(self, request: HttpRequest) -> bool:
        return self.sees_all(request)

    def get_list_display(self, request: HttpRequest) -> tuple[str, ...]:
        personal = () if self.sees_all(request) else ("visitor_link", "device_name")
        return tuple(name for name in self.list_display if name not in personal)

    def get_list_filter(self, request: HttpRequest) -> tuple[str, ...]:
        return self.list_filter if self.sees_all(request) else ("state", "outcome", "queued_at")

    def get_search_fields(self, request: HttpRequest) -> tuple[str, ...]:
        """Keep owners from finding sessions by a visitor's address."""
        return self.search_fields if self.sees_all(request) else ("robot__name", "robot__title")

    def get_fieldsets(self, request: HttpRequest, _obj: Session | None = None) -> Any:
        if self.sees_all(request):
            return self.fieldsets
        return [
            (None, {"fields": ("robot_link", "state", "outcome", "outcome_reason")}),
            (_("Times"), {"fields": TIMES}),
            (_("Record"), {"fields": (*RECORDED, "closed_at")}),
        ]

    def has_delete_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Allow it for ended sessions, one by one: visitors have a right to it."""
        ended = isinstance(obj, Session) and obj.state == Session.State.ENDED
        return ended and bool(request.user.has_perm("telepresence_sessions.delete_session"))

    def get_deleted_objects(
        self, objs: Any, _request: HttpRequest
    ) -> tuple[list[str], dict[str, int], set[str], list[str]]:
        """Return how many rows are deleted with a session, without listing thousands of them."""
        keys = [obj.pk for obj in objs]
        counts = {str(Session._meta.verbose_name_plural): len(keys)}
        for model in (StateChunk, SessionEvent, NetworkSample, Snapshot):
            name = str(model._meta.verbose_name_plural)
            counts[name] = model.objects.filter(session__in=keys).count()
        return [str(obj) for obj in objs], counts, set(), []

    def get_search_results(
        self, request: HttpRequest, queryset: QuerySet[Session], search_term: str
    ) -> tuple[QuerySet[Session], bool]:
        try:
            return queryset.filter(pk=uuid.UUID(search_term.strip())), False
        except ValueError:
            return super().get_search_results(request, queryset, search_term)

    # --- columns ----------------------------------------------------------------------------------

    @admin.display(description=_("started"), ordering="queued_at")
    def begun(self, session: Session) -> str:
        return f"{timezone.localtime(session.queued_at):%Y-%m-%d %H:%M}"

    @admin.display(description=_("visitor"), ordering="visitor__username")
    def visitor_link(self, session: Session) -> str | SafeString:
        return link_to("admin:accounts_user_change", session.visitor.shown_name, session.visitor_id)

    @admin.display(description=_("robot"), ordering="robot__title")
    def robot_link(self, session: Session) -> str | SafeString:
        if session.robot.practice:
            return str(session.robot)
        return link_to("admin:robots_robot_change", session.robot, session.robot_id)

    @admin.display(description=_("minutes driven"))
    def minutes(self, session: Session) -> str:
        return _minutes_of(session)

    distance = _summary_column("distance", _("distance (m)"), "{:.1f}".format)
    states = _summary_column("states", _("states"))
    missing = _summary_column("missing", _("missing states"))
    methods = _summary_column("methods", _("input"), _shares)
    ways = _summary_column("ways", _("control channels"), _shares)

    @admin.display(description=_("device"))
    def device_name(self, session: Session) -> str:
        names = (session.device.get(name) for name in ("os", "browser"))
        return " · ".join(filter(None, names)) or NOTHING

    # --- the page of one session ------------------------------------------------------------------

    @admin.display(description=_("device"))
    def device_details(self, session: Session) -> SafeString:
        return _fragment("device", device=session.device)

    @admin.display(description=_("network"))
    def network(self, session: Session) -> SafeString:
        samples = NetworkSample.objects.filter(session=session).values_list("data", flat=True)
        return _fragment("network", network=summarise_network(samples.iterator(chunk_size=500)))

    @admin.display(description=_("photos"))
    def snapshots(self, session: Session) -> SafeString:
        rows = Snapshot.objects.filter(session=session).order_by("stamp").defer("jpeg")
        return _fragment(
            "snapshots", snapshots=[(row, _moment(row.stamp)) for row in rows[:SNAPSHOTS_SHOWN]]
        )

    @admin.display(description=_("events"))
    def events(self, session: Session) -> SafeString:
        rows = list(
            SessionEvent.objects.filter(session=session).order_by("received_at")[: EVENTS_SHOWN + 1]
        )
        return _fragment(
            "events",
            events=[(row, _moment(row.received_at)) for row in rows[:EVENTS_SHOWN]],
            more=len(rows) > EVENTS_SHOWN,
        )

    # --- actions ----------------------------------------------------------------------------------

    @admin.action(description=_("Stop these sessions now"), permissions=["stop"])
    def stop_sessions(self, request: HttpRequest, queryset: QuerySet[Session]) -> None:
        """End sessions; the session manager withdraws their leases within half a second."""
        now, stopped = timezone.now(), 0
        for session in queryset.exclude(state=Session.State.ENDED):
            if store.end(
                str(session.pk), Session.Outcome.STOPPED_BY_OPERATOR, "by an operator", now
            ):
                stopped += 1
                check_pages(robot_group(session.robot.name), session=str(session.pk))
                system_log.log(
                    "session_stopped",
                    "warning",
                    robot=session.robot_id,
                    session=session,
                    at=now,
                    user=str(request.user.pk),
                )
                audit.note(
                    "session_stopped",
                    actor=request.user,
                    person=session.visitor_id,
                    robot=session.robot,
                    thing=session,
                )
        if stopped:
            self.message_user(
                request,
                ngettext("One session was stopped.", "%(count)d sessions were stopped.", stopped)
                % {"count": stopped},
            )
        else:
            self.message_user(request, _("None of these sessions was running."), messages.WARNING)

    @admin.action(description=_("Download states (CSV)"), permissions=["record"])
    def download_csv(
        self, request: HttpRequest, queryset: QuerySet[Session]
    ) -> StreamingHttpResponse:
        return self._download(request, queryset, "csv")

    @admin.action(description=_("Download states (JSON)"), permissions=["record"])
    def download_json(
        self, request: HttpRequest, queryset: QuerySet[Session]
    ) -> StreamingHttpResponse:
        return self._download(request, queryset, "json")

    def _download(
        self, request: HttpRequest, queryset: QuerySet[Session], kind: str
    ) -> StreamingHttpResponse:
        audit.note("sessions_exported", actor=request.user, detail=f"{kind} of {queryset.count()}")
        return as_json(queryset, "states") if kind == "json" else as_csv(queryset, "states")

    def get_urls(self) -> list[URLPattern]:
        guard = self.admin_site.admin_view
        own = [
            path(
                "<uuid:session>/stop/",
                guard(self.stop_view),
                name="telepresence_sessions_session_stop",
            ),
            path(
                "<uuid:session>/states.<str:kind>",
                guard(self.states_view),
                name="telepresence_sessions_session_states",
            ),
            path(
                "safety-test/<uuid:robot>/",
                guard(never_cache(self.safety_test_view)),
                name="telepresence_sessions_safety_test",
            ),
            path(
                "snapshots/<uuid:snapshot>.jpg",
                guard(snapshot_view),
                name="telepresence_sessions_snapshot",
            ),
        ]
        return [*own, *super().get_urls()]

    def states_view(
        self, request: HttpRequest, session: uuid.UUID, kind: str
    ) -> StreamingHttpResponse:
        if not self.has_record_permission(request):
            raise PermissionDenied
        found = get_object_or_404(Session, pk=session)
        audit.note(
            "session_exported",
            actor=request.user,
            person=found.visitor_id,
            robot=found.robot,
            thing=found,
            detail=kind[:10],
        )
        rows, name = Session.objects.filter(pk=found.pk), f"session-{session}"
        return as_json(rows, name) if kind == "json" else as_csv(rows, name)

    def stop_view(self, request: HttpRequest, session: uuid.UUID) -> HttpResponse:
        if request.method != "POST" or not self.has_stop_permission(request):
            raise PermissionDenied
        found = get_object_or_404(self.get_queryset(request), pk=session)
        self.stop_sessions(request, Session.objects.filter(pk=found.pk))
        return self.response_post_save_change(request, found)

    def safety_test_view(self, request: HttpRequest, robot: uuid.UUID) -> HttpResponse:
        """Show the page of a robot's safety test to users who may change the robot."""
        page: Any = self.admin_site.get_model_admin(Robot)
        return safety_test_page(page, request, page.managed(request, robot))

    def change_view(
        self,
        request: HttpRequest,
        object_id: str,
        form_url: str = "",
        extra_context: dict[str, Any] | None = None,
    ) -> HttpResponse:
        row = self.get_object(request, object_id) if self.sees_all(request) else None
        if row is not None:
            audit.note("session_opened", actor=request.user, person=row.visitor_id, thing=row)
        return super().change_view(
            request,
            object_id,
            form_url,
            {**(extra_context or {}), "may_stop": self.has_stop_permission(request)},
        )


@permission_required(VIEW, raise_exception=True)
def snapshot_view(request: HttpRequest, snapshot: uuid.UUID) -> HttpResponse:
    """Return the picture itself; only for users who may see sessions."""
    row = get_object_or_404(Snapshot, pk=snapshot)
    audit.note("photo_opened", actor=request.user, thing=row)
    headers = {"Cache-Control": "private, max-age=3600", "X-Content-Type-Options": "nosniff"}
    return HttpResponse(bytes(row.jpeg), content_type="image/jpeg", headers=headers)


@admin.register(Lease)
class LeaseAdmin(WithDriver, OwnersRows):
    """Who drives now, for owners without the name. The page's secret id is not shown."""

    list_display = ("robot", "driver", "epoch", "renewal", "changed_at")
    list_select_related = ("robot", "session__visitor")
    search_fields = ("robot__name", "robot__title")
    fields = ("robot", "driver", "epoch", "renewal", "changed_at")
    readonly_fields = ("driver",)

    @admin.display(description=_("session"))
    def driver(self, lease: Lease) -> str | SafeString:
        if lease.session is None:
            return gettext("nobody")
        return link_to(
            "admin:telepresence_sessions_session_change",
            self.driver_of(lease, lease.session),
            lease.session.pk,
        )


@admin.register(SystemLog)
class SystemLogAdmin(OwnersRows):
    """The system log; for owners, that of their robots."""

    list_display = ("at", "level", "event", "robot", "session_link", "values")
    list_filter = ("level", "robot", "at")
    list_select_related = ("robot", "session__visitor")
    list_per_page = 100
    search_fields = ("event", "robot__name")
    date_hierarchy = "at"
    fields = ("at", "level", "event", "robot", "session_link", "fields")
    readonly_fields = ("session_link",)

    def get_list_filter(self, request: HttpRequest) -> tuple[str, ...]:
        return self.list_filter if self.sees_all(request) else ("level", "at")

    @admin.display(description=_("session"))
    def session_link(self, entry: SystemLog) -> str | SafeString:
        if entry.session is None:
            return NOTHING
        return link_to(
            "admin:telepresence_sessions_session_change",
            str(entry.session.pk)[:8],
            entry.session.pk,
        )

    @admin.display(description=_("fields"))
    def values(self, entry: SystemLog) -> str:
        return " ".join(f"{name}={value}" for name, value in entry.fields.items())[:200] or NOTHING


@admin.register(ManagerBeat)
class ManagerBeatAdmin(ReadOnlyAdmin):
    """Whether a session manager runs, and where."""

    list_display = fields = readonly_fields = ("slot", "running", "at", "last_beat")

    @admin.display(description=_("name"), ordering="name")
    def slot(self, beat: ManagerBeat) -> str:
        return beat.name

    @admin.display(description=_("computer and process"), ordering="holder")
    def at(self, beat: ManagerBeat) -> str:
        return beat.holder or NOTHING

    @admin.display(description=_("last sign of life"), ordering="beat_at")
    def last_beat(self, beat: ManagerBeat) -> datetime.datetime:
        return beat.beat_at

    @admin.display(description=_("running"), boolean=True)
    def running(self, beat: ManagerBeat) -> bool:
        return bool(beat.holder) and (timezone.now() - beat.beat_at).total_seconds() < STALE_SECONDS


def last_sessions(request: HttpRequest, robot: Robot) -> SafeString:
    """Return a table of a robot's newest sessions; for owners without names and replays."""
    sees_all = request.user.has_perm(VIEW)
    rows = (
        Session.objects.filter(robot=robot, granted_at__isnull=False)
        .select_related("visitor")
        .order_by("-granted_at")[:SESSIONS_SHOWN]
    )
    visits = [
        {
            "session": row,
            "who": row.visitor.shown_name if sees_all else gettext("someone"),
            "minutes": _minutes_of(row),
            "ended": row.get_outcome_display() or row.get_state_display(),
        }
        for row in rows
    ]
    return _fragment("visits", visits=visits, sees_all=sees_all, robot=robot)


register_section("visits", last_sessions)


def _minutes_of(session: Session) -> str:
    minutes = session.minutes
    return NOTHING if minutes is None else f"{minutes:.1f}"


def _moment(stamp: float) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(stamp, datetime.UTC)


def _fragment(name: str, **context: Any) -> SafeString:
    return render_to_string(f"admin/telepresence_sessions/session/_{name}.html", context)
