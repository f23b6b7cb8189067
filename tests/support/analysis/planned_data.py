"""A dataset of a study with a plan, its sessions measured: task times and answers as they are
given, a participant a value, half of them in each condition.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.milestones import Milestones
from experiments.analysis.metrics.sessions import Measured
from experiments.dataset.records import (
    Dataset,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from tests.support.analysis.planned import planned_study
from tests.support.analysis.study_dataset import questionnaires


def planned_data(
    plan: dict[str, Any] | None, times: dict[str, Sequence[float]], **more: Any
) -> tuple[Dataset, list[Measured]]:
    """Participants by condition with their task times."""
    sessions, measured, people, responses = [], [], [], []
    for condition, values in times.items():
        for n, value in enumerate(values):
            who = f"{condition}{n:02d}"
            people.append(ParticipantRecord(who, cell=condition, age=20.0 + n, finished=True))
            one = SessionRecord(f"s-{who}", who, "giraff", condition=condition, outcome="completed")
            one = replace(one, first_motion=1.0)
            sessions.append(one)
            numbers = {column.name: math.nan for column in METRICS} | {"task_time": value}
            measured.append(Measured(one, Milestones(), numbers, (), np.empty((0, 2))))
            said = {"q1": n % 3}
            responses.append(ResponseRecord(f"r-{who}", "experience", who, said, session=one.id))
    return (
        Dataset(
            planned_study(plan),
            participants=tuple(people),
            sessions=tuple(sessions),
            responses=tuple(responses),
            questionnaires=questionnaires("experience"),
            **more,
        ),
        measured,
    )
