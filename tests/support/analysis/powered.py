"""Small studies of which the exact power is known."""

from typing import Any

import msgspec

from experiments.definition.schema import StudyDefinition
from tests.support.studies.studies import STUDY


def powered_study(
    conditions: int = 2,
    design: str = "within",
    *,
    first: tuple[int, ...] = (1,),
    second: tuple[int, ...] = (0,),
    **plan: Any,
) -> StudyDefinition:
    """A study that compares two sides of its conditions (by number) in their task time; fields of
    its plan.
    """
    base, steps = STUDY["conditions"][0], STUDY["steps"]
    task = {**steps[0], "repeat": design == "within"}
    return msgspec.convert(
        {
            **STUDY,
            "steps": [task, *steps[1:]],
            "conditions": [{**base, "key": f"c{n}"} for n in range(conditions)],
            "allocation": {"design": design},
            "analyses": [
                {
                    "key": "time",
                    "title": {"en": "Time"},
                    "measures": ["task_time"],
                    "contrasts": [
                        {
                            "title": {"en": "contrast"},
                            "first": [f"c{n}" for n in first],
                            "second": [f"c{n}" for n in second],
                        }
                    ],
                }
            ],
            "plan": plan,
        },
        StudyDefinition,
    )


def expected(condition: int, difference: float, **more: float) -> dict[str, Any]:
    """The expected task time in a condition."""
    about = {"measure": "task_time", "condition": f"c{condition}", "difference": difference}
    return {**about, **more}
