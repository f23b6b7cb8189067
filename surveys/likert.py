"""Summaries of statements on a scale, as the paper's table of results has them. Pure: numbers in,
numbers out.

The unit is the respondent (Melendez-Fernandez et al., 2017, table 5; the definition is ours,
because the text gives none):

- the percentages pool all answers of a row;
- mean, standard deviation (n - 1) and confidence intervals are those of the *respondents'* scores,
  a respondent's score being the mean over the row's statements that they answered;
- the half-width of an interval is c * SD / sqrt(n), with c of the normal distribution ("normal",
  which reproduces the published half-width) or of Student's t with n - 1 degrees of freedom ("t",
  for new studies).
"""

import math
import statistics
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import scipy

from surveys.definition import Definition
from surveys.documents import spoken

Interval = Literal["normal", "t"]
Answers = Mapping[str, int | None]
Kind = Literal["overall", "topic", "statement"]


@dataclass(frozen=True)
class Summary:
    """One row.

    Counts and percentages are in the order of the scale; percentages are None without answers.
    `positive` is the percentage above `neutral`, `nonpositive` the rest. `mean` is None without
    respondents, `sd` and the half-widths below two of them.
    """

    respondents: int
    answers: int
    counts: tuple[int, ...]
    percentages: tuple[float, ...] | None
    mean: float | None
    sd: float | None
    ci95: float | None
    ci99: float | None
    positive: float | None
    nonpositive: float | None


def summarise(
    responses: Sequence[Answers],
    statements: Sequence[str],
    scale: Sequence[int],
    *,
    interval: Interval,
    neutral: float = 0.0,
) -> Summary:
    """Return the row of one or several statements.

    Args:
        responses: a mapping a respondent, from statement to value of the scale; None or no entry is
            a missing answer.
        statements: which of them the row pools.
        scale: the values that there are, rising.
        interval: of which distribution the intervals are.
        neutral: answers above it count as positive.

    Raises:
        ValueError: when an answer is no value of the scale.
    """
    found = [[answers.get(key) for key in statements] for answers in responses]
    given = [[value for value in values if value is not None] for values in found]
    counts = Counter(value for values in given for value in values)
    if outside := sorted(set(counts) - set(scale)):
        raise ValueError(f"answers outside the scale: {outside}")
    scores = [statistics.fmean(values) for values in given if values]
    mean, sd = mean_and_sd(scores)
    total = counts.total()
    above = sum(n for value, n in counts.items() if value > neutral)
    positive = 100.0 * above / total if total else None
    return Summary(
        respondents=len(scores),
        answers=total,
        counts=tuple(counts[value] for value in scale),
        percentages=tuple(100.0 * counts[one] / total for one in scale) if total else None,
        mean=mean,
        sd=sd,
        ci95=half_width(sd, len(scores), 0.95, interval),
        ci99=half_width(sd, len(scores), 0.99, interval),
        positive=positive,
        nonpositive=None if positive is None else 100.0 - positive,
    )


def mean_and_sd(scores: Sequence[float]) -> tuple[float | None, float | None]:
    """Return mean and standard deviation (n - 1) of scores; None where there are too few."""
    mean = statistics.fmean(scores) if scores else None
    return mean, statistics.stdev(scores) if len(scores) > 1 else None


def half_width(sd: float | None, n: int, level: float, interval: Interval) -> float | None:
    """Return the half-width of the confidence interval of a mean; None when `sd` is."""
    if sd is None:
        return None
    tail = 0.5 + level / 2.0
    quantile = float(
        scipy.special.ndtri(tail) if interval == "normal" else scipy.special.stdtrit(n - 1, tail)
    )
    return quantile * sd / math.sqrt(n)


# --- the table of a questionnaire -----------------------------------------------------------------


@dataclass(frozen=True)
class LikertRow:
    """A row of the table. `key` is empty for the overall row; `statements` are the keys that it
    pools. `is_reversed`: of one statement, which is reverse-coded.
    """

    kind: Kind
    key: str
    label: str
    statements: tuple[str, ...]
    summary: Summary
    is_reversed: bool = False


def likert_table(
    definition: Definition,
    responses: Sequence[Answers],
    *,
    language: str,
    interval: Interval,
    overall: str,
) -> list[LikertRow]:
    """Return the rows of the table.

    Args:
        definition: a questionnaire whose scoring is `likert`.
        responses: a mapping a respondent, from statement to value, as `Definition.coded` gives it;
            None or no entry is a missing answer.
        language: of the labels.
        interval: `normal` as the paper, `t` for new studies.
        overall: the label of the first row.

    Raises:
        ValueError: when the questionnaire has no statements on one scale.
    """
    if definition.scoring != "likert":
        raise ValueError(f"{definition.slug} is not scored as statements on one scale")
    scale = definition.scored[0].score_values
    neutral = (scale[0] + scale[-1]) / 2.0
    return [
        LikertRow(
            *(kind, key, label, keys),
            summarise(responses, keys, scale, interval=interval, neutral=neutral),
            is_reversed=kind == "statement" and key in definition.reversed,
        )
        for kind, key, label, keys in _rows(definition, language, overall)
    ]


def _rows(
    definition: Definition, language: str, overall: str
) -> Iterator[tuple[Kind, str, str, tuple[str, ...]]]:
    yield "overall", "", overall, tuple(question.key for question in definition.scored)
    for topic in definition.topics:
        yield "topic", topic.key, spoken(topic.text, language), topic.items
    for question in definition.scored:
        yield "statement", question.key, spoken(question.text, language), (question.key,)
