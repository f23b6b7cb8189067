"""A dataset of a study with a plan, its sessions measured: task times and answers as they are
given, a participant a value, half of them in each condition.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from experiments.analysis.metrics.sessions import Measured
from experiments.dataset.records import (
    Dataset,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from tests.support.analysis.planned import planned_study
from tests.support.analysis.study_dataset import questionnaires
from tests.support.analysis.tables import measured


def planned_data(
    plan: dict[str, Any] | None, times: dict[str, Sequence[float]], **more: Any
) -> tuple[Dataset, list[Measured]]:
    """Participants by condition with their task times."""
    sessions, drives, people, responses = [], [], [], []
    for condition, values in times.items():
        for n, value in enumerate(values):
            who = f"{condition}{n:02d}"
            people.append(ParticipantRecord(who, cell=condition, age=20.0 + n, finished=True))
            one = SessionRecord(f"s-{who}", who, "giraff", condition=condition, outcome="completed")
            one = replace(one, first_motion=1.0)
            sessions.append(one)
            drives.append(measured(one, task_time=value))
            answers = {"q1": n % 3}
            responses.append(ResponseRecord(f"r-{who}", "experience", who, answers, session=one.id))
    return (
        Dataset(
            planned_study(plan),
            participants=tuple(people),
            sessions=tuple(sessions),
            responses=tuple(responses),
            questionnaires=questionnaires("experience"),
            **more,
        ),
        drives,
    )
