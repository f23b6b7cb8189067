"""The page that finishes a floor plan: it proposes a plan from the map, and a person names rooms
and moves openings, charging stations, places and checkpoints.

The unsaved draft is part of the form, so that people who edit the same plan do not see each other's
drafts; it is validated as strictly as a file.
"""

import contextlib
import json
import math
from typing import Any

import msgspec
from django.contrib import messages
from django.core.exceptions import PermissionDenied
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import render
from django.utils.translation import gettext as _

from accounts import audit
from robots.admin_pages.access import OfRobots
from robots.api.floorplan import FloorPlan as Plan
from robots.models import FloorPlan
from robots.plans import edits as plan_edits
from robots.plans.drafts import checked, free_at, grid_of, propose, series_titles, store_site
from robots.plans.edits import Document, EditError
from robots.plans.floorplans import FloorPlanRefusedError, plan_content

KINDS = ("place", "dock", "checkpoint", "opening")


class FinishingPage(OfRobots):
    def finish_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Show the plan; a POST changes the draft on the page, or stores it."""
        row: FloorPlan | None = self.get_object(request, str(pk))
        if row is None:
            raise Http404
        if not self.has_change_permission(request, row):
            raise PermissionDenied
        if request.method != "POST":
            return self._shown(request, row, row.plan, ())
        action = request.POST.get("action", "")
        if action == "propose":
            return self._proposed(request, row)
        draft, problems = _edited(request, row)
        draft = {**draft, "mapId": row.name, "title": row.title}
        if action in KINDS and not problems:
            draft = plan_edits.with_new(draft, action, *_where(request, draft), words=_words())
        elif action == "save" and not problems:
            problems = self._saved(request, row, draft)
            if not problems:
                return HttpResponseRedirect(request.path)
        elif not problems:
            problems = _problems(row, draft)
            if not problems:
                messages.success(request, _("The plan can be used. It is not saved yet."))
        return self._shown(request, row, draft, problems, changed=True)

    def _proposed(self, request: HttpRequest, row: FloorPlan) -> HttpResponse:
        """Propose a plan, and store it to be edited."""
        with contextlib.suppress(ValueError):
            row.occupied_thresh = float(request.POST.get("occupied_thresh", ""))
        try:
            grid = grid_of(row)
            store_site(propose(grid, row.name, row.title), grid)
        except FloorPlanRefusedError as error:
            return self._shown(request, row, {}, error.problems)
        done = _("Plan proposed from the map.")
        self.log_change(request, row, done)
        audit.note("plan_proposed", actor=request.user, thing=row.name)
        return HttpResponseRedirect(request.path)

    def _saved(self, request: HttpRequest, row: FloorPlan, draft: Document) -> tuple[str, ...]:
        """Store the plan, or return its problems."""
        try:
            grid = grid_of(row)
            _row, kept = store_site(checked(draft, grid), grid)
        except FloorPlanRefusedError as error:
            return error.problems
        self.log_change(request, row, _("Plan finished."))
        audit.note("plan_finished", actor=request.user, thing=row.name)
        text = _("Saved. To simulate a robot here, start it with --option plan=%(folder)s.")
        messages.success(request, text % {"folder": kept})
        return ()

    def _shown(
        self,
        request: HttpRequest,
        row: FloorPlan,
        draft: Document,
        problems: tuple[str, ...],
        *,
        changed: bool = False,
    ) -> HttpResponse:
        context = self.admin_site.each_context(request) | {
            "title": _("Finish the plan of %(site)s") % {"site": row.title},
            "row": row,
            "opts": self.opts,
            "plan": draft,
            "draft": json.dumps(draft),
            "site": plan_content(row) | {"plan": draft},
            "docks": [
                {**dock, "degrees": math.degrees(dock["theta"])} for dock in draft.get("docks", ())
            ],
            "openings": plan_edits.openings_of(draft),
            "checkpoints": plan_edits.checkpoints_of(draft),
            "series": series_titles(),
            "problems": problems,
            "changed": changed,
            "added": request.POST.get("action", ""),
        }
        return render(request, "admin/robots/floorplan/finish.html", context)


def _edited(request: HttpRequest, row: FloorPlan) -> tuple[Document, tuple[str, ...]]:
    """Return the plan in the form, and the problems of its fields."""
    try:
        sent = msgspec.json.decode(request.POST.get("draft", ""), type=Plan)
        before: Document = json.loads(msgspec.json.encode(sent))
    except msgspec.DecodeError:
        before = row.plan
    fields = {name: str(value) for name, value in request.POST.items()}
    try:
        return plan_edits.edited(before, fields, free_at(grid_of(row))), ()
    except FloorPlanRefusedError as error:
        return before, error.problems
    except EditError as error:
        if error.field.endswith(".join"):
            text = _("These rooms don't touch, so they can't be joined.")
        elif "," in error.text:
            text = _("Use a decimal point and no comma: 0.6, or 1000.")
        else:
            text = _("“%(text)s” is not a valid number here.") % {"text": error.text}
        return before, (text,)


def _problems(row: FloorPlan, draft: Document) -> tuple[str, ...]:
    try:
        checked(draft, grid_of(row))
    except FloorPlanRefusedError as error:
        return error.problems
    return ()


def _where(request: HttpRequest, draft: Document) -> tuple[float, float]:
    """Return the point where the map was clicked, or the middle of the first room."""
    try:
        x, y = (float(request.POST.get(name, "")) for name in ("at_x", "at_y"))
    except ValueError:
        corners = draft["rooms"][0]["polygon"] if draft.get("rooms") else [[0.0, 0.0]]
        x, y = (sum(corner[axis] for corner in corners) / len(corners) for axis in (0, 1))
    return max(-1e5, min(1e5, x)), max(-1e5, min(1e5, y))


def _words() -> dict[str, str]:
    return {
        "place": _("Place"),
        "dock": _("Charging station"),
        "checkpoint": _("Checkpoint"),
        "opening": _("Opening"),
    }
