"""The live view of a study: participants, robots and drives, read every two seconds with a fixed
number of queries.

Participants have their codes instead of names. `heard` is how many seconds ago a robot reported.
Unknown values are None.
"""

import datetime
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
from django.utils.translation import get_language

from experiments.definition.course import CourseError
from experiments.definition.schema import StudyDefinition
from experiments.models import Drive, Participant, StepVisit, Study, TaskEvent
from experiments.participation.drive_config import ground
from experiments.participation.drive_status import kind_of
from experiments.participation.robot_eligibility import may_see
from experiments.stored_states import newest_chunk
from robots.api import floorplan
from robots.models import Robot
from robots.readiness_text import in_words
from sessions.leases import store, terms
from sessions.models import NetworkSample, Session, SessionEvent
from sessions.wizard import leases as wizards
from surveys.documents import spoken

RECENT = datetime.timedelta(hours=1)
MOST_PEOPLE = 200
DOORS_BACK = datetime.timedelta(days=1)
# Who may drive a robot in the current version: all, invited participants, or no participants.
USES = ("open", "invitation", "none")


def now_in(slug: str, now: datetime.datetime) -> dict[str, Any]:
    """Return participants, robots and drives of all versions of a study; times in Unix seconds,
    ages in seconds.
    """
    rows = list(Study.objects.filter(slug=slug).order_by("-version"))
    definitions = {study.pk: study.as_definition() for study in rows}
    drives = Drive.objects.filter(participant__study__slug=slug).order_by("granted_at")
    drives = drives.exclude(session__state=Session.State.ENDED)
    drives = drives.select_related("session__robot", "participant")
    robots = _robots(slug, definitions.values(), drives)
    current = definitions[current_version(rows).pk] if rows else None
    unready = _unready(robots, now)
    more = ({"unready": unready[one.pk], "use": _use_of(one, current)} for one in robots)
    shown = [_robot(robot, now) | about for robot, about in zip(robots, more, strict=True)]
    return {
        "stamp": now.timestamp(),
        "participants": _people(slug, definitions, now),
        "robots": sorted(shown, key=lambda robot: USES.index(robot["use"])),
        "queues": _queues(robots, slug),
        "drives": [_drive(drive, definitions[drive.participant.study_id], now) for drive in drives],
    }


def current_version(rows: Sequence[Study]) -> Study:
    """Return the newest published version of a study, else the newest, which is the first row."""
    return next((row for row in rows if row.status != Study.Status.DRAFT), rows[0])


def _use_of(robot: Robot, study: StudyDefinition | None) -> str:
    conditions = study.conditions if study is not None else ()
    kind = kind_of(robot)
    accesses = {one.access for one in conditions if (one.robot, one.site) == kind}
    return next((use for use in USES if use in accesses), USES[-1])


def robots_of(slug: str) -> list[Robot]:
    return _robots(slug, [study.as_definition() for study in Study.objects.filter(slug=slug)], ())


def _robots(
    slug: str, definitions: Iterable[StudyDefinition], drives: Iterable[Drive]
) -> list[Robot]:
    """Return the robots of the conditions' series at their sites, and those in use."""
    wanted = {(one.robot, one.site) for study in definitions for one in study.conditions}
    in_use = {drive.session.robot_id for drive in drives}
    rows = Robot.objects.filter(practice=False).select_related("floor_plan").order_by("title")
    return [
        robot
        for robot in rows.defer("floor_plan__image")
        if robot.pk in in_use or (kind_of(robot) in wanted and may_see(slug, robot))
    ]


def courses_of(slug: str, robots: Sequence[Robot]) -> dict[str, dict[int, dict[str, Any]]]:
    """Return for each robot the course of each version of a study that has one, as maps draw it."""
    courses: dict[str, dict[int, dict[str, Any]]] = {robot.name: {} for robot in robots}
    for row in Study.objects.filter(slug=slug):
        study = row.as_definition()
        for robot in robots:
            if drawn := _drawn(study, robot):
                courses[robot.name][row.version] = drawn
    return courses


