"""Conditions compared by means, by ranks or as proportions, where some may lack participants."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
import scipy

from experiments.analysis.statistics import models, proportions
from experiments.analysis.statistics.comparisons import (
    NO_VARIANCE,
    IntervalEstimate,
    Test,
    between,
    is_constant,
    repeated_measures,
    several_between,
    several_within,
    within,
)
from experiments.analysis.statistics.mixed_models import fit
from experiments.analysis.statistics.rank_tests import (
    rank_sums,
    several_ranked,
    several_ranked_within,
    signed_rank_p,
    signed_ranks,
)
from experiments.dataset.columns import Floats

Compared = Literal["means", "ranks", "proportions"]
NO_TEST = "–"
ONE_CONDITION = "fewer than two conditions to compare"
NOT_OF_SOME = "participants have only some of these conditions"
WALD = "Wald F"


class _Tests(NamedTuple):
    """The tests of two and of more conditions, of the same participants and of different ones."""

    pairs: Callable[[Floats, Floats], Test]
    several_within: Callable[[Floats], Test]
    two_groups: Callable[[Floats, Floats], Test]
    several_groups: Callable[[Sequence[Floats]], Test]


TESTS: Mapping[Compared, _Tests] = {
    "means": _Tests(within, several_within, between, several_between),
    "ranks": _Tests(signed_ranks, several_ranked_within, rank_sums, several_ranked),
    "proportions": _Tests(
        proportions.paired_proportions,
        lambda table: several_ranked_within(table, proportions.COCHRAN),
        proportions.two_proportions,
        proportions.several_proportions,
    ),
}


def compare(
    groups: Mapping[str, Mapping[str, float]], *, is_paired: bool | None, by: Compared = "means"
) -> Test:
    """Return the test of a difference between conditions, each with a value a participant; with
    `is_paired` None, participants have only some of them, and means are compared by a mixed model.

    A condition of fewer than two participants is left out. Where the values of a group do not vary,
    as at the end of a scale, nothing tells how far its mean may be from the true one: groups are
    compared by ranks. The remark names these conditions.
    """
    kept = {key: group for key, group in groups.items() if len(group) >= 2}
    remarks = [f"{key}: left out, n = {len(groups[key])}" for key in groups if key not in kept]
    if is_paired is None and len(kept) > 1:
        test = _of_some(kept) if by == "means" else Test(NO_TEST, 0, remark=NOT_OF_SOME)
        return replace(test, remark="; ".join((*remarks, *filter(None, (test.remark,)))))
    is_of_means = by == "means" and not is_paired and len(kept) > 1
    if is_of_means and (same := [key for key in kept if is_constant(_values(kept[key]))]):
        test = _compared([*kept.values()], is_paired=False, by="ranks")
        if test.is_known:
            remarks.append(f"{', '.join(same)}: {NO_VARIANCE}, so compared by ranks")
        if len(kept) == 2:  # the difference stays that of means, whose interval is unknown
            first, second = (float(_values(group).mean()) for group in kept.values())
            test = replace(test, difference=IntervalEstimate(first - second))
    else:
        test = _compared([*kept.values()], is_paired=bool(is_paired), by=by)
    return replace(test, remark="; ".join((*remarks, *filter(None, (test.remark,)))))


def _compared(kept: Sequence[Mapping[str, float]], *, is_paired: bool, by: Compared) -> Test:
    tests = TESTS[by]
    if len(kept) < 2:
        return Test(NO_TEST, 0, remark=ONE_CONDITION)
    if is_paired:
        table = complete(kept)
        return tests.pairs(*table.T) if len(kept) == 2 else tests.several_within(table)
    arrays = [_values(group) for group in kept]
    return tests.two_groups(*arrays) if len(kept) == 2 else tests.several_groups(arrays)


def _of_some(groups: Mapping[str, Mapping[str, float]]) -> Test:
    rows = [(key, who, value) for key, group in groups.items() for who, value in group.items()]
    sides, who, values = zip(*rows, strict=True)
    people = len(set(who))
    try:
        design = models.design_of({"side": [*groups]}, ["side"], [{"side": one} for one in sides])
        (term,) = fit(np.array(values), design, ["side"], who).terms
    except models.CannotFitError as error:
        return Test(WALD, people, remark=str(error))
    return Test(WALD, people, term.f, term.df, term.p, term.difference)


def _values(group: Mapping[str, float]) -> Floats:
    return np.array(list(group.values()), dtype=np.float64)


def complete(groups: Sequence[Mapping[str, float]]) -> Floats:
    """Return the values of participants who have one in every group, (n, k), by code."""
    shared = sorted(set.intersection(*(set(group) for group in groups)))
    rows = [[group[code] for group in groups] for code in shared]
    return np.array(rows, dtype=np.float64).reshape(len(shared), len(groups))


def p_values(samples: Sequence[Floats], *, is_paired: bool, by: Compared) -> Floats:
    """Return the p values of `compare` for many studies at once, of conditions (…, n); 1 without
    variance.
    """
    found: Floats
    if by == "proportions" and len(samples) == 2:
        found = (proportions.mcnemar_p if is_paired else proportions.two_proportions_p)(*samples)
    elif is_paired:
        if by == "ranks" and len(samples) == 2:
            found = signed_rank_p(samples[0] - samples[1])
        elif by == "means":  # of two conditions, the square of the paired t
            found = repeated_measures(np.stack(samples, axis=-1))[2]
        else:
            found = scipy.stats.friedmanchisquare(*samples, axis=-1).pvalue
    elif by == "means":  # of two groups, the square of Welch's t
        found = scipy.stats.f_oneway(*samples, equal_var=False, axis=-1).pvalue
    elif by == "ranks" and len(samples) == 2:
        found = scipy.stats.mannwhitneyu(*samples, use_continuity=False, axis=-1).pvalue
    else:
        found = scipy.stats.kruskal(*samples, axis=-1).pvalue
    return np.where(np.isfinite(found), found, 1.0)
