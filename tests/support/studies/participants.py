"""Studies in the database and people in them, driving by rows instead of robots."""

import datetime
import uuid
from pathlib import Path
from typing import Any

import msgspec
from django.conf import settings
from django.utils import timezone

from accounts.models import User
from experiments import publishing
from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped
from experiments.models import Drive, Participant, Study
from experiments.participation import progress, questions
from experiments.participation.drive_status import DriveStatus
from experiments.participation.journey import JourneyPlace
from robots.models import FloorPlan, Robot
from robots.plans.floorplans import store_floor_plan
from sessions.models import Session
from surveys.models import Answer, Response
from tests.support.agents.docked_robot import report_in_dock
from tests.support.people import person
from tests.support.robots import online_robot
from tests.support.sessions.rows import session_row

OFFICE = Path(settings.BASE_DIR) / "robots" / "world" / "plans" / "office"


def site(name: str = "office", *, series: str = "giraff") -> Robot:
    """A robot of a series that is online at a site; the only one is the office that comes with the
    site.
    """
    place = FloorPlan.objects.filter(name=name).first() or store_floor_plan(OFFICE)
    report, sheet = report_in_dock(place, series), {"series": series}
    about = {"title": series.title(), "floor_plan": place, "factsheet": sheet, "report": report}
    return online_robot(f"{series}-{name}", **about)


def published(definition: StudyDefinition, **fields: Any) -> Study:
    """A study that is open, whatever robots there are."""
    now = timezone.now()
    row = publishing.store(definition, now)
    Study.objects.filter(pk=row.pk).update(
        **{"status": Study.Status.PUBLISHED, "published_at": now, **fields}
    )
    return Study.objects.get(pk=row.pk)


def of(name: str, **changes: Any) -> StudyDefinition:
    """A shipped study with some of it replaced."""
    return msgspec.convert({**msgspec.to_builtins(shipped()[name]), **changes}, StudyDefinition)


def comer(study: Study, user: User, **more: Any) -> Participant:
    """A participant who arrived by the open link just now."""
    return progress.enter(
        study, user, **{"access": "open", "recruitment": {}, "now": timezone.now(), **more}
    )


def assign(participant: Participant, *conditions: str) -> Participant:
    """Assign a cell to a participant, as the first grant does."""
    Participant.objects.filter(pk=participant.pk).update(
        cell="-".join(conditions), conditions=list(conditions), stage=Participant.Stage.UNDER_WAY
    )
    participant.refresh_from_db()
    return participant


def fill(study: Study, *, quota: int = 1) -> None:
    """Assign a participant to each open condition of the paper's study, whose cells are limited."""
    definition = {**study.definition, "allocation": {"design": "between", "quota": quota}}
    Study.objects.filter(pk=study.pk).update(definition=definition)
    for n, condition in enumerate(("giraff_open", "giraff_lab_closed", "giraff_lounge_closed")):
        assign(comer(study, person(f"p{n}")), condition)


def respond(
    participant: Participant,
    key: str,
    values: dict[str, Any],
    *,
    number: int = 0,
    finished: bool = True,
) -> None:
    """Answer the questionnaire of a step for a participant, in the round of a number."""
    study, now = participant.study.as_definition(), timezone.now()
    place = JourneyPlace(participant.visit, number, key)
    step: Any = study.step(key)
    response = questions.ask(participant, place, step, drive=DriveStatus(), now=now)
    Response.objects.filter(pk=response.pk).update(finished_at=now if finished else None)
    for position, (item, value) in enumerate(values.items()):
        given = {"item": item, "value": value, "position": position}
        Answer.objects.create(response=response, **given, first_at=now, answered_at=now)


def answered(participant: Participant, key: str, values: dict[str, Any]) -> Participant:
    """Answer the questionnaire of a step for a participant, and move them on to the task."""
    respond(participant, key, values)
    Participant.objects.filter(pk=participant.pk).update(step="task")
    participant.refresh_from_db()
    return participant


def session_of(
    robot: Robot,
    participant: Participant,
    *,
    outcome: str = "",
    granted: bool = True,
    moved: bool = False,
    reason: str = "",
) -> Session:
    """A session of a participant; with an outcome it is ended, and its record closed."""
    now = timezone.now()
    ended = {"state": "ended", "outcome": outcome, "ended_at": now, "closed_at": now}
    return session_row(
        robot,
        participant.user,
        live_key=str(uuid.uuid4()),
        granted_at=now if granted else None,
        first_motion_at=now if moved else None,
        outcome_reason=reason,
        **(ended if outcome else {"state": "driving"}),
    )


def drive_of(
    robot: Robot, participant: Participant, *, outcome: str = "", moved: bool = False, **more: Any
) -> Drive:
    """A drive of a participant on their current step."""
    session = session_of(robot, participant, outcome=outcome, moved=moved)
    participant.refresh_from_db()
    fields = {
        "step": participant.step,
        "visit": participant.visit,
        "round": participant.round,
        "number": participant.drives.count() + 1,
        "condition": (participant.conditions[: participant.round + 1] or [""])[-1],
        "seed": 1,
        "granted_at": timezone.now(),
        "settled_at": timezone.now() if outcome else None,
        "exposed_at": timezone.now() if moved else None,
        "moved": moved,
        **more,
    }
    return Drive.objects.create(participant=participant, session=session, **fields)


def in_two_days() -> list[dict[str, Any]]:
    """Opening hours of a study that is closed today and tomorrow, wherever it is."""
    weekday = (timezone.now().weekday() + 2) % 7
    return [{"days": [weekday], "start": "09:00", "end": "10:00"}]


def later(seconds: float) -> datetime.datetime:
    return timezone.now() + datetime.timedelta(seconds=seconds)
