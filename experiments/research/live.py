"""Who is where in a study now: what the live view shows, read anew every two seconds with a fixed
number of queries.

Everybody is called by their code. What a robot says is as old as `heard` tells; nothing is made up
for what is not known.
"""

import datetime
from collections.abc import Iterable
from typing import Any

import msgspec

from experiments.definition.course import CourseError
from experiments.definition.schema import StudyDefinition
from experiments.definition.steps.task import TaskStep
from experiments.models import Drive, Participant, StepVisit, Study, TaskEvent
from experiments.participation.drive_config import ground
from experiments.participation.robot_eligibility import is_shown
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


def now_in(slug: str, language: str, now: datetime.datetime) -> dict[str, Any]:
    """Return what happens in all versions of a study: participants, robots, and drives; times in
    Unix seconds, ages in seconds.
    """
    studies = {study.pk: study for study in Study.objects.filter(slug=slug)}
    definitions = {key: study.as_definition() for key, study in studies.items()}
    drives = list(_living(slug))
    robots = _robots(slug, definitions.values(), drives)
    unready = _unready(robots, now)
    return {
        "stamp": now.timestamp(),
        "participants": _people(slug, definitions, language, now),
        "robots": [
            _robot(robot, language, now) | {"unready": unready[robot.pk]} for robot in robots
        ],
        "queues": _queues(robots, slug),
        "drives": [
            _drive(drive, definitions[drive.participant.study_id], language, now)
            for drive in drives
        ],
    }


def _living(slug: str) -> Iterable[Drive]:
    rows = Drive.objects.filter(participant__study__slug=slug).exclude(
        session__state=Session.State.ENDED
    )
    return rows.select_related("session", "session__robot", "participant").order_by("granted_at")


def robots_of(slug: str) -> list[Robot]:
    """Return the robots that a study is driven with."""
    return _robots(slug, [study.as_definition() for study in Study.objects.filter(slug=slug)], ())


def _robots(
    slug: str, definitions: Iterable[StudyDefinition], drives: Iterable[Drive]
) -> list[Robot]:
    """Those of the conditions' series at their sites, and those that are being driven; few, because
    a site has few robots.
    """
    wanted = {
        (condition.robot, condition.site)
        for definition in definitions
        for condition in definition.conditions
    }
    driven = {drive.session.robot_id for drive in drives}
    rows = (
        Robot.objects.filter(practice=False)
        .select_related("floor_plan")
        .defer("floor_plan__image")
        .order_by("title")
    )
    return [
        robot
        for robot in rows
        if robot.pk in driven or (_place(robot) in wanted and is_shown(robot, slug))
    ]


def courses_of(
    slug: str, robots: Iterable[Robot], language: str
) -> dict[str, dict[int, dict[str, Any]]]:
    """Return the course of each robot in each version of a study, as maps draw it; robots and
    versions without one are left out.
    """
    studies = {row.version: row.as_definition() for row in Study.objects.filter(slug=slug)}
    return {
        robot.name: {
            version: drawn
            for version, study in studies.items()
            if (drawn := _drawn(study, robot, language)) is not None
        }
        for robot in robots
    }


def _drawn(study: StudyDefinition, robot: Robot, language: str) -> dict[str, Any] | None:
    course = next((one for one in study.courses if (one.robot, one.site) == _place(robot)), None)
    if course is None or robot.floor_plan is None:
        return None
    try:
        plan = floorplan.decode(msgspec.json.encode(robot.floor_plan.plan))
        return ground(course, plan, language)
    except (floorplan.FloorPlanError, CourseError):
        return None


def _place(robot: Robot) -> tuple[str, str]:
    return (robot.presence.factsheet or {}).get(
        "series", ""
    ), robot.floor_plan.name if robot.floor_plan else ""


def condition_title(definition: StudyDefinition, key: str, language: str) -> str:
    """Return what a condition is called."""
    condition = definition.condition(key)
    return spoken(condition.title, language) if condition is not None else key


# --- people ---------------------------------------------------------------------------------------


