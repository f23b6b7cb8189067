"""Summaries of statements on a scale, as in table 5 of Melendez-Fernandez et al. (2017).

The paper gives no definition; ours is:

- percentages pool all answers of a row;
- mean, standard deviation (n - 1) and confidence intervals are those of the *respondents'* scores,
  each the mean of their responses, of which each is the mean of the row's statements that it
  answers: several responses of one person are not independent of each other;
- the half-width of an interval is c * SD / sqrt(n), with c of the normal distribution ("normal",
  which reproduces the published half-width) or of Student's t with n - 1 degrees of freedom ("t").
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
OwnAnswers = tuple[str, Answers]  # a respondent, and a response of theirs
Kind = Literal["overall", "topic", "statement"]


@dataclass(frozen=True)
class Summary:
    """One row. Counts and percentages are in the order of the scale; percentages are None without
    answers. `positive` is the percentage above `neutral`. `mean` is None without respondents, `sd`
    and the half-widths below two of them.
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


def summarise(
    responses: Sequence[OwnAnswers],
    statements: Sequence[str],
    scale: Sequence[int],
    *,
    interval: Interval,
    neutral: float = 0.0,
) -> Summary:
    """Return the row that pools statements (keys). `responses` have values of the scale by
    statement; None or no entry is a missing answer. `scale` has its values, rising; answers above
    `neutral` are positive. Raises ValueError for an answer that is no value of the scale.
    """
    counts, own = Counter[int](), dict[str, list[float]]()
    for who, answers in responses:
        values = [value for key in statements if (value := answers.get(key)) is not None]
        counts.update(values)
        if values:
            own.setdefault(who, []).append(statistics.fmean(values))
    if outside := sorted(set(counts) - set(scale)):
        raise ValueError(f"answers outside the scale: {outside}")
    scores = [statistics.fmean(values) for values in own.values()]
    mean, sd = mean_and_sd(scores)
    total = counts.total()
    above = sum(n for value, n in counts.items() if value > neutral)
    return Summary(
        respondents=len(scores),
        answers=total,
        counts=tuple(counts[value] for value in scale),
        percentages=tuple(100.0 * counts[one] / total for one in scale) if total else None,
        mean=mean,
        sd=sd,
        ci95=half_width(sd, len(scores), 0.95, interval),
        ci99=half_width(sd, len(scores), 0.99, interval),
        positive=100.0 * above / total if total else None,
    )


def mean_and_sd(scores: Sequence[float]) -> tuple[float | None, float | None]:
    """Return mean and standard deviation (n - 1); None where there are too few scores."""
    mean = statistics.fmean(scores) if scores else None
    return mean, statistics.stdev(scores) if len(scores) > 1 else None


def half_width(sd: float | None, n: int, level: float, interval: Interval) -> float | None:
    """Return the half-width of the confidence interval of a mean; None when `sd` is."""
    if sd is None:
        return None
    tail, special = 0.5 + level / 2.0, scipy.special
    quantile = special.ndtri(tail) if interval == "normal" else special.stdtrit(n - 1, tail)
    return float(quantile) * sd / math.sqrt(n)


@dataclass(frozen=True)
class LikertRow:
    """A row of the table, which pools `statements` (keys). `key` is empty for the overall row;
    `is_reversed` means a single, reverse-coded statement.
    """

    kind: Kind
    key: str
    label: str
    statements: tuple[str, ...]
    summary: Summary
    is_reversed: bool = False


def likert_table(
    definition: Definition,
    responses: Sequence[OwnAnswers],
    *,
    language: str,
    interval: Interval,
    overall: str,
) -> list[LikertRow]:
    """Return the rows of a questionnaire from values of `Definition.coded`, with labels in a
    language; `overall` is that of the first row. Raises ValueError when its scoring is not
    `likert`.
    """
    if definition.scoring != "likert":
        raise ValueError(f"{definition.slug} is not scored as statements on one scale")
    scale = definition.scored[0].score_values
    neutral = (scale[0] + scale[-1]) / 2.0
    rows = []
    for kind, key, label, keys in _rows(definition, language, overall):
        summary = summarise(responses, keys, scale, interval=interval, neutral=neutral)
        is_reversed = kind == "statement" and key in definition.reversed
        rows.append(LikertRow(kind, key, label, keys, summary, is_reversed))
    return rows


def _rows(
    definition: Definition, language: str, overall: str
) -> Iterator[tuple[Kind, str, str, tuple[str, ...]]]:
    yield "overall", "", overall, tuple(question.key for question in definition.scored)
    for topic in definition.topics:
        yield "topic", topic.key, spoken(topic.text, language), topic.items
    for question in definition.scored:
        yield "statement", question.key, spoken(question.text, language), (question.key,)
