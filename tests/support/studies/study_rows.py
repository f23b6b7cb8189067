"""A made-up study (tests/support/analysis/study_dataset.py) put into the database, as participants,
robots and the session manager leave it there.
"""

import datetime
import uuid
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import msgspec
import numpy as np

from accounts.models import User
from experiments.dataset.columns import Columns
from experiments.dataset.levels import METHODS, MODES, WAYS
from experiments.dataset.records import Dataset, SessionRecord
from experiments.definition.schema import digest
from experiments.models import Drive, Participant, StepResponse, StepVisit, Study, TaskEvent
from robots.api import floorplan
from robots.models import FloorPlan, Robot
from sessions.models import NetworkSample, Session, StateChunk
from surveys.models import Answer, Questionnaire as QuestionnaireRow, Response
from tests.support.robots import create_robot, floor_plan
from tests.support.sessions import replays
from tests.support.sessions.rows import session_row, unsaved_chunk

BEGUN = datetime.datetime(2026, 5, 4, 9, 0, tzinfo=datetime.UTC)
MINUTE = datetime.timedelta(minutes=1)
WEEK = datetime.timedelta(weeks=1)  # from publishing to the first participant
AGENT = "Mozilla/5.0 (secret agent of nobody)"


@dataclass
class Stored:
    """A study's rows, and the keys of the sessions by their names in the dataset."""

    study: Study
    people: dict[str, Participant] = field(default_factory=dict)
    drives: dict[str, Drive] = field(default_factory=dict)


def put(dataset: Dataset, *, now: datetime.datetime = BEGUN) -> Stored:
    """Store a dataset; sessions of a participant are visits one after the other."""
    whole = dataset.study
    study = replays.study(
        slug=whole.slug,
        version=whole.version,
        title="Study",
        secret="5e" * 32,
        definition=msgspec.to_builtins(whole),
        sha256=digest(whole),
        status=Study.Status.PUBLISHED,
        created_at=now,
        published_at=now - WEEK,
    )
    stored = Stored(study)
    robots = _robots(dataset)
    questionnaires = {one.slug: _questionnaire(one, now) for one in dataset.questionnaires}
    for index, person in enumerate(dataset.participants):
        stored.people[person.id] = _participant(stored.study, person, now + index * MINUTE)
    for session in dataset.sessions:
        stored.drives[session.id] = _drive(dataset, session, stored, robots[session.robot])
    TaskEvent.objects.bulk_create(_task_events(dataset, stored))
    StepVisit.objects.bulk_create(_visits(dataset, stored, now))
    for response in dataset.responses:
        _response(dataset, response, stored, questionnaires[response.questionnaire])
    return stored


def _robots(dataset: Dataset) -> dict[str, Robot]:
    found = {}
    for name, plan in dataset.plans.items():
        floor_plan(name, title=name, plan=msgspec.json.decode(floorplan.encode(plan)))
    for robot in dataset.robots:
        sheet = {"series": robot.series, "rca": robot.facts["RCA"]}
        sheet |= {"capabilities": ["velocity", "dock"]}
        sheet |= {"limits": {"linear": 0.6, "angular": 0.7}}
        place = {"floor_plan": FloorPlan.objects.first(), "factsheet": sheet}
        found[robot.name] = create_robot(name=robot.name, title=robot.title, **place)
    return found


def _questionnaire(definition, now: datetime.datetime) -> QuestionnaireRow:
    slug = definition.slug
    about = {"slug": slug, "version": definition.version, "title": slug, "sha256": ""}
    written = msgspec.to_builtins(definition)
    return QuestionnaireRow.objects.create(
        definition=written, created_at=now, frozen_at=now, **about
    )