def _people(
    slug: str, definitions: dict[Any, StudyDefinition], language: str, now: datetime.datetime
) -> list[dict[str, Any]]:
    rows = list(
        Participant.objects.filter(study__slug=slug, seen_at__gte=now - RECENT).order_by(
            "-seen_at"
        )[:MOST_PEOPLE]
    )
    began = _began(rows)
    return [_person(row, definitions[row.study_id], began, language, now) for row in rows]


def _began(people: list[Participant]) -> dict[tuple[Any, int, int, str], datetime.datetime]:
    rows = StepVisit.objects.filter(participant__in=people).values_list(
        "participant_id", "visit", "round", "step", "began_at"
    )
    return {(person, visit, turn, step): at for person, visit, turn, step, at in rows}


def _person(
    row: Participant,
    definition: StudyDefinition,
    began: dict[Any, datetime.datetime],
    language: str,
    now: datetime.datetime,
) -> dict[str, Any]:
    step = next((step for step in definition.steps if step.key == row.step), None)
    since = began.get((row.pk, row.visit, row.round, row.step))
    return {
        "code": row.code,
        "kind": row.kind,
        "status": row.status,
        "step": spoken(step.title, language) if step is not None else row.step,
        "visit": row.visit,
        "condition": condition_title(definition, row.conditions[row.round], language)
        if row.round < len(row.conditions)
        else "",
        "since": (now - since).total_seconds() if since is not None else None,
        "seen": (now - row.seen_at).total_seconds(),
    }


def _queues(robots: list[Robot], slug: str) -> dict[str, list[str]]:
    """Return who waits for which robot, first come first; who is none of this study's is an empty
    code.
    """
    waiting = list(
        Session.objects.filter(robot__in=robots, state=Session.State.WAITING).order_by("queued_at")
    )
    people = Participant.objects.filter(
        study__slug=slug, user__in=[session.visitor_id for session in waiting]
    )
    codes = dict(people.values_list("user_id", "code"))
    names = {robot.pk: robot.name for robot in robots}
    queues: dict[str, list[str]] = {name: [] for name in names.values()}
    for session in waiting:
        queues[names[session.robot_id]].append(codes.get(session.visitor_id, ""))
    return queues


# --- robots ---------------------------------------------------------------------------------------


def _unready(robots: list[Robot], now: datetime.datetime) -> dict[Any, str]:
    """Return in words what each robot lacks for whoever would be next; empty where it lacks
    nothing, or nobody waits.
    """
    found = {
        key: next((visit.not_ready for visit in scene.queue if visit.not_ready), "")
        for key, scene in store.load_scenes(robots, now).items()
    }
    return {
        key: in_words(reason.removeprefix(f"{terms.START}: ")) if reason else ""
        for key, reason in found.items()
    }


def _robot(robot: Robot, language: str, now: datetime.datetime) -> dict[str, Any]:
    report = robot.presence.report or {}
    return {
        "name": robot.name,
        "title": robot.shown_title,
        "online": robot.is_online(now),
        "heard": (now - robot.presence.last_seen_at).total_seconds()
        if robot.presence.last_seen_at
        else None,
        "pose": report.get("pose"),
        "stamp": report.get("stamp"),
        "battery": report.get("battery"),
        "docked": report.get("docked"),
        "estop": (report.get("safety") or {}).get("estop", False),
        "turnaround": robot.presence.turnaround if robot.returns_home else Robot.Turnaround.READY,
        "reason": in_words(robot.presence.turnaround_reason),
        "held": robot.held,
        "doors": _doors(robot, language, now),
    }


def _doors(robot: Robot, language: str, now: datetime.datetime) -> list[dict[str, Any]]:
    """Return each door as it was set, and as the robot last said it is, with its stamp."""
    doors = robot.doors_in(language)
    if not doors:
        return []
    changed = SessionEvent.objects.filter(
        session__robot=robot, source=SessionEvent.Source.ROBOT, type="door_changed"
    )
    told = (
        changed.filter(received_at__gte=(now - DOORS_BACK).timestamp())
        .order_by("received_at")
        .values_list("data", "received_at")
    )
    confirmed = {
        name: (state, at)
        for data, at in told
        for name, _, state in [str(data.get("detail", "")).rpartition(" ")]
    }
    return [
        {
            "name": door["name"],
            "title": door["title"],
            "set": door["state"],
            "confirmed": confirmed.get(door["name"], (None, None))[0],
            "at": confirmed.get(door["name"], (None, None))[1],
        }
        for door in doors
    ]


