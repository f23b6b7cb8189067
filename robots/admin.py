"""Robots and floor plans in the administration."""

import datetime
import json
from typing import Any, ClassVar

from django.contrib import admin, messages
from django.db.models import Count, Field, Model, Q, QuerySet
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.urls import NoReverseMatch, URLPattern, path, reverse
from django.utils import timezone
from django.utils.html import format_html
from django.utils.safestring import SafeString
from django.utils.text import capfirst
from django.utils.timesince import timesince
from django.utils.translation import gettext, gettext_lazy as _, ngettext, pgettext
from django.views.decorators.cache import never_cache

from accounts import audit
from accounts.admin_filters import ShownFilters
from accounts.interventions import LIMITS_CHANGED
from robots.admin_pages.access import OwnersPermits, theirs_to_change
from robots.admin_pages.doors import DoorPage
from robots.admin_pages.finishing import FinishingPage
from robots.admin_pages.interventions import InterventionPage, role_of
from robots.admin_pages.keys import KeyPages
from robots.admin_pages.overview import status_of
from robots.admin_pages.robot_list import RobotList
from robots.forms import (
    TRANSLATED,
    FloorPlanForm,
    RobotElsewhereForm,
    RobotForm,
    adapter_select,
    offered,
    profile_select,
)
from robots.models import (
    FloorPlan,
    Robot,
    RobotCredentials,
    RobotElsewhere,
    RobotPermit,
    RobotPresence,
)
from robots.presence.report import has_problem, standstill_of, trouble_of
from robots.readiness_text import in_words

NOTHING = "–"
LIMITS = ("max_linear", "max_angular", "assist")  # fields that decide how a robot may move


def link_to(view: str, text: Any, *args: Any, query: str = "") -> str | SafeString:
    """Return a link to a named view, or the bare text when the site has no such view."""
    try:
        return format_html('<a href="{}{}">{}</a>', reverse(view, args=args), query, text)
    except NoReverseMatch:
        return str(text)


class NowFilter(admin.SimpleListFilter):
    """Robots that are online, in use, or have a problem now; the administration's first page links
    to these lists.
    """

    title = _("now")
    parameter_name = "now"

    def lookups(self, _request: HttpRequest, _model_admin: Any) -> list[tuple[str, Any]]:
        return [("online", _("online")), ("in_use", _("in use")), ("problem", _("with a problem"))]

    def queryset(self, _request: HttpRequest, queryset: Any) -> Any:
        now, chosen = timezone.now(), self.value()
        if chosen == "in_use":
            return queryset.filter(lease__session__isnull=False)
        if chosen == "online":
            return queryset.filter(Robot.online_at(now))
        if chosen != "problem":
            return queryset
        rows = queryset.select_related(None).select_related("presence")
        return queryset.filter(pk__in=[robot.pk for robot in rows if has_problem(robot, now)])


class PermitInline(admin.TabularInline):
    model = RobotPermit
    extra = 0
    autocomplete_fields = ("user",)
    readonly_fields = ("granted_at",)


# Rows of each robot that the administration does not list.
PARTS = (RobotPresence, RobotCredentials)


def _without(listed: list[Any], beginnings: tuple[str, ...]) -> list[Any]:
    """Return nested lists of texts without those that have one of these beginnings."""
    return [
        _without(one, beginnings) if isinstance(one, list) else one
        for one in listed
        if isinstance(one, list) or not one.startswith(beginnings)
    ]


