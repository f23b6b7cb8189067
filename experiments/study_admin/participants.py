"""Participants in the administration: shown, and withdrawn on their request, never edited."""

from typing import Any

from django.contrib import admin
from django.db.models import Case, Exists, F, OuterRef, Q, QuerySet, Value, When
from django.http import Http404, HttpRequest, HttpResponse
from django.urls import URLPattern
from django.utils import timezone
from django.utils.safestring import SafeString
from django.utils.translation import get_language, gettext, gettext_lazy as _

from accounts import audit
from experiments.access import may
from experiments.builder.labels import ENDING_NAMES
from experiments.definition.recruitment.quality_flags import Grade, QualityFlag
from experiments.models import Drive, Participant, StudyMember
from experiments.participation.withdrawal import deletion, receipt as receipts
from experiments.study_admin.rows import (
    CompletionFilter,
    LanguageFilter,
    StudyFilter,
    StudyRows,
    by_line,
    column,
    section,
)
from robots.admin import NOTHING, link_to
from surveys.document_forms.fields import language_name

GRADE_NAMES = {Grade.NOTE: _("note"), Grade.DOUBTFUL: _("doubtful"), Grade.SERIOUS: _("serious")}
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


def _draws(row: Participant) -> SafeString:
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
    return by_line(gettext("{}{}: {}; places taken: {}; seed {}"), lines)


def _quality_flags(row: Participant) -> str | SafeString:
    """Return what data checks found, the most serious first; they exclude no participant."""
    # with NumPy, which other pages need not load
    from experiments.recruitment.quality import flags_of_study  # noqa: PLC0415

    flags = flags_of_study(row.study, [row.code])
    lines = ((GRADE_NAMES[one.grade], FLAG_NAMES[one.name], one.value) for one in flags)
    return by_line("{}: {} ({})", lines) or gettext("none")


def _drives(row: Participant) -> SafeString:
    drives = (
        (one.pk, f"{one.number} · {one.condition} · {one.outcome or NOTHING}")
        for one in row.drives.order_by("granted_at")
    )
    page = "admin:experiments_drive_change"
    return by_line("{}", ([link_to(page, text, key)] for key, text in drives))


@admin.register(Participant)
class ParticipantAdmin(StudyRows):
    """Participants. Viewers see their codes, not who they are."""

    study = "study"
    study_tab = "participants"
    list_display = (
        *("code", "study", "kind", "status", "where", "condition"),
        *("has_drives", "ending", "known_id", "created_at", "seen_at"),
    )
    list_filter = (
        StudyFilter,
        *("kind", "status", "stage"),
        ("completion", CompletionFilter),
        "access",
        ("language", LanguageFilter),
    )
    list_select_related = ("study", "user")
    search_fields = ("code", "visible_id")
    search_help_text = _("Search by participant code or by the id of a recruitment site.")
    date_hierarchy = "created_at"
    change_form_template = "admin/experiments/participant/change_form.html"

    where = column(_("current step"), lambda row: row.step, ordering="step")
    condition = column(_("condition"), lambda row: ", ".join(row.conditions), ordering="cell")
    has_drives = column(_("drives"), lambda row: getattr(row, "has_driven", False), boolean=True)
    ending = column(_("completion"), lambda row: ENDING_NAMES.get(row.completion, ""))
    known_id = column(_("recruitment id"), lambda row: row.visible_id, ordering="visible_id")
    person = column(_("person"), lambda row: row.user.shown_name if row.user is not None else "")
    language_name = column(_("language"), lambda row: language_name(row.language))
    came_with = column(
        _("recruitment"),
        lambda row: ", ".join(f"{name} {value}" for name, value in row.recruitment.items()),
    )
    draw_list = column(_("draws"), _draws)
    drive_list = column(_("drives"), _drives)
    quality = column(_("quality flags"), _quality_flags)

    def get_fieldsets(
        self, request: HttpRequest, obj: Participant | None = None
    ) -> list[tuple[Any, dict[str, Any]]]:
        is_known = obj is not None and may(request.user, obj.study.slug, "researcher")
        who = ("person", "known_id", "came_with", "age") if is_known else ()
        times = ("created_at", "seen_at", "finished_at")
        progress = ("status", "visit", "step", "round", *times, "ending")
        return [
            section(None, "code", "study", "kind", "access", "language_name", *who),
            section(_("Assignment"), "cell", "condition", "draw_list", "stage"),
            section(_("Progress"), *progress),
            section(_("Withdrawn"), "withdrawn_at", "withdrawn_step", "withdrawn_stage"),
            section(_("Drives"), "drive_list"),
            *([section(_("Quality"), "quality")] if is_known else []),
        ]

    def get_queryset(self, request: HttpRequest) -> "QuerySet[Participant]":
        """Annotate who has driven, and the recruitment ids that this user may read and search."""
        rows: QuerySet[Participant] = super().get_queryset(request)
        is_shown = ~Q(status=Participant.Status.WITHDRAWN)  # whose id is a hash
        if not request.user.is_superuser:
            ranks = (StudyMember.Role.OWNER, StudyMember.Role.RESEARCHER)
            own = StudyMember.objects.filter(user=request.user, role__in=ranks)
            is_shown &= Q(study__slug__in=list(own.values_list("slug", flat=True)))
        known = Case(When(is_shown, then=F("recruitment_id")), default=Value(""))
        drives = Drive.objects.filter(participant=OuterRef("pk"))
        return rows.annotate(has_driven=Exists(drives), visible_id=known)

    def change_view(self, request: HttpRequest, object_id: str, *args: Any, **options: Any) -> Any:
        row: Any = self.get_object(request, object_id)
        if row is not None and may(request.user, row.study.slug, "researcher"):
            study, person = row.study.slug, row.user_id
            audit.note("person_opened", actor=request.user, person=person, study=study, thing=row)
        return super().change_view(request, object_id, *args, **options)

    def get_urls(self) -> list[URLPattern]:
        return [self.row_path(self.withdraw_view, "withdraw"), *super().get_urls()]

    def withdraw_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Once the participant's code is repeated, delete everything and show the receipt."""
        row = self.row_for(request, pk, "researcher")
        if row.status == Participant.Status.WITHDRAWN:
            raise Http404
        context: dict[str, Any] = {"title": gettext("Withdraw a participant")}
        code = request.POST.get("code", "").strip().upper()
        if request.method == "POST" and code == row.code:
            now = timezone.now()
            receipt = receipts.of(row, get_language() or "", now)
            # as all that is kept of it
            day = now.replace(hour=0, minute=0, second=0, microsecond=0)
            audit.note("participant_withdrawn", actor=request.user, study=row.study.slug, at=day)
            deletion.leave(row, now)
            context |= {"receipt": receipt, "signed": receipts.signed(receipt)}
        elif request.method == "POST":
            context["error"] = gettext("This is not the participant's code.")
        status = 422 if "error" in context else 200
        return self.row_page(request, row, "withdraw", context, status)
