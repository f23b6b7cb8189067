"""Participants and drives in the administration: to look at, to exclude drives with a reason, and
to withdraw participants on their request. Nothing is edited.
"""

import uuid
from typing import Any

from django.contrib import admin, messages
from django.db.models import Case, Exists, F, OuterRef, QuerySet, Value, When
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import render
from django.urls import URLPattern, path, reverse
from django.utils import timezone
from django.utils.html import format_html, format_html_join
from django.utils.safestring import SafeString
from django.utils.translation import gettext
from django.utils.translation import gettext_lazy as _
from django.views.decorators.cache import never_cache

from accounts import audit
from experiments import publishing
from experiments.access import may
from experiments.builder.labels import ENDING_NAMES, GUIDE
from experiments.definition.recruitment.quality_flags import Grade, QualityFlag
from experiments.models import Drive, Participant, Study, StudyMember
from experiments.research.study_access import OfStudies
from experiments.study_admin.document_text import assigned_in_words, recorded_in_words, time_text
from experiments.study_admin.filters import (
    CompletionFilter,
    ExcludedFilter,
    LanguageFilter,
    MismatchFilter,
    StudyFilter,
    StudyOfDriveFilter,
)
from experiments.study_admin.withdrawal import may_withdraw, withdraw_page
from robots.admin import NOTHING, link_to
from surveys.document_forms.fields import language_name

LEAST_REASON, MOST_REASON = 3, 300
WHICH = ("code", "study_name", "session_link", "replay")  # of a drive, with links
RECORDED = ("result_told", "ends_told")
GRADE_NAMES = {
    Grade.NOTE: _("note"),
    Grade.DOUBTFUL: _("doubtful"),
    Grade.SERIOUS: _("serious"),
}
FLAG_NAMES: dict[QualityFlag, Any] = {
    "attention_check": _("failed an attention check"),
    "speeding": _("answered too fast"),
    "straight_lining": _("gave the same answer throughout"),
    "never_moved": _("never moved the robot"),
    "regular_input": _("drove like a program"),
    "frozen_video": _("saw frozen video"),
    "same_network": _("shares a network with others"),
    "same_id": _("shares a recruitment id with others"),
}


def section(title: Any, *fields: str) -> tuple[Any, dict[str, Any]]:
    """Return a fieldset of the administration."""
    return title, {"fields": fields}


class StudyRows(OfStudies):
    """Rows of a study, with its tabs above them: above a list as soon as a study is chosen."""

    study_tab = ""

    def changelist_view(self, request: HttpRequest, extra_context: Any = None) -> HttpResponse:
        chosen = request.GET.get(StudyFilter.parameter_name, "")
        study = Study.objects.filter(pk=chosen).first() if is_uuid(chosen) else None
        return super().changelist_view(request, {**(extra_context or {}), **self._tabs_of(study)})

    def render_change_form(
        self, request: HttpRequest, context: dict[str, Any], *args: Any, **options: Any
    ) -> Any:
        context |= self._tabs_of(self.study_of(context["original"]))
        return super().render_change_form(request, context, *args, **options)

    def _tabs_of(self, study: Study | None) -> dict[str, Any]:
        return {} if study is None else {"study": study, "study_tab": self.study_tab}


