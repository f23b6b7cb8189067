"""The dataset of the planted study as bots make it, without a site: their opinions and their pace,
in made-up drives.
"""

import datetime
from pathlib import Path
from typing import Any

import numpy as np

from experiments.analysis.metrics.sessions import measure_all
from experiments.bots.answers import Answering
from experiments.bots.page import FormChoice, FormField
from experiments.bots.persona import Persona
from experiments.dataset.columns import Columns
from experiments.dataset.files import as_csv, table_path
from experiments.dataset.folder import put, write
from experiments.dataset.records import (
    Dataset,
    EventRecord,
    PageRecord,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from experiments.dataset.states import NO_NETWORK, NO_STATES
from experiments.definition.schema import Condition, StudyDefinition
from experiments.export.formats.dataset import METRIC_TABLE, metric_row
from experiments.participation.assignment import cells
from robots.world.sites import load_plan
from surveys.definition import Definition
from surveys.item import Viewing
from tests.support.analysis.planted_effects.study import (
    ASKED,
    effects,
    planted_questionnaires,
    planted_study,
)
from tests.support.analysis.study_dataset import ROBOTS, drive, link, registration

NOW = datetime.datetime(2026, 5, 1, tzinfo=datetime.UTC)
FASTEST = 0.4  # m/s
SEED = 5


def planted_dataset(participants: int = 24, seed: int = SEED) -> Dataset:
    """Every order of the conditions as often; each participant drives and answers four times."""
    study, asked = planted_study(), {one.slug: one for one in planted_questionnaires()}
    plan, _ = load_plan("office")
    orders, rng = cells(study), np.random.default_rng(seed)
    people, sessions, events, pages, responses = [], [], [], [], []
    states: dict[str, Columns] = {}
    network: dict[str, Columns] = {}
    for number in range(participants):
        persona, who = Persona(number, seed, effects()), f"P{number:03d}"
        order = orders[number % len(orders)]
        age = float(NOW.year - persona.birth_year)
        people.append(
            ParticipantRecord(who, age=age, cell=order.key, reached="thanks", finished=True)
        )
        pages += [PageRecord(who, one.key, seconds=30.0) for one in study.steps]
        responses.append(registration(who, rng))
        for place, key in enumerate(order.conditions, start=1):
            condition = study.condition(key)
            assert condition is not None
            seen = circumstances(condition, place)
            session, record, reached = _drive(study, condition, who, place, persona.pace(seen), rng)
            sessions.append(session)
            events += reached
            states[session.id] = record.states
            network[session.id] = link(record.end, rng)
            responses += [_answers(asked[slug], persona, seen, who, session) for slug in ASKED]
    return Dataset(
        study,
        ROBOTS[:1],
        tuple(people),
        tuple(sessions),
        tuple(events),
        tuple(pages),
        tuple(responses),
        planted_questionnaires(),
        {"office": plan},
        lambda one: states.get(one, NO_STATES),
        lambda one: network.get(one, NO_NETWORK),
    )


def circumstances(condition: Condition, place: int) -> dict[str, str]:
    """What a bot sees of a drive (BotDrive._circumstances)."""
    own = {"robot": condition.robot, "assist": condition.assist, "interface": condition.interface}
    return {**own, "drive": str(place)}


def _drive(
    study: StudyDefinition,
    condition: Condition,
    who: str,
    place: int,
    pace: float,
    rng: np.random.Generator,
) -> tuple[SessionRecord, Any, list[EventRecord]]:
    course = study.course_of(condition)
    assert course is not None
    record = drive(course, rng, speed=FASTEST * pace + rng.normal(0.0, 0.02))
    session = SessionRecord(
        f"{who}-{place}",
        who,
        condition.robot,
        visit=1,
        round=place,
        site=condition.site,
        condition=condition.key,
        outcome="completed",
        os="Linux",
        browser="Firefox",
        control_way=condition.control_way,
        assist=condition.assist,
        network=f"n{who}",
        first_frame=0.4,
        first_motion=5.2,
        ended=record.end + 2.0,
    )
    passed = record.checkpoints.items()
    events = [EventRecord(session.id, at, "task", "checkpoint", {"number": n}) for n, at in passed]
    ends = EventRecord(session.id, record.end, "task", "task_ended", {"name": "completed"})
    docked = EventRecord(session.id, record.end - 2.5, "task", "docked", {})
    return session, record, [*events, docked, ends]


def _answers(
    asked: Definition,
    persona: Persona,
    seen: dict[str, str],
    who: str,
    session: SessionRecord,
) -> ResponseRecord:
    """What a bot answers to the controls that a page shows of each question."""
    bot, values = Answering(persona, seen, NOW), {}
    for question in asked.questions():
        widget = question.item.widget(question, (), Viewing("en", 1, NOW))
        choices = [FormChoice(one.value, one.label) for one in widget.choices]
        kind = "radio" if choices else "number"
        shown = FormField(question.key, kind, attributes=dict(widget.attributes), choices=choices)
        sent = [value for _name, value in bot.answer(shown)]
        values[question.key] = question.item.parse(question, sent, NOW)
    return ResponseRecord(
        f"{session.id}-{asked.slug}",
        asked.slug,
        who,
        values,
        version=asked.version,
        session=session.id,
        seconds=dict.fromkeys(values, 3.0),
    )


def written(dataset: Dataset, folder: Path) -> Path:
    """Write the dataset with the metrics of its sessions, as an export has them."""
    write(dataset, folder)
    rows = [metric_row(one, dataset.study.quality) for one in measure_all(dataset)]
    put((table_path("metrics"), as_csv(METRIC_TABLE, rows)), folder)
    return folder