def _participant(study: Study, person, now: datetime.datetime) -> Participant:
    email = f"{person.id}@example.org".lower()
    user = User.objects.create(username=f"name-of-{person.id}", email=email)
    status, completion = Participant.Status.ACTIVE, ""
    if person.finished:
        status, completion = Participant.Status.FINISHED, "done"
    elif person.left:
        status, completion = Participant.Status.SCREENED_OUT, "screened_out"
    return replays.participant(
        study,
        user,
        kind=person.kind,
        cell=person.cell,
        code=person.id,
        step=person.reached,
        conditions=[],
        status=status,
        completion=completion,
        created_at=now,
        seen_at=now,
        age=None if np.isnan(person.age) else int(person.age),
    )


def _drive(dataset: Dataset, session: SessionRecord, stored: Stored, robot: Robot) -> Drive:
    who = stored.people[session.participant]
    granted = who.created_at + session.number * 30 * MINUTE
    network = session.network and f"10.0.{session.network[1:]}.0/24"
    device = {"os": session.os, "browser": session.browser, "network": network, "user_agent": AGENT}
    times = {"queued_at": granted - MINUTE, "granted_at": granted}
    times |= {"first_motion_at": _at(granted, session.first_motion)}
    times |= {"ended_at": _at(granted, session.ended), "closed_at": granted + 20 * MINUTE}
    about = {"state": Session.State.ENDED, "live_key": str(uuid.uuid4()), "device": device}
    about |= {"outcome": session.outcome, "summary": {"missing": session.missing}}
    row = session_row(robot, who.user, **about, **times)
    first = None if np.isnan(session.first_frame) else granted.timestamp() + session.first_frame
    drive = replays.drive(
        who,
        row,
        visit=session.number,
        number=session.number,
        condition=session.condition,
        mismatches=[session.mismatch] if session.mismatch else [],
        exposed_at=_at(granted, session.first_frame),
        moved=not np.isnan(session.first_motion),
        outcome=session.outcome,
        result={"started": first},
        settled_at=granted + 21 * MINUTE,
        excluded_reason=session.excluded,
    )
    states, network, at = (
        dataset.states(session.id),
        dataset.network(session.id),
        granted.timestamp(),
    )
    StateChunk.objects.bulk_create(chunks(row, states, at), batch_size=500)
    NetworkSample.objects.bulk_create(samples(row, network, at), batch_size=500)
    if session.operator and session.outcome != "stopped_by_operator":
        at = granted.timestamp() + 9.0
        about = {"type": "operator_message", "source": "server", "stamp": at, "received_at": at}
        row.events.create(data={"text": "Mind the cat, Ada!"}, **about)
    return drive


def _at(granted: datetime.datetime, seconds: float) -> datetime.datetime | None:
    return None if np.isnan(seconds) else granted + datetime.timedelta(seconds=seconds)


def chunks(session: Session, states: Columns, granted: float) -> Iterator[StateChunk]:
    """A session's states as the recorder stores them: a row a second."""
    rows = [_state(states, index, granted) for index in range(len(states))]
    for start in range(0, len(rows), 4):
        part = rows[start : start + 4]
        received, offset = (float(states[name][start]) for name in ("received", "clock_offset"))
        yield unsaved_chunk(session, part, received_at=granted + received, clock_offset=offset)


def _state(states: Columns, index: int, granted: float) -> dict:
    row = dict(zip(states.dtype.names, states[index].tolist(), strict=True))
    methods = [name for name in METHODS for _ in range(int(row[f"by_{name}"]))]
    ways = [name for name in WAYS for _ in range(int(row[f"on_{name}"]))]
    ages = _ages(row["age_sum"], row["age_max"], len(methods))
    applied = [
        {
            "seq": n,
            "stamp": granted + row["stamp"],
            "method": method,
            "way": way,
            "age": age,
            "linear": row["linear"],
            "angular": 0.0,
            "frameAge": None if np.isnan(row["answer_age"]) else row["answer_age"],
            "asked": {"linear": row["asked_linear"], "angular": row["asked_angular"]},
            "allowed": {"linear": row["allowed_linear"], "angular": row["allowed_angular"]},
            "share": 1.0,
        }
        for n, (method, way, age) in enumerate(zip(methods, ways, ages, strict=True))
    ]
    return {
        "stamp": granted + row["stamp"],
        "boot": "boot-1",
        "seq": int(row["seq"]),
        "pose": {"x": row["x"], "y": row["y"], "theta": row["theta"], "score": row["score"]},
        "velocity": {"linear": row["linear"], "angular": row["angular"]},
        "battery": {"charge": row["charge"], "charging": bool(row["charging"])},
        "docked": bool(row["docked"]),
        "tilt": row["tilt"],
        "mode": MODES[int(row["mode"])],
        "clearance": row["clearance"],
        "contacts": int(row["contacts"]),
        "distance": row["distance"],
        "visitorSilence": row["visitor_silence"],
        "applied": applied,
    }


