"""How reliable each scale is in each condition: Cronbach's alpha and McDonald's omega, with their
intervals, or the reason why there is none.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from experiments.analysis.statistics.comparisons import UNKNOWN, IntervalEstimate
from experiments.analysis.statistics.internal_consistency import (
    UndefinedCoefficientError,
    against_the_rest,
    cronbach,
    mcdonald,
)
from experiments.analysis.tables.comparisons import REMARK, estimated
from experiments.analysis.tables.scored_responses import (
    ScoredQuestionnaire,
    ScoreGroup,
    scored_questionnaires,
)
from experiments.analysis.tables.scores import about_items, label_of_scale
from experiments.analysis.tables.table import Table, TableCell, count, words
from experiments.dataset.columns import Floats
from experiments.dataset.records import Dataset, ResponseRecord
from surveys.scoring import ScoredScale

HEAD = (
    "Questionnaire",
    "Scale",
    "Condition",
    "Robot",
    "Items",
    "n",
    "α",
    "α: from",
    "α: to",
    "ω",
    "ω: from",
    "ω: to",
    REMARK,
)
NOTES = (
    (
        "n: participants who answered all items, with their first response about the condition"
        " that counts. from, to: 95 % confidence interval."
    ),
    (
        "α: Cronbach's, interval of Feldt (1965). ω: McDonald's, of a model with one factor by"
        " maximum likelihood on the covariances; interval of Wald on the logit scale."
    ),
    (
        "Reverse-coded items are counted from the other end. An item that correlates negatively"
        " with the sum of the others may be reverse-coded but not declared so."
    ),
)
ALL = "all"


def reliability_table(dataset: Dataset) -> Table:
    """Return a row for each scale of several items, condition and robot; between participants also
    one of all, which the notes say is pooled.
    """
    rows: list[tuple[TableCell, ...]] = []
    notes = list(NOTES)
    for found in scored_questionnaires(dataset):
        groups = [*found.groups, *_pooled(dataset, found)]
        scales = [scale for scale in found.scales if len(scale.items) > 1]
        rows += [_row(dataset, found, scale, group) for scale in scales for group in groups]
        slug = found.definition.slug
        notes += [f"{slug}: {sentence}" for sentence in about_items(dataset, found)]
    if any(row[2].text == ALL for row in rows):
        notes.append("all: participants of all conditions and robots, pooled.")
    return Table("reliability", "Reliability of the scales.", HEAD, tuple(rows), tuple(notes))


def _pooled(dataset: Dataset, found: ScoredQuestionnaire) -> Iterator[ScoreGroup]:
    """Yield one group of all where a participant is in one condition alone."""
    if dataset.study.allocation.design == "between" and len(found.groups) > 1:
        own = tuple(one for group in found.groups for one in group.responses)
        yield ScoreGroup(ALL, ALL, ALL, own)


def _row(
    dataset: Dataset, found: ScoredQuestionnaire, scale: ScoredScale, group: ScoreGroup
) -> tuple[TableCell, ...]:
    asked = _asked_of_all(found, scale, group)
    own = _complete(group.responses, asked)
    items = np.array([[one.values[key] for key in asked] for one in own], dtype=np.float64)
    items = items.reshape(len(own), len(asked))
    alpha, omega, remarks = _coefficients(items, asked)
    if left := [key for key in scale.items if key not in asked]:
        remarks.insert(0, f"without {', '.join(left)}, not asked")
    ids = [one.session for one in own if one.session]
    return (
        words(found.definition.slug),
        words(label_of_scale(dataset, found.definition, scale)),
        words(group.condition),
        words(group.robot),
        count(len(asked)),
        count(len(own), ids),
        *estimated(alpha, 2),
        *estimated(omega, 2),
        words("; ".join(remarks)),
    )


def _asked_of_all(
    found: ScoredQuestionnaire, scale: ScoredScale, group: ScoreGroup
) -> tuple[str, ...]:
    """Return the items that the group was asked; of all groups together those that each was."""
    if group.condition != ALL:
        return group.asked(scale)
    return tuple(key for key in scale.items if all(key in one.asked(scale) for one in found.groups))


def _complete(responses: Sequence[ResponseRecord], keys: Sequence[str]) -> list[ResponseRecord]:
    """Return each participant's first response that answers all items."""
    found: dict[str, ResponseRecord] = {}
    for one in responses:
        if all(one.values.get(key) is not None for key in keys):
            found.setdefault(one.participant, one)
    return list(found.values())


def _coefficients(
    items: Floats, keys: Sequence[str]
) -> tuple[IntervalEstimate, IntervalEstimate, list[str]]:
    """Return alpha, omega, and remarks: why there is none, and what to look at."""
    alpha = omega = UNKNOWN
    remarks: list[str] = []
    try:
        alpha = cronbach(items)
    except UndefinedCoefficientError as error:
        return UNKNOWN, UNKNOWN, [f"no α, no ω: {error}"]
    try:
        omega, at_bound = mcdonald(items)
        if at_bound:
            named = ", ".join(keys[place] for place in at_bound)
            remarks.append(f"no interval of ω: the factor explains all of {named}")
    except UndefinedCoefficientError as error:
        remarks.append(f"no ω: {error}")
    for key, r in zip(keys, against_the_rest(items).tolist(), strict=True):
        if r < 0.0:
            remarks.append(f"{key} correlates {r:.2f}".replace("-", "−") + " with the others")
    return alpha, omega, remarks
