"""Which questions somebody is asked: `show_if`, decided from the robot, the outcome, and earlier
answers.

A question that is hidden counts as unanswered for those that depend on it.
static/js/pages/survey/conditions.js says the same for questions on the page in front of the
visitor; tests/golden/survey_conditions.json binds the two.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from surveys.definition import Definition
from surveys.item import ItemCondition


@dataclass(frozen=True)
class Circumstances:
    """What is known beside the answers. A robot may go by several words: its name, its series."""

    robot: frozenset[str] = field(default_factory=frozenset)
    outcome: str = ""


def answer_fits(condition: ItemCondition, value: Any) -> bool:
    """Tell whether an answer, as its type compares it, meets the part of a condition that asks
    one.
    """
    if condition.one_of:
        chosen = value if isinstance(value, list) else [value]
        return any(one in condition.one_of for one in chosen)
    # bounds are asked of numbers alone (surveys/problems.py)
    above = condition.at_least is None or value >= condition.at_least
    return above and (condition.at_most is None or value <= condition.at_most)


def circumstances_fit(condition: ItemCondition, circumstances: Circumstances) -> bool:
    """Tell whether robot and outcome are among those that a condition names."""
    if condition.robot and not circumstances.robot.intersection(condition.robot):
        return False
    return not condition.outcome or circumstances.outcome in condition.outcome


def shown_keys(
    definition: Definition, values: Mapping[str, Any], circumstances: Circumstances
) -> list[str]:
    """Return the keys of the questions that are asked, in written order.

    Args:
        definition: the questionnaire.
        values: answers by key; a key that is not there, or None, is no answer.
        circumstances: robot and outcome.
    """
    shown: dict[str, None] = {}
    for question in definition.questions():
        conditions = (definition.pages[question.page].show_if, question.item.show_if)
        if all(
            _holds(condition, definition, values, shown, circumstances)
            for condition in conditions
            if condition is not None
        ):
            shown[question.key] = None
    return list(shown)


def _holds(
    condition: ItemCondition,
    definition: Definition,
    values: Mapping[str, Any],
    shown: Iterable[str],
    circumstances: Circumstances,
) -> bool:
    if not circumstances_fit(condition, circumstances):
        return False
    if not condition.item:
        return True
    asked, value = definition.question(condition.item), values.get(condition.item)
    if asked is None or condition.item not in shown or value is None:
        return False
    return answer_fits(condition, asked.item.compared(value))