@admin.register(Robot)
class RobotAdmin(DoorPage, InterventionPage, KeyPages):
    """Owners see their own robots, and may change all but owner and floor plan."""

    form = RobotForm
    list_display = ("title", "status", "driver", "battery", "seen_ago", "who", "drive")
    list_filter = (NowFilter, "enabled", "access", "presence__connection", "floor_plan", "owner")
    linked = ("floor_plan__id__exact",)
    list_per_page = 50
    search_fields = ("title", "name", "description", "owner__username")
    autocomplete_fields = ("owner",)
    actions = ("new_credentials", "rotate_credentials", "revoke_credentials")
    actions += ("free", "disable", "enable")
    save_on_top = True
    readonly_fields = ("adapter_here", "key", "screen", "between", "control", "driver", "seen")
    readonly_fields += ("sessions", "reported_factsheet", "reported_state")
    _access = ("access", "for_experienced", "observers_allowed", "turn_minutes")
    _limits = ("max_linear", "max_angular")
    _blank = _("Leave blank to use the robot's limits; cannot exceed them.")
    _kind = ("adapter", "adapter_here", "profile")
    _later: ClassVar = {"classes": ("collapse",)}
    # A new robot needs only the first part.
    add_fieldsets = (
        (
            None,
            {
                "fields": ("title", "name", "adapter", "profile"),
                "description": _(
                    "After you save, the robot's page shows the command that connects it. Visitors "
                    "don't see the robot until it has connected and you show it to them."
                ),
            },
        ),
        (_("Description and place"), {"fields": ("description", "owner", "floor_plan"), **_later}),
        (_("Other languages"), {"fields": TRANSLATED, **_later}),
        (_("Who may drive"), {"fields": _access, **_later}),
        (_("Driving"), {"fields": ("assist", *_limits), "description": _blank, **_later}),
        (_("Between visits"), {"fields": ("returns_home", "charge_limit"), **_later}),
        (_("Robot's screen"), {"fields": ("calls",), **_later}),
    )
    _site = ("shown_to_visitors", "title", "name", "description", "owner", "floor_plan", "enabled")
    fieldsets = (
        (None, {"fields": _site}),
        (_("Other languages"), {"fields": TRANSLATED, **_later}),
        (_("Who may drive"), {"fields": _access}),
        (_("Between visits"), {"fields": ("returns_home", "charge_limit", "between")}),
        (_("Driving"), {"fields": ("assist", *_limits), "description": _blank}),
        (_("Robot's screen"), {"fields": ("calls", "screen")}),
        (
            _("Connection"),
            {"fields": (*_kind, "key", "control", "seen", "driver", "sessions")},
        ),
        (
            _("Reported by the robot"),
            {"fields": ("reported_factsheet", "reported_state"), **_later},
        ),
    )

    def get_readonly_fields(
        self, request: HttpRequest, obj: Robot | None = None
    ) -> tuple[str, ...]:
        """A robot keeps its name, which is in topics, links and recordings. Only the site's staff
        set its owner and floor plan.
        """
        may_place = (
            self.sees_all(request) if obj is None else request.user.has_perm("robots.change_robot")
        )
        sites = () if may_place else ("owner", "floor_plan")
        return (*self.readonly_fields, *sites, *(("name",) if obj is not None else ()))

    def get_fieldsets(self, _request: HttpRequest, obj: Robot | None = None) -> Any:
        return self.add_fieldsets if obj is None else self.fieldsets

    def add_view(
        self, request: HttpRequest, form_url: str = "", extra_context: dict[str, Any] | None = None
    ) -> HttpResponse:
        """Offer *Save* alone, which leads to the command that connects the robot."""
        only = {"show_save_and_add_another": False, "show_save_and_continue": False}
        return super().add_view(request, form_url, only | (extra_context or {}))

    def get_prepopulated_fields(
        self, _request: HttpRequest, obj: Robot | None = None
    ) -> dict[str, tuple[str, ...]]:
        return {"name": ("title",)} if obj is None else {}

    def get_changeform_initial_data(self, request: HttpRequest) -> dict[str, Any]:
        stops = {"assist": Robot.DriveAssist.SLOW}
        return stops | super().get_changeform_initial_data(request)

    def save_model(self, request: HttpRequest, obj: Robot, form: Any, change: bool) -> None:
        """Hide a new robot from visitors until its owner shows it."""
        if not change:
            obj.shown_to_visitors = False
        super().save_model(request, obj, form, change)
        if change:
            self._note_limits(request, obj, form)

    @staticmethod
    def _note_limits(request: HttpRequest, robot: Robot, form: Any) -> None:
        """Note changed speed limits and assistance in the log of interventions."""
        changed = {
            name: [form.initial.get(name), form.cleaned_data[name]]
            for name in form.changed_data
            if name in LIMITS
        }
        if changed:
            role = role_of(request.user, robot)
            audit.note(LIMITS_CHANGED, actor=request.user, robot=robot, role=role, data=changed)

    def response_post_save_add(self, request: HttpRequest, obj: Robot) -> HttpResponse:
        """Go to the new robot's page, which says how to connect it."""
        if not self.has_view_permission(request, obj):
            return super().response_post_save_add(request, obj)
        return HttpResponseRedirect(reverse("admin:robots_robot_change", args=[obj.pk]))

    # --- permissions ------------------------------------------------------------------------------

    def has_change_permission(self, request: HttpRequest, obj: Robot | None = None) -> bool:
        return bool(super().has_change_permission(request, obj)) or self.is_of(request, obj)

    def get_deleted_objects(self, objs: Any, request: HttpRequest) -> Any:
        """Leave out the rows that are a part of each robot (PARTS)."""
        deleted, counts, missing, protected = super().get_deleted_objects(objs, request)
        for part in PARTS:
            counts.pop(part._meta.verbose_name_plural, None)
        names = tuple(f"{capfirst(str(part._meta.verbose_name))}: " for part in PARTS)
        return _without(deleted, names), counts, missing, protected

    def formfield_for_dbfield(
        self, db_field: "Field[Any, Any]", request: HttpRequest, **options: Any
    ) -> Any:
        if db_field.name == "adapter":
            options["widget"] = adapter_select()
        if db_field.name == "profile":
            options["widget"] = profile_select()
        return super().formfield_for_dbfield(db_field, request, **options)

    def save_formset(self, request: HttpRequest, form: Any, formset: Any, change: bool) -> None:
        super().save_formset(request, form, formset, change)
        changed = [permit for permit, _fields in formset.changed_objects]
        acts = [("permit_granted", permit) for permit in (*formset.new_objects, *changed)]
        acts += [("permit_taken", permit) for permit in formset.deleted_objects]
        for act, permit in acts:
            person, robot = permit.user_id, form.instance
            audit.note(act, actor=request.user, person=person, robot=robot, detail=permit.kind)

    def get_queryset(self, request: HttpRequest) -> "QuerySet[Robot]":
        """Leave out practice robots, which run_practice manages, and the images of maps."""
        rows: QuerySet[Robot] = super().get_queryset(request)
        related = rows.select_related("lease__session__visitor", "floor_plan", "owner")
        shown = related.filter(practice=False).defer("floor_plan__image")
        return shown.annotate(online=Robot.online_at(timezone.now()))

    def get_inlines(self, request: HttpRequest, obj: Robot | None = None) -> list[Any]:
        """Owners enter user names; only the site's staff can look people up."""
        if obj is None:
            return []
        return [PermitInline if self.sees_all(request) else OwnersPermits]

    def get_list_filter(self, request: HttpRequest) -> tuple[Any, ...]:
        return self.list_filter if self.sees_all(request) else self.list_filter[:4]

    def get_search_fields(self, request: HttpRequest) -> tuple[str, ...]:
        return self.search_fields if self.sees_all(request) else ("title", "name", "description")

    # --- list ---------------------------------------------------------------------------------

    def get_changelist(self, _request: HttpRequest, **_options: Any) -> type[RobotList]:
        return RobotList

    def changelist_view(
        self, request: HttpRequest, extra_context: dict[str, Any] | None = None
    ) -> HttpResponse:
        title = {"title": capfirst(gettext("robots"))}
        return super().changelist_view(request, title | (extra_context or {}))

    def get_actions(self, request: HttpRequest) -> dict[str, Any]:
        """Put the deletion at the end."""
        actions: dict[str, Any] = super().get_actions(request)
        return dict(sorted(actions.items(), key=lambda named: named[0] == "delete_selected"))

    # --- columns ----------------------------------------------------------------------------------

    @admin.display(description=_("status"), ordering="online")
    def status(self, robot: Robot) -> SafeString:
        """The label of the robot's page, and why a connected robot is not ready."""
        now = status_of(robot)
        pill = format_html('<span class="state" data-tone="{}">{}</span>', now.tone, now.label)
        why = self._why(robot)
        return format_html("{} {}", pill, in_words(why)) if why else pill

    @admin.display(description=_("control system"))
    def control(self, robot: Robot) -> str:
        if not robot.is_online(timezone.now()):
            return NOTHING
        return trouble_of(robot.presence.report) or gettext("responding")

    @admin.display(description=_("battery"))
    def battery(self, robot: Robot) -> str:
        battery = (robot.presence.report or {}).get("battery")
        if battery is None:
            return NOTHING
        charge = gettext("unknown") if battery.get("charge") is None else f"{battery['charge']:.0%}"
        if battery.get("charging"):
            return gettext("%(charge)s, charging") % {"charge": charge}
        return charge

    @admin.display(description=_("access"), ordering="access")
    def who(self, robot: Robot) -> str:
        if not robot.enabled:
            return gettext("disabled")
        if not robot.shown_to_visitors:
            return pgettext("a robot", "hidden")
        return {
            Robot.Access.OPEN: pgettext("a robot", "open"),
            Robot.Access.INVITATION: gettext("invited"),
            Robot.Access.TRAINED: gettext("trained"),
        }[robot.access]

    @admin.display(description=_("last seen"), ordering="presence__last_seen_at")
    def seen(self, robot: Robot) -> str:
        seen_at = robot.presence.last_seen_at
        return NOTHING if seen_at is None else _moment(seen_at)

    @admin.display(description=_("last seen"), ordering="presence__last_seen_at")
    def seen_ago(self, robot: Robot) -> str | SafeString:
        seen_at, now = robot.presence.last_seen_at, timezone.now()
        if seen_at is None:
            return NOTHING
        if robot.is_online(now):
            return gettext("now")
        ago = gettext("%(time)s ago") % {"time": timesince(seen_at, now, depth=1)}
        exact = timezone.localtime(seen_at).isoformat(timespec="seconds")
        return format_html('<time datetime="{}" title="{}">{}</time>', exact, _moment(seen_at), ago)

    @admin.display(description=_("current status"))
    def between(self, robot: Robot) -> str:
        """The status at the top of the page, and why and since when it is not ready for a visit."""
        label, why, since = status_of(robot).label, self._why(robot), None
        if robot.is_online(timezone.now()):
            waits = robot.presence.turnaround != Robot.Turnaround.READY
            since = robot.presence.turnaround_at if waits else None
        shown = f"{label}: {in_words(why)}" if why else label
        if since is None:
            return shown
        return gettext("%(state)s (since %(when)s)") % {"state": shown, "when": _moment(since)}

    @staticmethod
    def _why(robot: Robot) -> str:
        """Return the code of why a connected robot is not ready, or an empty text."""
        if not robot.is_online(timezone.now()):
            return ""
        return standstill_of(robot.presence.report) or robot.presence.turnaround_reason

    @admin.display(description=_("driver"))
    def driver(self, robot: Robot) -> str | SafeString:
        lease = getattr(robot, "lease", None)
        if lease is None or lease.session is None:
            return NOTHING
        page, name = (
            "admin:telepresence_sessions_session_change",
            self.driver_of(robot, lease.session),
        )
        return link_to(page, name, lease.session.pk)

    @admin.display(description="")
    def drive(self, robot: Robot) -> str | SafeString:
        return link_to("drive", gettext("Drive"), robot.name)

    @admin.display(description=_("on this server"))
    def adapter_here(self, robot: Robot) -> str:
        """Whether the adapter is installed on the server, where it is not needed."""
        if not robot.adapter or robot.adapter.endswith(".py"):
            return NOTHING
        if robot.adapter in offered():
            return gettext("installed")
        return gettext(
            "Not installed on this server, which is fine: it must be installed "
            "on the robot's computer, where the agent runs."
        )

    @admin.display(description=_("credentials"))
    def key(self, robot: Robot) -> str | SafeString:
        if robot._state.adding:
            return gettext("Save the robot first.")
        ways = (
            link_to("admin:robots_robot_enrol", gettext("Enrol the robot's computer"), robot.pk),
            link_to("admin:robots_robot_credentials", gettext("Create new credentials"), robot.pk),
        )
        return format_html("<span data-state>{}</span> · {} · {}", self._credentials(robot), *ways)

    @staticmethod
    def _credentials(robot: Robot) -> str:
        if not robot.credentials.credential_hash or robot.credentials.credential_made_at is None:
            return gettext("none: the robot can't connect")
        made = gettext("created %(when)s") % {"when": _moment(robot.credentials.credential_made_at)}
        if robot.credentials.renewal_asked_at is None:
            return made
        return gettext("%(made)s; new ones requested, not fetched yet") % {"made": made}

    def live_fields(self, robot: Robot) -> dict[str, str]:
        return {
            "between": self.between(robot),
            "control": self.control(robot),
            "seen": self.seen(robot),
            "key": self._credentials(robot),
        }

    @admin.display(description=_("screen"))
    def screen(self, robot: Robot) -> str | SafeString:
        if robot._state.adding:
            return gettext("Save the robot first.")
        made = robot.credentials.screen_made_at
        state = pgettext("an address", "none")
        if made is not None:
            state = gettext("created %(when)s") % {"when": _moment(made)}
        text = gettext("Create an address for the robot's display")
        return format_html("{} · {}", state, link_to("admin:robots_robot_screen", text, robot.pk))

    @admin.display(description=_("sessions"))
    def sessions(self, robot: Robot) -> str | SafeString:
        page, query = "telepresence_sessions_session_changelist", f"?robot__id__exact={robot.pk}"
        return link_to(f"admin:{page}", gettext("Show its sessions"), query=query)

    @admin.display(description=_("factsheet"))
    def reported_factsheet(self, robot: Robot) -> str | SafeString:
        return _shown(robot.presence.factsheet)

    @admin.display(description=_("last state"))
    def reported_state(self, robot: Robot) -> str | SafeString:
        return _shown(robot.presence.report)

    # --- pages and actions ------------------------------------------------------------------------

    def get_urls(self) -> list[URLPattern]:
        pages = {
            "status.json": self.status_view,
            "credentials/": self.credentials_view,
            "doors/": self.doors_view,
            "enrol/": self.enrol_view,
            "interventions/": self.interventions_view,
            "interventions.csv": self.interventions_csv,
            "screen/": self.screen_view,
        }
        return [
            path(
                f"<uuid:pk>/{address}",
                self.admin_site.admin_view(never_cache(view)),
                name=f"robots_robot_{address.removesuffix('.json').rstrip('/').replace('.', '_')}",
            )
            for address, view in pages.items()
        ] + super().get_urls()

    @admin.action(
        description=_("Open to visitors now (even if not docked)"), permissions=["change"]
    )
    def free(self, request: HttpRequest, robots: "QuerySet[Robot]") -> None:
        away = RobotPresence.objects.exclude(turnaround=Robot.Turnaround.READY)
        changed = list(theirs_to_change(request, robots).filter(presence__in=away))

        def set_ready(robot: Robot) -> None:
            RobotPresence.objects.filter(robot=robot).update(
                turnaround=Robot.Turnaround.READY, turnaround_reason=""
            )

        text = ngettext(
            "%(n)d robot is open to visitors.", "%(n)d robots are open to visitors.", len(changed)
        )
        self.change_each(
            request, changed, set_ready, gettext("Robot opened to visitors."), "robot_freed", text
        )

    @admin.action(description=_("Disable"), permissions=["change"])
    def disable(self, request: HttpRequest, robots: "QuerySet[Robot]") -> None:
        """Disabled robots can neither connect nor be driven; their credentials stay."""
        done = gettext("Robot disabled.")
        self._set_enabled(request, robots, done, "robot_disabled", enabled=False)

    @admin.action(description=_("Enable"), permissions=["change"])
    def enable(self, request: HttpRequest, robots: "QuerySet[Robot]") -> None:
        self._set_enabled(request, robots, gettext("Robot enabled."), "robot_enabled", enabled=True)

    def _set_enabled(
        self, request: HttpRequest, robots: "QuerySet[Robot]", done: str, act: str, *, enabled: bool
    ) -> None:
        changed = list(theirs_to_change(request, robots).exclude(enabled=enabled))

        def change(robot: Robot) -> None:
            robot.enabled = enabled
            robot.save(update_fields=["enabled"])

        text = ngettext("%(n)d robot was changed.", "%(n)d robots were changed.", len(changed))
        self.change_each(request, changed, change, done, act, text)


