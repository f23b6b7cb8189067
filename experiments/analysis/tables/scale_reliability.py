"""The reliability of each scale in each condition, or why there is no coefficient."""

from collections.abc import Sequence

import numpy as np

from experiments.analysis.statistics import internal_consistency
from experiments.analysis.statistics.comparisons import UNKNOWN, IntervalEstimate
from experiments.analysis.tables.comparisons import REMARK, estimated
from experiments.analysis.tables.scored_responses import (
    ScoredQuestionnaire,
    ScoreGroup,
    scored_questionnaires,
)
from experiments.analysis.tables.scores import about_items, label_of_scale
from experiments.analysis.tables.table import Table, count
from experiments.dataset.columns import Floats
from experiments.dataset.records import Dataset, ResponseRecord
from surveys.scoring import ScoredScale

HEAD = (
    *("Questionnaire", "Scale", "Condition", "Robot", "Items", "n"),
    *("α", "α: from", "α: to", "ω", "ω: from", "ω: to", REMARK),
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
    rows: list[tuple[object, ...]] = []
    notes = list(NOTES)
    for found in scored_questionnaires(dataset):
        groups, slug = list(found.groups), found.variable
        if dataset.study.allocation.design == "between" and len(groups) > 1:
            pooled = tuple(one for group in groups for one in group.responses)
            groups.append(ScoreGroup(ALL, ALL, ALL, pooled))
        for scale in found.scales:
            label = label_of_scale(dataset, found.definition, scale)
            for group in groups if len(scale.items) > 1 else ():
                about = (slug, label, group.condition, group.robot)
                rows.append((*about, *_cells(found, scale, group)))
        notes += [f"{slug}: {sentence}" for sentence in about_items(dataset, found)]
    if any(row[2] == ALL for row in rows):
        notes.append("all: participants of all conditions and robots, pooled.")
    return Table.of("reliability", "Reliability of the scales.", HEAD, rows, notes)


def _cells(found: ScoredQuestionnaire, scale: ScoredScale, group: ScoreGroup) -> tuple[object, ...]:
    # of all groups together, the items that each was asked
    asking = found.groups if group.condition == ALL else [group]
    asked = [key for key in scale.items if all(key in one.asked(scale) for one in asking)]
    own = _complete(group.responses, asked)
    items = np.array([[one.values[key] for key in asked] for one in own], dtype=np.float64)
    alpha, omega, remarks = _coefficients(items.reshape(len(own), len(asked)), asked)
    if missing := [key for key in scale.items if key not in asked]:
        remarks.insert(0, f"without {', '.join(missing)}, not asked")
    n = count(len(own), [one.session for one in own if one.session])
    return len(asked), n, *estimated(alpha, 2), *estimated(omega, 2), "; ".join(remarks)


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
    """Return alpha, omega, and remarks: why there is none, and which items look wrong."""
    omega, remarks = UNKNOWN, list[str]()
    try:
        alpha = internal_consistency.cronbach(items)
    except internal_consistency.UndefinedCoefficientError as error:
        return UNKNOWN, UNKNOWN, [f"no α, no ω: {error}"]
    try:
        omega, at_bound = internal_consistency.mcdonald(items)
        if at_bound:
            named = ", ".join(keys[place] for place in at_bound)
            remarks.append(f"no interval of ω: the factor explains all of {named}")
    except internal_consistency.UndefinedCoefficientError as error:
        remarks.append(f"no ω: {error}")
    for key, r in zip(keys, internal_consistency.against_the_rest(items).tolist(), strict=True):
        if r < 0.0:
            remarks.append(f"{key} correlates {r:.2f}".replace("-", "−") + " with the others")
    return alpha, omega, remarks