def _drawn(study: StudyDefinition, robot: Robot) -> dict[str, Any] | None:
    course = next((one for one in study.courses if (one.robot, one.site) == kind_of(robot)), None)
    if course is None or robot.floor_plan is None:
        return None
    try:
        plan = floorplan.decode(msgspec.json.encode(robot.floor_plan.plan))
        return ground(course, plan, page_language())
    except (floorplan.FloorPlanError, CourseError):
        return None


def page_language() -> str:
    return get_language() or "en"


def condition_title(definition: StudyDefinition, key: str) -> str:
    """Return the title of a condition in the language of the page; its key when it has no title, or
    no longer exists.
    """
    condition = definition.condition(key)
    return (spoken(condition.title, page_language()) if condition is not None else "") or key


def _people(
    slug: str, definitions: dict[Any, StudyDefinition], now: datetime.datetime
) -> list[dict[str, Any]]:
    rows = Participant.objects.filter(study__slug=slug, seen_at__gte=now - RECENT)
    people = list(rows.order_by("-seen_at")[:MOST_PEOPLE])
    visits = StepVisit.objects.filter(participant__in=people)
    places = visits.values_list("participant_id", "visit", "round", "step", "began_at")
    began = {tuple(place): at for *place, at in places}
    return [_person(row, definitions[row.study_id], began, now) for row in people]


def _person(
    row: Participant, definition: StudyDefinition, began: dict[Any, Any], now: datetime.datetime
) -> dict[str, Any]:
    step = next((step for step in definition.steps if step.key == row.step), None)
    since = began.get((row.pk, row.visit, row.round, row.step))
    key = row.conditions[row.round] if row.round < len(row.conditions) else ""
    return {
        "code": row.code,
        "kind": row.kind,
        "status": row.status,
        "step": spoken(step.title, page_language()) if step is not None else row.step,
        "visit": row.visit,
        "condition": condition_title(definition, key),
        "since": (now - since).total_seconds() if since is not None else None,
        "seen": (now - row.seen_at).total_seconds(),
    }


def _queues(robots: list[Robot], slug: str) -> dict[str, list[str]]:
    """Return the codes of the participants who wait for each robot, in order; an empty code for
    visitors who are not in this study.
    """
    rows = Session.objects.filter(robot__in=robots, state=Session.State.WAITING)
    waiting = list(rows.order_by("queued_at").values_list("robot__name", "visitor"))
    visitors = [visitor for _robot, visitor in waiting]
    people = Participant.objects.filter(study__slug=slug, user__in=visitors)
    codes = dict(people.values_list("user_id", "code"))
    queues: dict[str, list[str]] = {robot.name: [] for robot in robots}
    for robot, visitor in waiting:
        queues[robot].append(codes.get(visitor, ""))
    return queues


def _unready(robots: list[Robot], now: datetime.datetime) -> dict[Any, str]:
    """Return in words what each robot lacks for the next visitor; empty if nothing, or if the queue
    is empty.
    """
    found = {}
    for key, scene in store.load_scenes(robots, now).items():
        reason = next((place.not_ready for place in scene.queue if place.not_ready), "")
        found[key] = in_words(reason.removeprefix(f"{terms.START}: ")) if reason else ""
    return found


def _robot(robot: Robot, now: datetime.datetime) -> dict[str, Any]:
    report, seen_at = robot.presence.report or {}, robot.presence.last_seen_at
    return {
        "name": robot.name,
        "title": robot.shown_title,
        "online": robot.is_online(now),
        "heard": (now - seen_at).total_seconds() if seen_at else None,
        "pose": report.get("pose"),
        "stamp": report.get("stamp"),
        "battery": report.get("battery"),
        "docked": report.get("docked"),
        "estop": (report.get("safety") or {}).get("estop", False),
        "turnaround": robot.presence.turnaround if robot.returns_home else Robot.Turnaround.READY,
        "reason": in_words(robot.presence.turnaround_reason),
        "held": robot.held,
        "doors": _doors(robot, now),
    }


