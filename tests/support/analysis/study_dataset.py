"""A made-up study: participants who drive the shipped course, with everything that a record has.
The generator is the argument's.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

import surveys
from experiments.dataset.columns import Columns, columns_of
from experiments.dataset.records import (
    Dataset,
    EventRecord,
    PageRecord,
    ParticipantRecord,
    ResponseRecord,
    RobotRecord,
    SessionRecord,
)
from experiments.dataset.states import NETWORK, NO_NETWORK, NO_STATES, SERIES, STATES
from experiments.definition.schema import Course, StudyDefinition
from experiments.definition.shipped import shipped
from robots.world.sites import load_plan
from sessions.leases.fault_side import SessionEnd, fault_of
from surveys.definition import Definition
from surveys.problems import parse

DEFINITIONS = Path(surveys.__file__).parent / "definitions"
RATE = 4.0
NETWORKS = 51
FAILURES = ("timed_out", "connection_refused", "cancelled", "stopped_by_operator")
FAILURES += ("robot_fault", "connection_lost")
DEVICES = (
    *(("Windows", "Chrome"), ("Windows", "Firefox"), ("Linux", "Chromium"), ("Mac OS", "Chrome")),
    *(("Android", "Chrome"), ("iOS", "other"), ("other", "Opera")),
)
# The columns of a state that are 0 in every drive.
ABSENT = (
    *("boot", "tilt", "mode", "angular", "distance_by_position", "refused", "too_old", "slowed"),
    *("by_mouse", "by_touch", "by_stick", "by_gamepad", "by_map", "by_script", "on_mqtt"),
)
FACTS = {
    "giraff": {"Base": "Giraff", "OS": "Windows", "RCA": "MOOS", "Users": "novice"},
    "rhodon": {"Base": "PatrolBot", "OS": "Linux", "RCA": "ROS", "Users": "expert"},
}
ROBOTS = tuple(
    RobotRecord(name=name, title=name.title(), series=name, facts=facts)
    for name, facts in FACTS.items()
)


@dataclass(frozen=True)
class Driven:
    """The states of a drive, and when it came how far."""

    states: Columns
    checkpoints: dict[int, float]
    end: float


def questionnaires(*names: str) -> tuple[Definition, ...]:
    return tuple(parse((DEFINITIONS / f"{name}.json").read_bytes()) for name in names)


def along(path: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions and headings at distances along a polyline (n, 2)."""
    steps = np.hypot(*np.diff(path, axis=0).T)
    reached = np.concatenate(([0.0], np.cumsum(steps)))
    x, y = (np.interp(at, reached, path[:, axis]) for axis in (0, 1))
    leg = np.clip(np.searchsorted(reached, at, side="right") - 1, 0, len(steps) - 1)
    heading = np.arctan2(*(np.diff(path, axis=0)[leg].T[::-1]))
    return x, y, heading


