"""Power by simulation: studies are drawn from assumptions (draws.py) and analysed by the statistics
that will analyse the real one, in the families in which the report corrects them; power is the
share of them in which a test is significant. Families include tests without an assumption.

Answers are simulated as if they were continuous, measures as if they were independent of each
other, and covariates as if they explained nothing. All studies of one call are analysed together,
as arrays (studies, participants, conditions), except models by statsmodels.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from experiments.analysis.power.draws import (
    Draws,
    Found,
    Orders,
    SimulatedTest,
    assumed,
    correlated,
)
from experiments.analysis.power.simulated_models import modelled
from experiments.analysis.statistics.comparisons import holm_rows
from experiments.analysis.statistics.conditions import Compared, compare, p_values
from experiments.analysis.statistics.regression import DriveOutcome, Family, compare_drives
from experiments.analysis.tables.declared import conditions_of, contrasts_of
from experiments.dataset.columns import Floats
from experiments.definition.analyses import FAMILIES, DeclaredAnalysis
from experiments.definition.factors import conditions_together, layout_of
from experiments.definition.schema import StudyDefinition

AT_ONCE = 3_000_000  # values of simulated studies in memory


@dataclass(frozen=True, eq=False)
class SimulatedStudies:
    """Studies of one size: `p` (studies, tests), corrected within their families."""

    participants: int
    tests: tuple[SimulatedTest, ...]
    p: Floats

    def power(self, alpha: float) -> list[tuple[int, int]]:
        """Return in how many studies each test was significant, and of how many."""
        return [(int((column < alpha).sum()), len(column)) for column in self.p.T]


def simulate(
    study: StudyDefinition, participants: int, studies: int, seed: int, orders: Orders | None = None
) -> SimulatedStudies:
    """Return simulated studies; the same seed gives the same ones. `orders` has the orders of each
    kind of participant, for models with `period` or `order`; by default, the definition's.
    """
    kinds = conditions_together(study)
    each, more = divmod(participants, len(kinds))
    sizes = {kind: each + (n < more) for n, kind in enumerate(kinds)}
    chunk = max(1, AT_ONCE // (participants * max(map(len, kinds))))
    tests: list[SimulatedTest] = []
    found: list[Floats] = []  # p values of each test, as assumed
    alone: list[Floats] = []  # and with nothing to find, while another one has its default effect
    measures = dict.fromkeys(one for it in study.analyses for one in it.measures)
    for number, measure in enumerate(measures):
        rng = np.random.default_rng([seed, participants, number])
        about = assumed(study, measure)
        parts = []
        for start in range(0, studies, chunk):
            size = min(chunk, studies - start)
            noise = {
                kind: correlated(rng, (size, people, len(kind)), about.correlation)
                for kind, people in sizes.items()
            }
            parts.append(list(_of_measure(Draws(study, about, orders or {}, noise), measure)))
        for same in zip(*parts, strict=True):
            tests.append(same[0][0])
            found.append(np.concatenate([own for _, own, _ in same]))
            alone.append(np.concatenate([without for _, _, without in same]))
    if not tests:
        return SimulatedStudies(participants, (), np.empty((studies, 0)))
    p = _corrected(study, tests, np.stack(found, axis=1), np.stack(alone, axis=1))
    return SimulatedStudies(participants, tuple(tests), p)


def _corrected(
    study: StudyDefinition, tests: Sequence[SimulatedTest], found: Floats, alone: Floats
) -> Floats:
    """Return p values corrected as the report does: within the family of the plan that has a
    hypothesis of the test, otherwise within its analysis. Each is corrected beside the others of
    its family, in which nothing else is found where each test has its default effect.
    """
    corrected = np.empty_like(found)
    families = [set(it.hypotheses) for it in study.plan.families] if study.plan is not None else []
    for number, one in enumerate(tests):
        planned = next((it for it in families if it.intersection(one.hypotheses)), None)
        own = [
            n
            for n, other in enumerate(tests)
            if (planned.intersection(other.hypotheses) if planned else other.family == one.family)
        ]
        values = alone[:, own]
        values[:, own.index(number)] = found[:, number]
        corrected[:, number] = holm_rows(values)[:, own.index(number)]
    return corrected


def _of_measure(draws: Draws, measure: str) -> Found:
    for analysis in draws.study.analyses:
        if measure in analysis.measures:
            analysed = modelled if analysis.is_model else _compared
            yield from analysed(draws, analysis, measure)


# --- contrasts, and several conditions at once ----------------------------------------------------


def _compared(draws: Draws, analysis: DeclaredAnalysis, measure: str) -> Found:
    study, test = draws.study, analysis.test
    keys = conditions_of(study, analysis)
    contrasts = contrasts_of(study, analysis, study.languages[0])
    is_assumed = draws.is_assumed(test)
    if not analysis.contrasts:
        is_null = is_assumed and len({draws.location(test, key) for key in keys}) == 1
        named = draws.test(analysis, measure, "all", is_null=is_null)
        yield named, *_with_and_without(draws, test, [(key,) for key in keys], keys[-1:])
    for number, (label, first, second) in enumerate(contrasts, start=1):
        a, b = (np.mean([draws.location(test, key) for key in side]) for side in (first, second))
        is_null = is_assumed and bool(a == b)
        named = draws.test(analysis, measure, label, is_null=is_null, contrast=number)
        yield named, *_with_and_without(draws, test, [first, second], first)


def _with_and_without(
    draws: Draws, test: str, sides: Sequence[Sequence[str]], raised: Sequence[str]
) -> tuple[Floats, Floats]:
    """Return the p values of a test, (studies,), as assumed and with nothing to find."""
    found = _tested(draws, test, sides, draws.samples(test, raised))
    if draws.is_assumed(test):
        return found, found
    return found, _tested(draws, test, sides, draws.samples(test))


def _tested(
    draws: Draws, test: str, sides: Sequence[Sequence[str]], samples: Sequence[Floats]
) -> Floats:
    """Return the p values of a comparison, (studies,), of participants laid out as in the study."""
    kinds = [list(enumerate(kind)) for kind in draws.noise]
    own = [[[at for at, key in kind if key in side] for side in sides] for kind in kinds]
    is_paired, is_single = layout_of(draws.study, sides)
    if test in FAMILIES and (test != "proportions" or not is_single or is_paired is None):
        return _by_drives(draws, cast("Family", test), sides, samples)
    if test == "proportions":
        samples = [
            np.stack([draws.outcome(test, key, x[..., at])[0] for at, key in enumerate(kind)], -1)
            for kind, x in zip(draws.noise, samples, strict=True)
        ]
    groups = []
    for side in range(len(sides)):
        means = [
            x[..., places[side]].mean(axis=-1)
            for x, places in zip(samples, own, strict=True)
            if (all(places) if is_paired else places[side])
        ]
        groups.append(np.concatenate(means, axis=1))
    if is_paired is None:
        named = [
            [
                f"{kind}-{n}"
                for kind, x in enumerate(samples)
                if own[kind][side]
                for n in range(x.shape[1])
            ]
            for side in range(len(sides))
        ]
        return _of_some(named, groups, cast("Compared", test))
    return p_values(groups, is_paired=is_paired, by=cast("Compared", test))


def _of_some(named: Sequence[Sequence[str]], groups: Sequence[Floats], by: Compared) -> Floats:
    """Return the p values of sides of which participants have some, a study at a time."""
    found = []
    for values in zip(*groups, strict=True):
        each = zip(named, values, strict=True)
        sides = {str(n): dict(zip(*one, strict=True)) for n, one in enumerate(each)}
        found.append(compare(sides, is_paired=None, by=by).p)
    return np.asarray(np.nan_to_num(np.array(found), nan=1.0))


def _by_drives(
    draws: Draws, family: Family, sides: Sequence[Sequence[str]], samples: Sequence[Floats]
) -> Floats:
    """Return the p values of sides of drives, (studies,), a study at a time; 1 without a test."""
    drawn = [
        (str(side), key, f"{kind}-{person:06d}", x[:, person, at])
        for kind, (keys, x) in enumerate(zip(draws.noise, samples, strict=True))
        for at, key in enumerate(keys)
        for side, of_side in enumerate(sides)
        if key in of_side
        for person in range(x.shape[1])
    ]
    labels, conditions, who, normal = zip(*drawn, strict=True)
    found, layout = [], layout_of(draws.study, sides)._asdict()
    for drives in draws.drives(family, who, conditions, np.stack(normal, axis=1)):
        own: dict[str, list[DriveOutcome]] = {str(side): [] for side in range(len(sides))}
        for label, one in zip(labels, drives, strict=True):
            own[label].append(one)
        test = compare_drives(family, own, **layout, with_ratio=False)
        found.append(test.p if test.is_known else 1.0)
    return np.array(found)
