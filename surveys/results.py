"""The table of a Likert questionnaire: overall, its topics, its statements, in this order."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from surveys.definition import Definition, spoken
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
    statements = [question for question in definition.questions() if question.points]
    scale = [point.value for point in statements[0].points]
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