@admin.register(Participant)
class ParticipantAdmin(StudyRows):
    """Who takes part. Viewers see codes, not people."""

    study = "study"
    study_tab = "participants"
    show_full_result_count = False
    list_display = (
        "code",
        "study",
        "kind",
        "status",
        "where",
        "condition",
        "drive_count",
        "ending",
        "known_id",
        "created_at",
        "seen_at",
    )
    list_filter = (
        StudyFilter,
        "kind",
        "status",
        "stage",
        ("completion", CompletionFilter),
        "access",
        ("language", LanguageFilter),
    )
    list_select_related = ("study", "user")
    list_per_page = 50
    search_fields = ("code", "visible_id")
    search_help_text = _("Search by participant code or by the id of a recruitment site.")
    date_hierarchy = "created_at"
    readonly_fields = (
        "person",
        "quality",
        "drives_told",
        "language_name",
        "came_with",
        "condition",
        "draws_told",
        "ending",
    )
    change_form_template = "admin/experiments/participant/change_form.html"

    def get_fieldsets(
        self, request: HttpRequest, obj: Participant | None = None
    ) -> list[tuple[Any, dict[str, Any]]]:
        is_known = obj is not None and may(request.user, obj.study.slug, "researcher")
        who = ("person", "recruitment_id", "came_with", "age") if is_known else ()
        return [
            section(None, "code", "study", "kind", "access", "language_name", *who),
            section(
                _("Assignment"),
                *("cell", "condition", "draws_told", "stage"),
            ),
            section(
                _("Progress"),
                *("status", "visit", "step", "round"),
                *("created_at", "seen_at", "finished_at", "ending"),
            ),
            section(_("Withdrawn"), "withdrawn_at", "withdrawn_step", "withdrawn_stage"),
            section(_("Drives"), "drives_told"),
            *([section(_("Quality"), "quality")] if is_known else []),
        ]

    def get_queryset(self, request: HttpRequest) -> "QuerySet[Participant]":
        """Read in the same query who has driven, and the recruitment ids that this user may see:
        viewers neither read them nor find anybody by them.
        """
        rows: QuerySet[Participant] = super().get_queryset(request)
        known: Any = F("recruitment_id")
        if not request.user.is_superuser:
            ranks = (StudyMember.Role.OWNER, StudyMember.Role.RESEARCHER)
            own = StudyMember.objects.filter(user=request.user, role__in=ranks)
            known = Case(
                When(study__slug__in=list(own.values_list("slug", flat=True)), then=known),
                default=Value(""),
            )
        driven = Exists(Drive.objects.filter(participant=OuterRef("pk")))
        return rows.annotate(has_driven=driven, visible_id=known)

    def change_view(
        self, request: HttpRequest, object_id: str, form_url: str = "", extra_context: Any = None
    ) -> HttpResponse:
        row: Any = self.get_object(request, object_id)
        if row is not None and may(request.user, row.study.slug, "researcher"):
            audit.note(
                "person_opened",
                actor=request.user,
                person=row.user_id,
                study=row.study.slug,
                thing=row,
            )
        return super().change_view(request, object_id, form_url, extra_context)

    @admin.display(description=_("person"))
    def person(self, row: Participant) -> str:
        return row.user.shown_name if row.user is not None else NOTHING

    @admin.display(description=_("current step"), ordering="step")
    def where(self, row: Participant) -> str:
        return row.step or NOTHING

    @admin.display(description=_("condition"), ordering="cell")
    def condition(self, row: Participant) -> str:
        return ", ".join(row.conditions) or NOTHING

    @admin.display(description=_("language"))
    def language_name(self, row: Participant) -> str:
        return language_name(row.language)

    @admin.display(description=_("recruitment"))
    def came_with(self, row: Participant) -> str:
        return ", ".join(f"{name} {value}" for name, value in row.recruitment.items()) or NOTHING

    @admin.display(description=_("draws"))
    def draws_told(self, row: Participant) -> str | SafeString:
        """Return every draw: when, which cell, why, and the places taken in each cell then."""
        lines = (
            (
                f"{timezone.localtime(one.at):%Y-%m-%d %H:%M} · " if one.at else "",
                one.cell,
                one.get_reason_display(),
                ", ".join(f"{cell} {count}" for cell, count in one.counts.items()),
                one.seed if one.seed is not None else NOTHING,
            )
            for one in row.draws.order_by("number")
        )
        told = gettext("{}{}: {}; places taken: {}; seed {}")
        return format_html_join(format_html("<br>"), told, lines) or NOTHING

    def get_urls(self) -> list[URLPattern]:
        page = self.admin_site.admin_view(never_cache(self.withdraw_view))
        name = "experiments_participant_withdraw"
        return [path("<uuid:pk>/withdraw/", page, name=name), *super().get_urls()]

    def withdraw_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        frame = self.admin_site.each_context(request) | {"opts": self.opts}
        return withdraw_page(request, pk, frame | {"study_tab": self.study_tab})

    def render_change_form(
        self, request: HttpRequest, context: dict[str, Any], *args: Any, **options: Any
    ) -> Any:
        row = context["original"]
        context["may_withdraw"] = row is not None and may_withdraw(request.user, row)
        return super().render_change_form(request, context, *args, **options)

    @admin.display(description=_("recruitment id"), ordering="visible_id")
    def known_id(self, row: Participant) -> str:
        return getattr(row, "visible_id", "") or NOTHING

    @admin.display(description=_("quality flags"))
    def quality(self, row: Participant) -> str | SafeString:
        """Return what speaks against the participant's data, the most serious first. Nobody is left
        out because of it.
        """
        # with NumPy, which other pages need not load
        from experiments.recruitment.quality import flags_of_study  # noqa: PLC0415

        lines = (
            (GRADE_NAMES[one.grade], FLAG_NAMES[one.name], one.value)
            for one in flags_of_study(row.study, [row.code])
        )
        return format_html_join(format_html("<br>"), "{}: {} ({})", lines) or gettext("none")

    @admin.display(description=_("completion"))
    def ending(self, row: Participant) -> Any:
        return ENDING_NAMES.get(row.completion, NOTHING)

    @admin.display(description=_("drives"), boolean=True)
    def drive_count(self, row: Participant) -> bool:
        return bool(getattr(row, "has_driven", False))

    @admin.display(description=_("drives"))
    def drives_told(self, row: Participant) -> str | SafeString:
        drives = row.drives.order_by("number")
        lines = (
            (
                link_to(
                    "admin:experiments_drive_change",
                    f"{one.number} · {one.condition} · {one.outcome or NOTHING}",
                    one.pk,
                ),
            )
            for one in drives
        )
        return format_html_join(format_html("<br>"), "{}", lines) or NOTHING