# --- drives ---------------------------------------------------------------------------------------


def _drive(
    drive: Drive, definition: StudyDefinition, language: str, now: datetime.datetime
) -> dict[str, Any]:
    session = drive.session
    chunk = newest_chunk(session)
    state = chunk.states[-1] if chunk is not None and chunk.states else None
    sample = NetworkSample.objects.filter(session=session).order_by("-received_at").first()
    fixed = terms.of(session)
    return {
        "session": str(session.pk),
        "robot": session.robot.name,
        "code": drive.participant.code,
        "kind": drive.participant.kind,
        "number": drive.number,
        "version": definition.version,
        "condition": condition_title(definition, drive.condition, language),
        "state": session.state,
        "granted": drive.granted_at.timestamp(),
        "pose": state["pose"] if state else None,
        "stamp": state["stamp"] if state else None,
        "speed": state["velocity"]["linear"] if state else None,
        "heard": now.timestamp() - chunk.received_at if chunk is not None else None,
        "network": _network(sample, now),
        "doors": fixed.doors,
        "task": _task(drive, definition, now),
        "wizard": _wizard(session, now) if fixed.driver == "wizard" else None,
    }


def _wizard(session: Session, now: datetime.datetime) -> dict[str, Any]:
    """Return whether a hidden operator is there, or was and is `lost`, and the newest step of the
    script with its age in seconds.
    """
    told = SessionEvent.objects.filter(session=session, source=SessionEvent.Source.SERVER)
    order = told.order_by("-stamp").values_list("type", "stamp", "data")
    came = order.filter(type__in=(wizards.TOOK, wizards.LEFT, wizards.LOST)).first()
    step = order.filter(type=wizards.STEP).first()
    lost = came is not None and came[0] == wizards.LOST
    return {
        "status": "there" if wizards.operator_of(session) else "lost" if lost else "absent",
        "step": step[2].get("step", "") if step is not None else "",
        "deviation": step[2].get("deviation", "") if step is not None else "",
        "age": now.timestamp() - step[1] if step is not None else None,
    }


def _network(sample: NetworkSample | None, now: datetime.datetime) -> dict[str, Any] | None:
    if sample is None:
        return None
    figures = {name: sample.data.get(name) for name in ("roundTrip", "loss", "fps", "way", "path")}
    return {**figures, "age": now.timestamp() - sample.received_at}


def _task(
    drive: Drive, definition: StudyDefinition, now: datetime.datetime
) -> dict[str, Any] | None:
    """Return how far the task is, from what the engine has told; None on a step without one."""
    task = definition.task
    if task is None or drive.step != task.key:
        return None
    events = list(
        TaskEvent.objects.filter(drive=drive)
        .order_by("number")
        .values_list("type", "stamp", "data")
    )
    started = next((stamp for kind, stamp, _ in events if kind == "task_started"), None)
    cue = next((data for kind, _, data in reversed(events) if kind == "cue"), {})
    return {
        "cue": cue.get("name", ""),
        "number": cue.get("number"),
        "passed": [data.get("number") for kind, _, data in events if kind == "checkpoint"],
        "checkpoints": _count(definition, drive),
        "remaining": None
        if started is None
        else max(0.0, _limit(task) - (now.timestamp() - started)),
    }


def _limit(task: TaskStep) -> float:
    return task.minutes * 60.0


def _count(definition: StudyDefinition, drive: Drive) -> int:
    condition = definition.condition(drive.condition)
    course = definition.course_of(condition) if condition is not None else None
    return len(course.checkpoints) - 1 if course is not None else 0