def _ages(total: float, greatest: float, count: int) -> list[float]:
    """As many ages as there are commands, with this sum and this greatest one."""
    if count < 2:
        return [total] * count
    return [greatest, *([(total - greatest) / (count - 1)] * (count - 1))]


def samples(session: Session, network: Columns, granted: float) -> Iterator[NetworkSample]:
    """A session's network samples; the page's clock is an hour wrong, and every sample arrives at
    once.
    """
    names = {"round_trip": "roundTrip", "frame_age": "frameAge"}
    names |= {name: name for name in ("loss", "fps", "bitrate", "freezes", "jitter")}
    for row in network.tolist():
        values = dict(zip(network.dtype.names, row, strict=True))
        data = {name: values[column] for column, name in names.items()} | {"way": "datachannel"}
        at = granted + values["stamp"]
        yield NetworkSample(session=session, stamp=at + 3600.0, received_at=at, data=data)


def _task_events(dataset: Dataset, stored: Stored) -> Iterator[TaskEvent]:
    numbers: Counter[str] = Counter()
    for event in dataset.events:
        drive = stored.drives[event.session]
        about = {"number": numbers[event.session], "type": event.type, "data": dict(event.data)}
        yield TaskEvent(drive=drive, stamp=drive.granted_at.timestamp() + event.stamp, **about)
        numbers[event.session] += 1


def _visits(dataset: Dataset, stored: Stored, now: datetime.datetime) -> Iterator[StepVisit]:
    for page in dataset.pages:
        ended = None if np.isnan(page.seconds) else now + datetime.timedelta(seconds=page.seconds)
        place = {"participant": stored.people[page.participant], "visit": 1, "round": 0}
        yield StepVisit(step=page.step, began_at=now, finished_at=ended, **place)


def _response(dataset: Dataset, response, stored: Stored, questionnaire: QuestionnaireRow) -> None:
    who = stored.people[response.participant]
    asked = {one.questionnaire: one.key for one in reversed(dataset.study.questionnaire_steps)}
    step = asked[response.questionnaire]
    visit, robot, outcome = 1, [], ""
    if response.session:
        drive = stored.drives[response.session]
        visit, robot, outcome = drive.visit, [drive.session.robot.name], drive.outcome
    at = who.created_at + visit * 40 * MINUTE
    row = Response.objects.create(
        questionnaire=questionnaire,
        user=who.user,
        slot=str(uuid.uuid4()),
        context=f"study/{who.pk}/{visit}.0.{step}",
        robot=robot,
        outcome=outcome,
        seed=1,
        language="en",
        started_at=at,
        seen_at=at,
        finished_at=at if response.finished else None,
        reached=9,
    )
    StepResponse.objects.create(response=row, participant=who, visit=visit, round=0, step=step)
    about = {"language": "en", "text_version": "", "first_at": at, "answered_at": at}
    stated = {key: {"value": value} for key, value in response.values.items()}
    stated |= {
        key: {"value": None, "missing": reason}
        for key, reason in response.missing.items()
        if reason != "not_reached"
    }
    Answer.objects.bulk_create(
        Answer(
            response=row, item=key, position=n, seconds=response.seconds.get(key), **one, **about
        )
        for n, (key, one) in enumerate(stated.items())
    )
