"""Answers as tables: with a line a response, and, of a Likert questionnaire, with a line for
overall, its topics and its statements, in this order.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from surveys.definition import Definition
from surveys.documents import spoken
from surveys.item import Question
from surveys.likert import Answers, Interval, Summary, summarise


@dataclass(frozen=True)
class Line:
    """A row of the table. `key` is empty for the overall row; `statements` are the keys that it
    pools.
    """

    kind: Literal["overall", "topic", "statement"]
    key: str
    label: str
    statements: tuple[str, ...]
    summary: Summary


def likert_table(
    definition: Definition,
    responses: Sequence[Answers],
    *,
    language: str,
    interval: Interval,
    overall: str,
) -> list[Line]:
    """Return the rows of the table.

    Args:
        definition: a questionnaire whose scoring is `likert`.
        responses: a mapping a respondent, from statement to value; None or no entry is a missing
            answer.
        language: of the labels.
        interval: `normal` as the paper, `t` for new studies.
        overall: the label of the first row.

    Raises:
        ValueError: when the questionnaire has no statements on one scale.
    """
    if definition.scoring != "likert":
        raise ValueError(f"{definition.slug} is not scored as statements on one scale")
    statements = definition.scored
    scale = list(statements[0].score_values)
    neutral = (scale[0] + scale[-1]) / 2.0
    rows: list[tuple[Literal["overall", "topic", "statement"], str, str, tuple[str, ...]]] = [
        ("overall", "", overall, tuple(question.key for question in statements)),
        *(
            ("topic", topic.key, spoken(topic.text, language), topic.items)
            for topic in definition.topics
        ),
        *(
            ("statement", question.key, spoken(question.text, language), (question.key,))
            for question in statements
        ),
    ]
    return [
        Line(
            kind,
            key,
            label,
            keys,
            summarise(responses, keys, scale, interval=interval, neutral=neutral),
        )
        for kind, key, label, keys in rows
    ]


def columns_of(versions: Sequence[Definition]) -> list[str]:
    """Return the columns of a table with a line a response to any version of a questionnaire: those
    of each question's type, and why there is no answer.
    """
    named: dict[str, dict[str, None]] = {}
    for definition in versions:
        for question in definition.questions():
            columns = named.setdefault(question.key, {})
            columns |= dict.fromkeys(question.item.columns(question.key))
    return [column for key, columns in named.items() for column in (*columns, f"{key}_missing")]


def cells_of(
    questions: Mapping[str, Question], values: Mapping[str, Any], missing: Mapping[str, str]
) -> dict[str, Any]:
    """Return the cells of a response by their columns.

    Args:
        questions: what may have been asked, by key.
        values: stored values by key; None or no entry is no answer.
        missing: why there is none, by key.
    """
    cells: dict[str, Any] = {}
    for key, question in questions.items():
        item = question.item
        cells |= zip(item.columns(key), item.cells(values.get(key)), strict=True)
        cells[f"{key}_missing"] = missing.get(key, "")
    return cells