def drive(
    course: Course,
    rng: np.random.Generator,
    *,
    speed: float = 0.3,
    share: float = 1.0,
    offset: float = 0.02,
    trip: float = 0.05,
) -> Driven:
    """A drive along the course's suggested path, of which a share is driven; the first motion is
    after 5 s.
    """
    stops = course.checkpoints
    path = np.array(course.path or [(stop.x, stop.y) for stop in (*stops, stops[0])])
    length = float(np.hypot(*np.diff(path, axis=0).T).sum()) * share
    seconds = 5.0 + length / speed + 3.0
    t = np.arange(0.0, seconds, 1.0 / RATE)
    travelled = np.clip((t - 5.0) * speed, 0.0, length)
    x, y, heading = along(path, travelled)
    amplitude, period = rng.normal(0.0, 0.06, 2), rng.uniform(6.0, 14.0, 2)
    wiggle = amplitude * np.sin(t[:, None] / period) * (travelled > 0.0)[:, None]
    x, y = x + wiggle[:, 0], y + wiggle[:, 1]
    going = (travelled > 0.0) & (travelled < length)
    commands = np.where(going, rng.integers(3, 6, len(t)), 0)
    ages = rng.gamma(4.0, trip / 8.0, len(t))
    states = columns_of(
        STATES,
        stamp=t + offset,
        received=t + trip,
        clock_offset=np.full(len(t), offset),
        seq=np.arange(len(t)),
        x=x,
        y=y,
        theta=heading,
        localized=np.ones(len(t)),
        score=np.full(len(t), 0.9),
        linear=np.where(going, speed, 0.0),
        charge=np.linspace(0.9, 0.8, len(t)),
        charging=(t < 5.0) * 1.0,
        docked=((t < 5.0) | ((travelled >= length) & (share >= 1.0))) * 1.0,
        clearance=np.clip(rng.normal(0.6, 0.25, len(t)), 0.02, 3.0),
        contacts=(rng.random(len(t)) < 0.002) * 1.0,
        distance=np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y))))),
        visitor_silence=np.full(len(t), 0.1),
        commands=commands,
        age_sum=commands * ages,
        age_max=ages * 1.5,
        answer_age=np.where(commands > 0, ages + 0.125, np.nan),
        by_keyboard=commands,
        on_datachannel=commands,
        **dict.fromkeys(ABSENT, 0),
        **{
            f"{name}_{part}": np.where(commands > 0, value, np.nan)
            for name in SERIES
            for part, value in (("linear", speed), ("angular", 0.0))
        },
    )
    passed: dict[int, float] = {}
    for stop in stops[1:]:
        near = np.hypot(x - stop.x, y - stop.y) < stop.radius + 0.25
        near &= t > max(passed.values(), default=0.0)
        if len(passed) == stop.number - 1 and near.any():
            passed[stop.number] = float(t[near.argmax()])
    return Driven(states, passed, float(t[-1]))


def made_up(
    rng: np.random.Generator,
    participants: int = 12,
    *,
    study: StudyDefinition | None = None,
    slower: float = 1.0,
) -> Dataset:
    """A study with every kind of ending, answer and device in it; about two sessions a participant.
    `slower` divides the last condition's speed.
    """
    study = study or shipped()["exploration"]
    plan, _ = load_plan("office")
    people, sessions, events, pages, responses = [], [], [], [], []
    states: dict[str, Columns] = {}
    network: dict[str, Columns] = {}
    for index in range(participants):
        who = f"P{index:03d}"
        condition = study.conditions[index % len(study.conditions)]
        dropped = index % 11 == 10
        age = float("nan") if index % 12 == 11 else float(rng.integers(15, 63))
        if dropped:
            people.append(ParticipantRecord(who, age=age, reached="consent", left="declined"))
            pages.append(PageRecord(who, study.steps[0].key, seconds=float("nan"), finished=False))
            continue
        reached = {"cell": condition.key, "reached": "thanks", "finished": True}
        people.append(ParticipantRecord(who, age=age, **reached))
        seconds = rng.gamma(4.0, 10.0, len(study.steps)).tolist()
        pages += [
            PageRecord(who, step.key, seconds=one, finished=True)
            for step, one in zip(study.steps, seconds, strict=True)
        ]
        responses.append(registration(who, rng))
        for number in range(1, 2 + int(rng.integers(0, 3))):
            factor = slower if condition is study.conditions[-1] else 1.0
            session, record, more = session_of(
                study, who, number, condition.key, rng, slower=factor
            )
            sessions.append(session)
            events += more
            if record is not None:
                states[session.id] = record.states
                network[session.id] = link(record.end, rng)
            responses.append(final(study, who, session, rng))
    questions = questionnaires("experience", "ict")
    rows = (people, sessions, events, pages, responses)
    return Dataset(
        study,
        ROBOTS,
        *map(tuple, rows),
        questions,
        {"office": plan},
        lambda one: states.get(one, NO_STATES),
        lambda one: network.get(one, NO_NETWORK),
    )


