"""Conditions compared as they are: some with too few participants, some without variance, by means
or by ranks, of the same participants or of different ones.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from experiments.analysis.dataset.records import Floats
from experiments.analysis.statistics.comparisons import (
    Test,
    between,
    is_constant,
    several_between,
    several_within,
    within,
)
from experiments.analysis.statistics.rank_tests import rank_sums, several_ranked, signed_ranks

NO_TEST = "–"
ONE_CONDITION = "fewer than two conditions to compare"


def compare(
    groups: Mapping[str, Mapping[str, float]], *, is_paired: bool, by_ranks: bool = False
) -> Test:
    """Return the test of a difference between conditions, each with a value a participant.

    A condition with fewer than two participants, or between participants one without variance,
    takes itself out; the others are compared, and the remark says which and why.
    """
    needs_variance = not (is_paired or by_ranks)
    reasons = {key: _unfit(group, needs_variance) for key, group in groups.items()}
    kept = [group for key, group in groups.items() if not reasons[key]]
    told = [f"{key}: {reason}" for key, reason in reasons.items() if reason]
    if len(kept) < 2:
        test = Test(NO_TEST, 0, remark=ONE_CONDITION)
    else:
        test = (_paired_test if is_paired else _group_test)(kept, by_ranks=by_ranks)
    return replace(test, remark="; ".join((*told, *filter(None, (test.remark,)))))


def _unfit(group: Mapping[str, float], needs_variance: bool) -> str:
    if len(group) < 2:
        return f"left out, n = {len(group)}"
    if needs_variance and is_constant(np.array(list(group.values()), dtype=np.float64)):
        return "left out, no variance"
    return ""


def _paired_test(groups: Sequence[Mapping[str, float]], *, by_ranks: bool) -> Test:
    table = complete(groups)
    two = signed_ranks if by_ranks else within
    return two(table[:, 0], table[:, 1]) if len(groups) == 2 else several_within(table)


def complete(groups: Sequence[Mapping[str, float]]) -> Floats:
    """Return the values of the participants who have one in every group, (n, k), in the order of
    their codes.
    """
    shared = sorted(set.intersection(*(set(group) for group in groups)))
    rows = [[group[who] for group in groups] for who in shared]
    return np.array(rows, dtype=np.float64).reshape(len(shared), len(groups))


def _group_test(groups: Sequence[Mapping[str, float]], *, by_ranks: bool) -> Test:
    arrays: list[Floats] = [np.array(list(group.values()), dtype=np.float64) for group in groups]
    two, several = (rank_sums, several_ranked) if by_ranks else (between, several_between)
    return two(arrays[0], arrays[1]) if len(arrays) == 2 else several(arrays)
