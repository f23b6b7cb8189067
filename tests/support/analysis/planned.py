"""A small study with a plan: two conditions, a questionnaire, and hypotheses about both."""

from typing import Any

import msgspec

from experiments.definition.schema import StudyDefinition
from tests.support.studies.studies import STUDY

ANALYSES = [
    {
        "key": "driving",
        "title": {"en": "Driving"},
        "measures": ["task_time", "stops"],
        "contrasts": [{"title": {"en": "shut - open"}, "first": ["shut"], "second": ["all_open"]}],
    },
    {
        "key": "answers",
        "title": {"en": "Answers"},
        "measures": ["experience.q1"],
        "test": "ranks",
        "contrasts": [{"title": {"en": "shut - open"}, "first": ["shut"], "second": ["all_open"]}],
    },
]
PLAN = {
    "question": "Does a closed door matter?",
    "hypotheses": [
        {
            "key": "h1",
            "text": "A closed door takes time.",
            "direction": "greater",
            "analysis": "driving",
            "measures": ["task_time"],
        }
    ],
    "participants": 20,
}


def planned_study(plan: dict[str, Any] | None, **changes: Any) -> StudyDefinition:
    """The cabin's study with declared analyses and a plan; fields of its JSON replaced."""
    return msgspec.convert(
        {**STUDY, "analyses": ANALYSES, "plan": plan, **changes}, StudyDefinition
    )


def plan_with(**changes: Any) -> dict[str, Any]:
    """The plan, with fields replaced."""
    return {**PLAN, **changes}


def hypothesis(**changes: Any) -> dict[str, Any]:
    """The plan's hypothesis, with fields replaced."""
    return {**PLAN["hypotheses"][0], **changes}
