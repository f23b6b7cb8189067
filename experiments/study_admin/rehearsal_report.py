"""A rehearsal as text: its progress, and its issues with the builder's page that corrects each."""

import datetime
from collections.abc import Iterable
from typing import Any

import msgspec
from django.utils import timezone
from django.utils.translation import gettext as _, ngettext

from experiments.builder.pages import BuilderPlace
from experiments.builder.views import LinkedProblem, address
from experiments.definition.schema import StudyDefinition
from experiments.models import Rehearsal
from experiments.rehearsal import runs
from experiments.rehearsal.report import Issue
from experiments.research.live import condition_title

Groups = dict[str, list[LinkedProblem]]  # by the title of the condition


def state_text(row: Rehearsal, now: datetime.datetime) -> str:
    if runs.is_lost(row, now):
        seen = {"host": row.host or "?", "time": f"{timezone.localtime(row.seen_at):%H:%M %Z}"}
        text = _(
            "Failed: its process on %(host)s has given no sign of life since %(time)s. That "
            "computer may have been restarted. You can start another rehearsal."
        )
        return text % seen
    match row.status:
        case runs.Status.WAITING:
            return _waiting(row, now)
        case runs.Status.RUNNING:
            return _running(row.progress, row.host or "?")
        case runs.Status.STOPPED:
            name = row.ended_by.shown_name if row.ended_by is not None else _("a researcher")
            return _("Ended by %(name)s before it was finished.") % {"name": name}
        case runs.Status.FAILED:
            return _("Failed: %(reason)s") % {"reason": row.reason}
    if row.passed:
        return _("Passed.")
    n = sum(one.is_problem for one in _issues(row)) or len(row.report.get("problems") or ())
    return ngettext("%(n)d problem found.", "%(n)d problems found.", n) % {"n": n}


def _issues(row: Rehearsal) -> list[Issue]:
    return [msgspec.convert(one, Issue) for one in row.report.get("issues", ())]


def _waiting(row: Rehearsal, now: datetime.datetime) -> str:
    running = Rehearsal.objects.filter(status=runs.Status.RUNNING, seen_at__gte=now - runs.SILENT)
    if running.exists():
        return _("Waiting until another rehearsal has ended.")
    if now - row.began_at > runs.NOT_TAKEN:
        return _(
            "Not started: this site has no process that runs rehearsals. Ask the person who runs "
            "the site to start manage.py run_practice, or to use the command."
        )
    return _("Waiting to start.")


def _running(progress: dict[str, int], host: str) -> str:
    if not progress:
        return _("Preparing a copy of the site on %(host)s.") % {"host": host}
    text = _(
        "Running on %(host)s: %(drives)d drives have ended, in %(conditions)d of %(of_conditions)d "
        "conditions; %(bots)d of %(of_bots)d bots have finished."
    )
    if progress["bots"] >= progress["of_bots"]:
        text = _("All %(of_bots)d bots have finished. Evaluating their data on %(host)s.")
    return text % {"host": host, "drives": 0, **progress}


def issues_of(row: Rehearsal) -> tuple[Groups, Groups]:
    """Return the problems and the notes of a rehearsal; of an old one the sentences alone."""
    definition, whole = row.study.as_definition(), _("The whole study")
    problems, notes = Groups(), Groups()
    for one in _issues(row):
        place = place_of(one, definition)
        url = address(row.study, place) if place is not None else ""
        title = condition_title(definition, one.condition) or whole
        linked = LinkedProblem(_(one.template) % one.values, url)
        (problems if one.is_problem else notes).setdefault(title, []).append(linked)
    if not problems and not notes:
        for name, groups in (("problems", problems), ("notes", notes)):
            if sentences := row.report.get(name):
                groups[whole] = [LinkedProblem(text) for text in sentences]
    return problems, notes


def place_of(issue: Issue, study: StudyDefinition) -> BuilderPlace | None:
    """Return the page of the builder on which an issue is corrected; None where there is none."""
    condition = study.condition(issue.condition)
    match issue.kind:
        case "missed" | "unseen_door" | "not_completed" if condition is not None:
            course = study.course_of(condition)
            return BuilderPlace("courses", study.courses.index(course)) if course else None
        case "not_applied" if condition is not None:
            return BuilderPlace("conditions", study.conditions.index(condition))
        case "too_short":
            return _step(step is study.task for step in study.steps)
        case "stuck":
            # further headings of the page may follow the title of the step
            place, titles = f"{issue.place} · ", (step.title.values() for step in study.steps)
            return _step(any(place.startswith(f"{one} · ") for one in own) for own in titles)
        case "empty":
            asked = str(issue.values["column"]).partition(".")[0]
            return _step(getattr(step, "questionnaire", "") == asked for step in study.steps)
        case "no_task" | "no_code":
            return BuilderPlace("steps")
    return None


def _step(is_it: Iterable[bool]) -> BuilderPlace | None:
    return next((BuilderPlace("steps", n) for n, it in enumerate(is_it) if it), None)


def tables_of(row: Rehearsal) -> dict[str, Any]:
    definition, report = row.study.as_definition(), row.report
    conditions = [
        {**one, "title": title, "bot_minutes": (one["median_seconds"] or 0.0) / 60.0}
        for one in report.get("conditions", ())
        for title in [condition_title(definition, one["key"])]
    ]
    return {
        "conditions": conditions,
        "pages": report.get("steps", ()),
        "expected_minutes": report.get("expected_minutes"),
        "power": report.get("power", ()),
    }