def _doors(robot: Robot, now: datetime.datetime) -> list[dict[str, Any]]:
    """Return each door as it was set, and as the robot last reported it, with its stamp."""
    doors = robot.doors_in(page_language())
    if not doors:
        return []
    rows = SessionEvent.objects.filter(session__robot=robot, source=SessionEvent.Source.ROBOT)
    since = (now - DOORS_BACK).timestamp()
    changes = rows.filter(type="door_changed", received_at__gte=since).order_by("received_at")
    unknown: dict[str, Any] = {"confirmed": None, "at": None}
    found = {
        door["name"]: {"name": door["name"], "title": door["title"], "set": door["state"]} | unknown
        for door in doors
    }
    for data, at in changes.values_list("data", "received_at"):
        name, _, state = str(data.get("detail", "")).rpartition(" ")
        if name in found:
            found[name] |= {"confirmed": state, "at": at}
    return list(found.values())


def _drive(drive: Drive, definition: StudyDefinition, now: datetime.datetime) -> dict[str, Any]:
    session = drive.session
    chunk, fixed = newest_chunk(session), terms.of(session)
    state = chunk.states[-1] if chunk is not None and chunk.states else None
    sample = NetworkSample.objects.filter(session=session).order_by("-received_at").first()
    errors = SessionEvent.objects.filter(session=session, type="script_error")
    return {
        "session": str(session.pk),
        "robot": session.robot.name,
        "code": drive.participant.code,
        "kind": drive.participant.kind,
        "number": drive.number,
        "version": definition.version,
        "condition": condition_title(definition, drive.condition),
        "state": session.state,
        "granted": drive.granted_at.timestamp(),
        "pose": state["pose"] if state else None,
        "stamp": state["stamp"] if state else None,
        "speed": state["velocity"]["linear"] if state else None,
        "heard": now.timestamp() - chunk.received_at if chunk is not None else None,
        "network": _network(sample, now),
        "script_errors": errors.count(),
        "doors": fixed.doors,
        "task": _task(drive, definition, now),
        "wizard": _wizard(session, now) if fixed.driver == "wizard" else None,
    }


def _wizard(session: Session, now: datetime.datetime) -> dict[str, Any]:
    """Return whether a hidden operator is present, absent or `lost`, and the newest step of the
    script with its age in seconds.
    """
    rows = SessionEvent.objects.filter(session=session, source=SessionEvent.Source.SERVER)
    newest = rows.order_by("-stamp").values_list("type", "stamp", "data")
    presence = newest.filter(type__in=(wizards.TOOK, wizards.LEFT, wizards.LOST)).first()
    _type, stamp, step = newest.filter(type=wizards.STEP).first() or ("", None, dict[str, Any]())
    lost = presence is not None and presence[0] == wizards.LOST
    return {
        "status": "there" if wizards.operator_of(session) else "lost" if lost else "absent",
        "step": step.get("step", ""),
        "deviation": step.get("deviation", ""),
        "age": now.timestamp() - stamp if stamp is not None else None,
    }


def _network(sample: NetworkSample | None, now: datetime.datetime) -> dict[str, Any] | None:
    if sample is None:
        return None
    figures = {name: sample.data.get(name) for name in ("roundTrip", "loss", "fps", "way", "path")}
    return {**figures, "age": now.timestamp() - sample.received_at}


def _task(
    drive: Drive, definition: StudyDefinition, now: datetime.datetime
) -> dict[str, Any] | None:
    """Return how far the task is, by the engine's events; None on a step without one."""
    task = definition.task
    if task is None or drive.step != task.key:
        return None
    rows = TaskEvent.objects.filter(drive=drive).order_by("number")
    events = list(rows.values_list("type", "stamp", "data"))
    started = next((stamp for kind, stamp, _ in events if kind == "task_started"), None)
    cue = next((data for kind, _, data in reversed(events) if kind == "cue"), dict[str, Any]())
    left = None if started is None else 60.0 * task.minutes - (now.timestamp() - started)
    condition = definition.condition(drive.condition)
    course = definition.course_of(condition) if condition is not None else None
    return {
        "cue": cue.get("name", ""),
        "number": cue.get("number"),
        "passed": [data.get("number") for kind, _, data in events if kind == "checkpoint"],
        "checkpoints": len(course.checkpoints) - 1 if course is not None else 0,
        "remaining": None if left is None else max(0.0, left),
    }