def session_of(
    study: StudyDefinition,
    who: str,
    number: int,
    key: str,
    rng: np.random.Generator,
    *,
    slower: float,
) -> tuple[SessionRecord, Driven | None, list[EventRecord]]:
    condition = study.condition(key)
    assert condition is not None
    course = study.course_of(condition)
    assert course is not None
    outcome = "completed" if rng.random() < 0.85 else str(rng.choice(FAILURES))
    system, browser = DEVICES[int(rng.integers(len(DEVICES)))]
    session = SessionRecord(
        f"{who}-{number}",
        who,
        condition.robot,
        number=number,
        site=condition.site,
        condition=key,
        outcome=outcome,
        os=system,
        browser=browser,
        control_way=condition.control_way,
        assist=condition.assist,
        network=f"n{int(rng.integers(NETWORKS))}",
        operator=outcome == "stopped_by_operator",
        fault_side=fault_of(SessionEnd(outcome, "", begun_at=0.0, ended_at=60.0)).side,
    )
    if outcome == "connection_refused":
        return session, None, []
    share = 1.0 if outcome == "completed" else float(rng.uniform(0.2, 0.9))
    speed = float(rng.normal(0.32 + 0.02 * number, 0.03)) / slower
    record = drive(course, rng, speed=speed, share=share)
    session = replace(session, first_frame=0.4, first_motion=5.2, ended=record.end + 2.0)
    events = [
        EventRecord(session.id, at, "task", "checkpoint", {"number": n})
        for n, at in record.checkpoints.items()
    ]
    if outcome == "completed":
        events.append(EventRecord(session.id, record.end - 2.5, "task", "docked", {}))
    events.append(EventRecord(session.id, record.end, "task", "task_ended", {"name": outcome}))
    return session, record, events


def link(seconds: float, rng: np.random.Generator) -> Columns:
    t = np.arange(0.0, seconds, 1.0)
    trips = rng.gamma(3.0, float(rng.choice((0.01, 0.03, 0.08))), len(t))
    return columns_of(
        NETWORK,
        stamp=t,
        round_trip=trips,
        loss=(rng.random(len(t)) < 0.02) * 0.05,
        fps=rng.normal(28.0, 1.0, len(t)),
        bitrate=np.full(len(t), 8e5),
        freezes=(rng.random(len(t)) < 0.003) * 1.0,
        jitter=np.full(len(t), 0.004),
        frame_age=trips / 2.0 + 0.05,
        on_datachannel=np.ones(len(t)),
    )


def registration(who: str, rng: np.random.Generator) -> ResponseRecord:
    scale = ("computer", "smartphone", "browser", "messaging", "videoconferencing", "games")
    values = {"gender": str(rng.choice(("woman", "man"), p=(0.2, 0.8)))}
    values |= {key: int(rng.integers(0, 5)) for key in scale}
    return ResponseRecord(f"{who}-ict", "ict", who, values)


def final(
    study: StudyDefinition, who: str, session: SessionRecord, rng: np.random.Generator
) -> ResponseRecord:
    values = {
        f"q{n}": int(np.clip(round(rng.normal(1.2 if n != 7 else 0.6, 0.8)), -2, 2))
        for n in range(1, 9)
    }
    missing = {}
    if session.robot != "giraff" or rng.random() < 0.1:
        missing["q7"] = "not_asked" if session.robot != "giraff" else "skipped"
        del values["q7"]
    about = {"session": session.id, "missing": missing, "seconds": dict.fromkeys(values, 3.5)}
    return ResponseRecord(f"{session.id}-q", study.analysis.statements, who, values, **about)


def without(definition: Definition, key: str) -> Definition:
    """A questionnaire that lacks one statement."""
    pages = tuple(
        msgspec.structs.replace(page, items=tuple(item for item in page.items if item.key != key))
        for page in definition.pages
    )
    return msgspec.structs.replace(definition, pages=pages)