@admin.register(FloorPlan)
class FloorPlanAdmin(FinishingPage):
    """Floor plans belong to the site; owners can view those of their robots."""

    form = FloorPlanForm
    list_display = ("title", "name", "size", "robot_count")
    search_fields = ("title", "name")
    geometry = ("resolution", "origin_x", "origin_y", "origin_theta", "sha256")
    readonly_fields = ("preview", "finishing", "size", "places", *geometry)

    def is_of(self, request: HttpRequest, row: Model | None) -> bool:
        """A floor plan belongs to all owners of robots there."""
        if row is None:
            return super().is_of(request, None)
        return Robot.objects.filter(floor_plan=row.pk, owner=request.user.pk).exists()

    def get_queryset(self, request: HttpRequest) -> "QuerySet[FloorPlan]":
        """Count the robots in the same query."""
        rows: QuerySet[FloorPlan] = admin.ModelAdmin.get_queryset(self, request)
        if not self.sees_all(request):
            own = Robot.objects.filter(owner=request.user.pk, floor_plan__isnull=False)
            rows = rows.filter(pk__in=own.values("floor_plan"))
        return rows.annotate(robots_there=Count("robots", filter=Q(robots__practice=False)))

    def get_fieldsets(
        self, request: HttpRequest, obj: FloorPlan | None = None
    ) -> list[tuple[Any, dict[str, Any]]]:
        files = ("map_file", "image_file", "plan_file")
        if obj is None:
            hint = _("If you add a plan.json, the map id and title are taken from it.")
            return [(None, {"fields": (*files, "name", "title"), "description": hint})]
        finishing = ("finishing",) if self.has_change_permission(request, obj) else ()
        details = {"fields": self.geometry, "classes": ("collapse",)}
        technical = [(_("Technical details"), details)] if self.sees_all(request) else []
        return [
            (None, {"fields": ("title", "name", "preview", *finishing)}),
            (_("Map"), {"fields": ("size", "places")}),
            (_("Replace the files"), {"fields": files, "classes": ("collapse",)}),
            *technical,
        ]

    def get_readonly_fields(
        self, _request: HttpRequest, obj: FloorPlan | None = None
    ) -> tuple[str, ...]:
        """A floor plan keeps its map id, which robots know."""
        return (*self.readonly_fields, *(("name",) if obj is not None else ()))

    def save_model(self, request: HttpRequest, obj: FloorPlan, form: Any, change: bool) -> None:
        """Save the whole row if it was read from files."""
        super().save_model(request, obj, form, change and not form.values)

    def get_urls(self) -> list[URLPattern]:
        page = self.admin_site.admin_view(never_cache(self.finish_view))
        return [
            path("<uuid:pk>/finish/", page, name="robots_floorplan_finish"),
            *super().get_urls(),
        ]

    @admin.display(description=_("plan"))
    def finishing(self, plan: FloorPlan) -> str | SafeString:
        words = gettext("Edit the plan on the map") if plan.plan else gettext("Draw a plan")
        return link_to("admin:robots_floorplan_finish", words, plan.pk)

    @admin.display(description=_("preview"))
    def preview(self, plan: FloorPlan) -> str | SafeString:
        address = f"{reverse('floor_plan_image', args=[plan.name])}?v={plan.sha256[:16]}"
        image = '<img src="{}" alt="{}" width="{}">'
        return format_html(image, address, plan.title, min(plan.width, 480))

    @admin.display(description=_("size"))
    def size(self, plan: FloorPlan) -> str:
        wide, high = plan.width * plan.resolution, plan.height * plan.resolution
        return f"{wide:.1f} × {high:.1f} m ({plan.width} × {plan.height})"

    @admin.display(description=_("robots"), ordering="robots_there")
    def robot_count(self, plan: FloorPlan) -> str | SafeString:
        count, query = getattr(plan, "robots_there", 0), f"?floor_plan__id__exact={plan.pk}"
        return link_to("admin:robots_robot_changelist", count, query=query)

    @admin.display(description=_("in the plan"))
    def places(self, plan: FloorPlan) -> str:
        kinds = {
            "rooms": gettext("rooms"),
            "doors": gettext("doors"),
            "docks": gettext("charging stations"),
            "places": gettext("places"),
            "routes": gettext("routes"),
        }
        parts = [(len(plan.plan.get(kind) or ()), word) for kind, word in kinds.items()]
        return ", ".join(f"{count} {word}" for count, word in parts if count) or NOTHING


@admin.register(RobotElsewhere)
class RobotElsewhereAdmin(ShownFilters):
    form = RobotElsewhereForm
    list_display = ("name", "site")
    list_filter = ("site",)
    search_fields = ("name", "site")

    def save_model(
        self, request: HttpRequest, obj: RobotElsewhere, form: Any, change: bool
    ) -> None:
        """Save it, and warn if it has no effect yet."""
        super().save_model(request, obj, form, change)
        robot = Robot.objects.filter(name=obj.name, enabled=True).first()
        if robot is not None:
            text = gettext(
                "{robot} is enabled here, so this entry has no effect until you disable it."
            )
            link = link_to("admin:robots_robot_change", robot.name, robot.pk)
            self.message_user(request, format_html(text, robot=link), messages.WARNING)


def _moment(moment: datetime.datetime) -> str:
    return timezone.localtime(moment).strftime("%Y-%m-%d %H:%M")


def _shown(content: Any) -> str | SafeString:
    if not content:
        return NOTHING
    return format_html("<pre>{}</pre>", json.dumps(content, indent=2, ensure_ascii=False))
