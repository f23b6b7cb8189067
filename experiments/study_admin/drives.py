"""Drives in the administration: shown, excluded and included again with a reason, never edited."""

from typing import Any

from django.contrib import admin, messages
from django.http import HttpRequest, HttpResponse
from django.shortcuts import redirect
from django.urls import URLPattern
from django.utils import timezone
from django.utils.translation import gettext, gettext_lazy as _

from accounts import audit
from experiments import publishing
from experiments.builder.labels import GUIDE
from experiments.models import Drive
from experiments.study_admin.document_text import assigned_in_words, recorded_in_words, time_text
from experiments.study_admin.rows import (
    ExcludedFilter,
    MismatchFilter,
    StudyOfDriveFilter,
    StudyRows,
    column,
    section,
)
from robots.admin import NOTHING, link_to

LEAST_REASON, MOST_REASON = 3, 300
# pages that drives link to
PARTICIPANT = "admin:experiments_participant_change"
SESSION = "admin:telepresence_sessions_session_change"


def _exclusion(row: Drive) -> str:
    if not row.excluded_reason:
        return gettext("no")
    who = row.excluded_by.shown_name if row.excluded_by is not None else NOTHING
    return f"{row.excluded_reason} ({who}, {time_text(row.excluded_at)})"


@admin.register(Drive)
class DriveAdmin(StudyRows):
    study = "participant__study"
    study_tab = "drives"
    list_display = (
        *("granted_at", "code", "study_name", "number", "condition"),
        *("moved", "task_outcome", "as_assigned", "is_counted"),
    )
    list_filter = (
        StudyOfDriveFilter,
        *("participant__kind", "participant__status", "condition", "outcome", "moved"),
        MismatchFilter,
        ExcludedFilter,
    )
    list_select_related = ("participant__study", "session")
    search_fields = ("participant__code",)
    date_hierarchy = "granted_at"
    fieldsets = (
        section(
            None,
            *("code", "study_name", "session_link", "replay"),
            *("step", "visit", "round_number", "number", "condition", "seed", "versions_used"),
        ),
        section(
            _("Outcome"),
            *("granted", "exposed_at", "moved", "task_outcome", "finalised"),
            *("task_result", "robot_at_ends"),
        ),
        section(_("Condition"), "differs", "assigned_settings", "applied_settings"),
        section(_("Excluded"), "excluded"),
    )
    change_form_template = "admin/experiments/drive/change_form.html"

    code = column(
        _("participant"),
        lambda row: link_to(PARTICIPANT, row.participant.code, row.participant_id),
        ordering="participant__code",
    )
    study_name = column(
        _("study"),
        lambda row: f"{row.participant.study.slug} {row.participant.study.version}",
        ordering="participant__study",
    )
    as_assigned = column(_("as assigned"), lambda row: not row.mismatches, boolean=True)
    is_counted = column(_("included"), lambda row: not row.excluded_reason, boolean=True)
    task_outcome = column(
        _("task outcome"),
        lambda row: row.outcome and GUIDE.word("outcomes", row.outcome),
        ordering="outcome",
    )
    session_link = column(
        _("session"), lambda row: link_to(SESSION, row.session_id, row.session_id)
    )
    replay = column(_("replay"), lambda row: link_to("replay", gettext("Replay"), row.session_id))
    assigned_settings = column(_("assigned"), lambda row: assigned_in_words(row.assigned))
    applied_settings = column(_("applied"), lambda row: recorded_in_words(row.applied))
    task_result = column(_("result"), lambda row: recorded_in_words(row.result))
    robot_at_ends = column(
        _("robot at start and end"),
        lambda row: recorded_in_words({"began_with": row.began_with, "ended_with": row.ended_with}),
    )
    versions_used = column(
        _("versions"), lambda row: ", ".join(f"{part} {n}" for part, n in row.versions.items())
    )
    differs = column(_("differs"), lambda row: ", ".join(row.mismatches))
    excluded = column(_("excluded"), _exclusion)
    round_number = column(_("round"), lambda row: row.round + 1)  # stored from 0
    granted = column(_("granted"), lambda row: time_text(row.granted_at))
    finalised = column(_("finalised"), lambda row: time_text(row.settled_at))

    def get_urls(self) -> list[URLPattern]:
        return [self.row_path(self.exclude_view, "exclude"), *super().get_urls()]

    def exclude_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        row = self.row_for(request, pk, "researcher")
        reason, error = request.POST.get("reason", "").strip(), ""
        if request.method == "POST":
            if LEAST_REASON <= len(reason) <= MOST_REASON:
                _set_exclusion(request, row, reason, exclude="exclude" in request.POST)
                return redirect("admin:experiments_drive_change", row.pk)
            error = gettext("Enter a reason of at most %(n)d characters.") % {"n": MOST_REASON}
        undo, exclude = gettext("Undo the exclusion"), gettext("Exclude this drive")
        title = undo if row.excluded_reason else exclude
        context = {"title": title, "error": error, "reason": reason}
        return self.row_page(request, row, "exclude", context)


def _set_exclusion(request: HttpRequest, row: Drive, reason: str, *, exclude: bool) -> None:
    if exclude:
        stored = (reason, request.user, timezone.now())
        event, entry = "drive_excluded", f"Excluded: {reason}"
        text = gettext("Drive excluded. You get each table both with and without excluded drives.")
    else:
        stored = ("", None, None)
        event = "drive_included"
        entry = f"Not excluded any more: {reason} (was: {row.excluded_reason})"
        text = gettext("The drive is included again.")
    study, person = row.participant.study.slug, row.participant.user_id
    audit.note(event, actor=request.user, person=person, study=study, thing=row)
    fields = ("excluded_reason", "excluded_by", "excluded_at")
    Drive.objects.filter(pk=row.pk).update(**dict(zip(fields, stored, strict=True)))
    publishing.log(row, request.user, entry)
    messages.success(request, text)
