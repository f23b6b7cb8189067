"""Which questions a respondent is asked: `show_if`, decided from the robot, the outcome, and
earlier answers. A hidden question counts as unanswered for those that depend on it.

static/js/pages/survey/conditions.js decides the same within a page;
tests/golden/survey_conditions.json binds the two.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from surveys.definition import Definition
from surveys.item import ItemCondition


@dataclass(frozen=True)
class Circumstances:
    """What conditions compare beside answers. A robot has several names, such as its series."""

    robot: frozenset[str] = frozenset()
    outcome: str = ""

    def fit(self, condition: ItemCondition) -> bool:
        if condition.robot and not self.robot.intersection(condition.robot):
            return False
        return not condition.outcome or self.outcome in condition.outcome


def shown_keys(
    definition: Definition, values: Mapping[str, Any], circumstances: Circumstances
) -> list[str]:
    """Return the keys of the questions asked, as written; no entry in `values` is no answer."""
    shown: list[str] = []
    answers: dict[str, Any] = {}  # to the questions shown, as conditions compare them
    for question in definition.questions():
        found = (definition.pages[question.page].show_if, question.item.show_if)
        conditions = [one for one in found if one is not None]
        if all(circumstances.fit(one) and _answer_fits(one, answers) for one in conditions):
            shown.append(question.key)
            if (value := values.get(question.key)) is not None:
                answers[question.key] = question.item.compared(value)
    return shown


def _answer_fits(condition: ItemCondition, answers: Mapping[str, Any]) -> bool:
    if not condition.item or condition.item not in answers:
        return not condition.item
    value = answers[condition.item]
    if condition.one_of:
        chosen = value if isinstance(value, list) else [value]
        return any(one in condition.one_of for one in chosen)
    # only numbers have conditions with bounds (surveys/problems.py)
    above = condition.at_least is None or value >= condition.at_least
    return above and (condition.at_most is None or value <= condition.at_most)