@admin.register(Drive)
class DriveAdmin(StudyRows):
    """Drives: what was assigned, what was applied, how the task went; excluded and taken back with
    a reason.
    """

    study = "participant__study"
    study_tab = "drives"
    show_full_result_count = False
    list_display = (
        "granted_at",
        "code",
        "study_name",
        "number",
        "condition",
        "moved",
        "outcome_told",
        "as_assigned",
        "is_counted",
    )
    list_filter = (
        StudyOfDriveFilter,
        "participant__kind",
        "participant__status",
        "condition",
        "outcome",
        "moved",
        MismatchFilter,
        ExcludedFilter,
    )
    list_select_related = ("participant__study", "session")
    list_per_page = 50
    search_fields = ("participant__code",)
    date_hierarchy = "granted_at"
    readonly_fields = (
        *WHICH,
        *RECORDED,
        "granted",
        "finalised",
        "round_shown",
        "outcome_told",
        "assigned_told",
        "applied_told",
        "differs",
        "versions_told",
        "excluded",
    )
    fieldsets = (
        section(
            None,
            *WHICH,
            "step",
            "visit",
            "round_shown",
            "number",
            "condition",
            "seed",
            "versions_told",
        ),
        section(
            _("Outcome"),
            *("granted", "exposed_at", "moved", "outcome_told", "finalised", *RECORDED),
        ),
        section(_("Condition"), "differs", "assigned_told", "applied_told"),
        section(_("Excluded"), "excluded"),
    )
    change_form_template = "admin/experiments/drive/change_form.html"

    @admin.display(description=_("participant"), ordering="participant__code")
    def code(self, row: Drive) -> str | SafeString:
        return link_to(
            "admin:experiments_participant_change", row.participant.code, row.participant_id
        )

    @admin.display(description=_("study"), ordering="participant__study")
    def study_name(self, row: Drive) -> str:
        return f"{row.participant.study.slug} {row.participant.study.version}"

    @admin.display(description=_("as assigned"), boolean=True)
    def as_assigned(self, row: Drive) -> bool:
        return not row.mismatches

    @admin.display(description=_("included"), boolean=True)
    def is_counted(self, row: Drive) -> bool:
        return not row.excluded_reason

    @admin.display(description=_("task outcome"), ordering="outcome")
    def outcome_told(self, row: Drive) -> Any:
        return GUIDE.word("outcomes", row.outcome) if row.outcome else NOTHING

    @admin.display(description=_("session"))
    def session_link(self, row: Drive) -> str | SafeString:
        return link_to("admin:telepresence_sessions_session_change", row.session_id, row.session_id)

    @admin.display(description=_("replay"))
    def replay(self, row: Drive) -> str | SafeString:
        return link_to("replay", gettext("Replay"), row.session_id)

    @admin.display(description=_("assigned"))
    def assigned_told(self, row: Drive) -> str | SafeString:
        return assigned_in_words(row.assigned)

    @admin.display(description=_("applied"))
    def applied_told(self, row: Drive) -> str | SafeString:
        return recorded_in_words(row.applied)

    @admin.display(description=_("result"))
    def result_told(self, row: Drive) -> str | SafeString:
        return recorded_in_words(row.result)

    @admin.display(description=_("robot at start and end"))
    def ends_told(self, row: Drive) -> str | SafeString:
        return recorded_in_words({"began_with": row.began_with, "ended_with": row.ended_with})

    @admin.display(description=_("versions"))
    def versions_told(self, row: Drive) -> str:
        return ", ".join(f"{name} {version}" for name, version in row.versions.items()) or NOTHING

    @admin.display(description=_("differs"))
    def differs(self, row: Drive) -> str:
        return ", ".join(row.mismatches) or NOTHING

    @admin.display(description=_("excluded"))
    def excluded(self, row: Drive) -> str:
        if not row.excluded_reason:
            return gettext("no")
        who = row.excluded_by.shown_name if row.excluded_by is not None else NOTHING
        return f"{row.excluded_reason} ({who}, {time_text(row.excluded_at)})"

    @admin.display(description=_("round"))
    def round_shown(self, row: Drive) -> int:
        return row.round + 1  # stored from 0

    @admin.display(description=_("granted"))
    def granted(self, row: Drive) -> str:
        return time_text(row.granted_at)

    @admin.display(description=_("finalised"))
    def finalised(self, row: Drive) -> str:
        return time_text(row.settled_at)

    def get_urls(self) -> list[URLPattern]:
        page = self.admin_site.admin_view(never_cache(self.exclude_view))
        return [
            path("<uuid:pk>/exclude/", page, name="experiments_drive_exclude"),
            *super().get_urls(),
        ]

    def render_change_form(
        self, request: HttpRequest, context: dict[str, Any], *args: Any, **options: Any
    ) -> Any:
        row = context.get("original")
        context["may_exclude"] = row is not None and may(
            request.user, row.participant.study.slug, "researcher"
        )
        return super().render_change_form(request, context, *args, **options)

    def exclude_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Ask why a drive is excluded, or taken back; both need a reason, and both are noted."""
        row = Drive.objects.select_related("participant__study").filter(pk=pk).first()
        if row is None or not may(request.user, row.participant.study.slug, "researcher"):
            raise Http404
        reason, error = request.POST.get("reason", "").strip(), ""
        if request.method == "POST":
            error = (
                ""
                if LEAST_REASON <= len(reason) <= MOST_REASON
                else gettext("Enter a reason of at most %(n)d characters.") % {"n": MOST_REASON}
            )
            if not error:
                self._set(request, row, reason, exclude="exclude" in request.POST)
                return HttpResponseRedirect(
                    reverse("admin:experiments_drive_change", args=[row.pk])
                )
        title = (
            gettext("Undo the exclusion") if row.excluded_reason else gettext("Exclude this drive")
        )
        context = self.admin_site.each_context(request) | {
            "title": title,
            "opts": self.opts,
            "study": row.participant.study,
            "study_tab": self.study_tab,
            "drive": row,
            "error": error,
            "reason": reason,
        }
        return render(request, "admin/experiments/drive/exclude.html", context)

    @staticmethod
    def _set(request: HttpRequest, row: Drive, reason: str, *, exclude: bool) -> None:
        act = "drive_excluded" if exclude else "drive_included"
        audit.note(
            act,
            actor=request.user,
            person=row.participant.user_id,
            study=row.participant.study.slug,
            thing=row,
        )
        told = {
            "excluded_reason": reason,
            "excluded_by": request.user,
            "excluded_at": timezone.now(),
        }
        rows = Drive.objects.filter(pk=row.pk)
        if exclude:
            rows.update(**told)
            publishing.log(row, request.user, f"Excluded: {reason}")
            messages.success(
                request,
                gettext(
                    "Drive excluded. You get each table both with and without excluded drives."
                ),
            )
        else:
            rows.update(excluded_reason="", excluded_by=None, excluded_at=None)
            publishing.log(
                row, request.user, f"Not excluded any more: {reason} (was: {row.excluded_reason})"
            )
            messages.success(request, gettext("The drive is included again."))


def is_uuid(text: str) -> bool:
    """Tell whether a text is the id of a row, as it stands in addresses."""
    try:
        uuid.UUID(text)
    except ValueError:
        return False
    return True
