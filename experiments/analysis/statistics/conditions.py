"""Conditions compared as they are: some with too few participants, some without variance, of the
same participants or of different ones, by means, by ranks or as proportions.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import scipy

from experiments.analysis.statistics.comparisons import (
    Test,
    between,
    is_constant,
    repeated_measures,
    several_between,
    several_within,
    within,
)
from experiments.analysis.statistics.proportions import (
    COCHRAN,
    mcnemar_p,
    paired_proportions,
    several_proportions,
    two_proportions,
    two_proportions_p,
)
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
PAIRS: Mapping[Compared, Callable[[Floats, Floats], Test]] = {
    "means": within,
    "ranks": signed_ranks,
    "proportions": paired_proportions,
}
TWO_GROUPS: Mapping[Compared, Callable[[Floats, Floats], Test]] = {
    "means": between,
    "ranks": rank_sums,
    "proportions": two_proportions,
}
SEVERAL_WITHIN: Mapping[Compared, Callable[[Floats], Test]] = {
    "means": several_within,
    "ranks": several_ranked_within,
    "proportions": lambda table: several_ranked_within(table, COCHRAN),
}
SEVERAL_GROUPS: Mapping[Compared, Callable[[Sequence[Floats]], Test]] = {
    "means": several_between,
    "ranks": several_ranked,
    "proportions": several_proportions,
}


def compare(
    groups: Mapping[str, Mapping[str, float]], *, is_paired: bool, by: Compared = "means"
) -> Test:
    """Return the test of a difference between conditions, each with a value a participant.

    A condition with fewer than two participants, or between participants one whose mean has no
    variance, takes itself out; the others are compared, and the remark says which and why.
    """
    needs_variance = by == "means" and not is_paired
    reasons = {key: _unfit(group, needs_variance) for key, group in groups.items()}
    kept = [group for key, group in groups.items() if not reasons[key]]
    told = [f"{key}: {reason}" for key, reason in reasons.items() if reason]
    if len(kept) < 2:
        test = Test(NO_TEST, 0, remark=ONE_CONDITION)
    elif is_paired:
        table = complete(kept)
        test = PAIRS[by](*table.T) if len(kept) == 2 else SEVERAL_WITHIN[by](table)
    else:
        arrays: list[Floats] = [np.array(list(one.values()), dtype=np.float64) for one in kept]
        test = TWO_GROUPS[by](*arrays) if len(kept) == 2 else SEVERAL_GROUPS[by](arrays)
    return replace(test, remark="; ".join((*told, *filter(None, (test.remark,)))))


def _unfit(group: Mapping[str, float], needs_variance: bool) -> str:
    if len(group) < 2:
        return f"left out, n = {len(group)}"
    if needs_variance and is_constant(np.array(list(group.values()), dtype=np.float64)):
        return "left out, no variance"
    return ""


def complete(groups: Sequence[Mapping[str, float]]) -> Floats:
    """Return the values of the participants who have one in every group, (n, k), in the order of
    their codes.
    """
    shared = sorted(set.intersection(*(set(group) for group in groups)))
    rows = [[group[who] for group in groups] for who in shared]
    return np.array(rows, dtype=np.float64).reshape(len(shared), len(groups))


def p_values(samples: Sequence[Floats], *, is_paired: bool, by: Compared) -> Floats:
    """Return the p values of `compare` for many studies at once: of conditions, (…, n) each, whose
    participants are the same ones if `is_paired`.
    """
    found: Floats
    if by == "proportions" and len(samples) == 2:
        found = (mcnemar_p if is_paired else two_proportions_p)(*samples)
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
    return np.where(np.isfinite(found), found, 1.0)  # without any variance, nothing is rejected
