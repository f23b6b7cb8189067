"""Rehearsals in the administration: to start, follow and end one, and to read what it found."""

import os
from typing import Any
from uuid import UUID

from django.contrib import admin, messages
from django.contrib.admin.utils import unquote
from django.http import HttpRequest, HttpResponse, JsonResponse
from django.shortcuts import redirect
from django.urls import URLPattern, path
from django.utils import timezone
from django.utils.translation import gettext, gettext_lazy as _
from django.views.decorators.http import require_POST, require_safe

from experiments.access import may
from experiments.definition import problems
from experiments.models import Rehearsal, Study
from experiments.rehearsal import plan, runs
from experiments.research.study_access import note_change, study_for
from experiments.study_admin.rehearsal_report import issues_of, state_text, tables_of
from experiments.study_admin.rows import StudyFilter, StudyRows, column


def offer_of(study: Study) -> dict[str, Any]:
    """Return the newest rehearsal, and what the next one would do or why it is impossible."""
    now, definition, latest = timezone.now(), study.as_definition(), runs.latest(study)
    return {
        "latest": latest,
        "text": state_text(latest, now) if latest is not None else "",
        "is_live": latest is not None and runs.is_live(latest, now),
        "is_older": latest is not None and latest.sha256 != study.sha256,
        "is_unfinished": any(True for _problem in problems.problems(definition)),
        "impossible": plan.problems(definition),
        "bots": len(plan.endings(definition)),
        "conditions": len(definition.conditions),
        "minutes": plan.expected_minutes(definition, os.cpu_count() or 1),
    }


def _state(row: Rehearsal) -> str:
    lost = runs.is_lost(row, timezone.now())
    return str((runs.Status.FAILED if lost else runs.Status(row.status)).label)


@admin.register(Rehearsal)
class RehearsalAdmin(StudyRows):
    study = "study"
    study_tab = "overview"
    list_display = ("began_at", "study", "state", "finished_at", "passed", "is_of_this_definition")
    list_filter = (StudyFilter, "status", "passed")
    list_select_related = ("study",)

    state = column(_("status"), _state, ordering="status")
    is_of_this_definition = column(
        _("of the current definition"), lambda row: row.sha256 == row.study.sha256, boolean=True
    )

    def get_urls(self) -> list[URLPattern]:
        start = self.admin_site.admin_view(require_POST(self.start_view))
        return [
            path("start/<uuid:study>/", start, name="experiments_rehearsal_start"),
            self.row_path(require_POST(self.end_view), "end"),
            self.row_path(require_safe(self.state_view), "state", ".json"),
            self.row_path(require_safe(self.report_view), "report", ".json"),
            *super().get_urls(),
        ]

    def start_view(self, request: HttpRequest, study: UUID) -> HttpResponse:
        row = study_for(request, study, "owner")
        offer = offer_of(row)
        if offer["is_unfinished"] or offer["impossible"]:
            messages.error(request, gettext("The study cannot be rehearsed as it is."))
            return redirect("admin:experiments_study_change", row.pk)
        try:
            key = runs.request(row, timezone.now()).pk
        except runs.AlreadyRehearsedError:
            messages.info(request, gettext("This study is being rehearsed already."))
            latest = runs.latest(row)
            key = latest.pk if latest is not None else None
        else:
            note_change(request, row, "Rehearsal started.", event="rehearsal_started", thing=key)
        if key is None:  # it has been deleted since
            return redirect("admin:experiments_study_change", row.pk)
        return redirect("admin:experiments_rehearsal_change", key)

    def end_view(self, request: HttpRequest, pk: UUID) -> HttpResponse:
        """End a rehearsal; what its bots did is deleted."""
        row = self.row_for(request, pk, "owner")
        if runs.stop(row.pk, request.user):
            entry, text = "Rehearsal ended.", gettext("Rehearsal ended.")
            note_change(request, row.study, entry, text, event="rehearsal_ended", thing=row.pk)
        return redirect("admin:experiments_rehearsal_change", row.pk)

    def state_view(self, request: HttpRequest, pk: UUID) -> JsonResponse:
        row, now = self.row_for(request, pk, "viewer"), timezone.now()
        state = {"text": state_text(row, now), "live": runs.is_live(row, now)}
        return JsonResponse(state | {"progress": row.progress})

    def report_view(self, request: HttpRequest, pk: UUID) -> JsonResponse:
        row = self.row_for(request, pk, "viewer")
        name = f"{row.study.slug}-{row.study.version}-rehearsal.json"
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        return JsonResponse(row.report, headers=headers, json_dumps_params={"indent": 1})

    def change_view(self, request: HttpRequest, object_id: str, *args: Any, **options: Any) -> Any:
        row = self.get_object(request, unquote(object_id))
        if row is None or request.method != "GET" or not self.has_view_permission(request, row):
            return super().change_view(request, object_id, *args, **options)
        now = timezone.now()
        found, noted = issues_of(row)
        context = {
            "title": gettext("Rehearsal"),
            "opts": Study._meta,
            "text": state_text(row, now),
            "is_live": runs.is_live(row, now),
            "is_older": row.sha256 != row.study.sha256,
            "is_done": row.status == runs.Status.DONE,
            "is_owner": may(request.user, row.study.slug, "owner"),
            "offer": offer_of(row.study),
            "found": found,
            "noted": noted,
            **tables_of(row),
        }
        return self.row_page(request, row, "report", context)
