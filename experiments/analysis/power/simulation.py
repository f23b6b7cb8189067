"""Power by simulation: studies are made up from assumptions, and analysed by the statistics that
will analyse the real one; power is the share of them in which a test is significant.

Values are normal. A participant's values in several conditions correlate equally: each is √r of a
part that is the participant's own, and √(1-r) of one that is not. Answers are simulated as if they
were continuous, and measures as if they were independent of each other. All studies of one call
are analysed together, as arrays (studies, participants, conditions).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from experiments.analysis.dataset.records import Floats
from experiments.analysis.power.assumptions import DIFFERENCE, Assumption, assumed
from experiments.analysis.statistics.comparisons import (
    friedman,
    holm_rows,
    paired,
    welch,
    welch_f,
)
from experiments.analysis.statistics.mixed_model_batch import term_p_values
from experiments.analysis.statistics.mixed_models import CannotFitError, design_of
from experiments.analysis.statistics.rank_tests import kruskal, rank_sum_u, signed_rank_p
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.factors import conditions_together
from experiments.definition.plan import deciding_hypotheses
from experiments.definition.schema import StudyDefinition
from surveys.documents import spoken

AT_ONCE = 3_000_000  # values of simulated studies in memory
Orders = Mapping[tuple[str, ...], Sequence[tuple[str, ...]]]  # those of a kind of participant
Samples = Sequence[Floats]  # of each kind of participant: (studies, participants, conditions)


@dataclass(frozen=True)
class SimulatedTest:
    """One test of the declared analyses: its label in their table, the hypotheses that it decides
    on, and its family (tests that are corrected together).
    """

    analysis: str
    measure: str
    label: str
    hypotheses: tuple[str, ...] = ()
    family: str = ""


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
    study: StudyDefinition,
    participants: int,
    studies: int,
    seed: int,
    *,
    observed: Mapping[str, Assumption] | None = None,
    orders: Orders | None = None,
) -> SimulatedStudies:
    """Return simulated studies.

    Args:
        study: the definition.
        participants: in all, spread evenly over the kinds of participants (those who have the same
            conditions).
        studies: how many are made up.
        seed: of their chance; the same one makes the same studies.
        observed: assumptions from data, by measure.
        orders: the orders of conditions of each kind of participant, for models with `period` or
            `order`; else all have that of the definition.
    """
    kinds = conditions_together(study)
    sizes = _sizes(participants, len(kinds))
    measures = dict.fromkeys(one for it in study.analyses for one in it.measures)
    chunk = max(1, AT_ONCE // (participants * max(map(len, kinds))))
    tests: list[SimulatedTest] = []
    columns: list[Floats] = []
    for number, measure in enumerate(measures):
        assumption = assumed(study, measure, observed)
        rng = np.random.default_rng([seed, participants, number])
        parts = []
        for start in range(0, studies, chunk):
            noise = _noise(rng, min(chunk, studies - start), kinds, sizes, assumption.correlation)
            draws = _Draws(study, kinds, assumption, noise, orders or {})
            found = list(_of_measure(draws, measure))
            parts.append([p for _, p in found])
        tests += [test for test, _ in found]
        columns += [np.concatenate(own) for own in zip(*parts, strict=True)]
    p = np.stack(columns, axis=1) if columns else np.empty((studies, 0))
    return SimulatedStudies(participants, tuple(tests), _corrected(tests, p))


def _sizes(participants: int, kinds: int) -> list[int]:
    return [participants // kinds + (n < participants % kinds) for n in range(kinds)]


def _noise(
    rng: np.random.Generator,
    studies: int,
    kinds: Sequence[Sequence[str]],
    sizes: Sequence[int],
    correlation: float,
) -> list[Floats]:
    """Return standard normal values, of which those of a participant correlate."""
    return [
        np.sqrt(correlation) * rng.standard_normal((studies, size, 1))
        + np.sqrt(1.0 - correlation) * rng.standard_normal((studies, size, len(kind)))
        for kind, size in zip(kinds, sizes, strict=True)
    ]


def _corrected(tests: Sequence[SimulatedTest], p: Floats) -> Floats:
    corrected = np.empty_like(p)
    for family in dict.fromkeys(one.family for one in tests):
        own = [n for n, one in enumerate(tests) if one.family == family]
        corrected[:, own] = holm_rows(p[:, own])
    return corrected


@dataclass(frozen=True, eq=False)
class _Draws:
    """The noise of one measure, and what is assumed of it."""

    study: StudyDefinition
    kinds: Sequence[tuple[str, ...]]
    assumption: Assumption
    noise: Samples
    orders: Orders

    def samples(self, raised: Sequence[str] = ()) -> list[Floats]:
        """Return values of every kind of participant; where the means are not assumed, those of
        `raised` conditions lie above the others.
        """
        about = self.assumption
        found = []
        for kind, noise in zip(self.kinds, self.noise, strict=True):
            sds = np.array([about.sd(key) for key in kind])
            means = [
                about.mean(key) if about.means else DIFFERENCE * about.sd(key) * (key in raised)
                for key in kind
            ]
            found.append(noise * sds + np.array(means))
        return found

    def differ(self, first: Sequence[str], second: Sequence[str]) -> bool:
        """Tell whether two sides are assumed to differ."""
        if not self.assumption.means:
            return True
        a, b = (np.mean([self.assumption.mean(key) for key in side]) for side in (first, second))
        return bool(abs(a - b) > 0.0)


Found = Iterator[tuple[SimulatedTest, Floats]]


def _of_measure(draws: _Draws, measure: str) -> Found:
    for analysis in draws.study.analyses:
        if measure not in analysis.measures:
            continue
        if analysis.test == "mixed":
            yield from _mixed(draws, analysis, measure)
        else:
            yield from _compared(draws, analysis, measure)


def _named(
    study: StudyDefinition,
    analysis: DeclaredAnalysis,
    measure: str,
    label: str,
    *,
    contrast: int | None = None,
    effect: str = "",
) -> SimulatedTest:
    found = deciding_hypotheses(study.plan, analysis, measure, contrast=contrast, effect=effect)
    keys = tuple(one.key for one in found)
    families = study.plan.families if study.plan is not None else ()
    own = next((one.key for one in families if set(one.hypotheses) & set(keys)), None)
    # a test of all conditions at once is corrected with its like, as in the table
    at_once = " at once" if contrast is None and not effect else ""
    family = f"analysis {analysis.key}{at_once}" if own is None else f"family {own}"
    return SimulatedTest(analysis.key, measure, label, keys, family)


# --- contrasts, and several conditions at once ----------------------------------------------------


def _compared(draws: _Draws, analysis: DeclaredAnalysis, measure: str) -> Found:
    study, by_ranks = draws.study, analysis.test == "ranks"
    keys = analysis.conditions or tuple(one.key for one in study.conditions)
    if not analysis.contrasts:
        test = _named(study, analysis, measure, "all")
        yield test, _at_once(draws.kinds, draws.samples(keys[-1:]), keys, by_ranks=by_ranks)
    for number, (label, first, second) in enumerate(_pairs(study, analysis, keys), start=1):
        if not draws.differ(first, second):
            continue
        test = _named(study, analysis, measure, label, contrast=number)
        samples = draws.samples(first)
        yield test, two_sides(draws.kinds, samples, first, second, by_ranks=by_ranks)


def _pairs(
    study: StudyDefinition, analysis: DeclaredAnalysis, keys: Sequence[str]
) -> list[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    if analysis.contrasts:
        language = study.languages[0]
        return [(spoken(it.title, language), it.first, it.second) for it in analysis.contrasts]
    if not analysis.post_hoc:
        return []
    return [(f"{a} − {b}", (a,), (b,)) for a, b in combinations(keys, 2)]


def two_sides(
    kinds: Sequence[tuple[str, ...]],
    samples: Samples,
    first: Sequence[str],
    second: Sequence[str],
    *,
    by_ranks: bool,
) -> Floats:
    """Return the p values of a contrast, (studies,): paired where a participant has conditions of
    both sides.
    """
    sides = [
        [_side(kind, own, keys) for keys in (first, second)]
        for kind, own in zip(kinds, samples, strict=True)
    ]
    both = [(a, b) for a, b in sides if a is not None and b is not None]
    if both:
        a, b = (np.concatenate([pair[n] for pair in both], axis=1) for n in (0, 1))
        return signed_rank_p(a - b) if by_ranks else paired(a, b)[1]
    a, b = (
        np.concatenate([pair[n] for pair in sides if pair[n] is not None], axis=1) for n in (0, 1)
    )
    return rank_sum_u(a, b)[1] if by_ranks else welch(a, b)[1]


def _side(kind: Sequence[str], samples: Floats, keys: Sequence[str]) -> Floats | None:
    own = [n for n, key in enumerate(kind) if key in keys]
    return samples[:, :, own].mean(axis=2) if own else None


def _at_once(
    kinds: Sequence[tuple[str, ...]], samples: Samples, keys: Sequence[str], *, by_ranks: bool
) -> Floats:
    """Return the p values of a test of all conditions at once, (studies,); of two conditions it is
    that of their contrast.
    """
    if len(keys) == 2:
        return two_sides(kinds, samples, keys[:1], keys[1:], by_ranks=by_ranks)
    whole = [n for n, kind in enumerate(kinds) if set(keys) <= set(kind)]
    if whole:
        tables = [samples[n][:, :, [kinds[n].index(key) for key in keys]] for n in whole]
        return friedman(np.concatenate(tables, axis=1))[1]
    groups = [
        np.concatenate(
            [
                own[:, :, kind.index(key)]
                for kind, own in zip(kinds, samples, strict=True)
                if key in kind
            ],
            axis=1,
        )
        for key in keys
    ]
    return kruskal(groups)[1] if by_ranks else welch_f(groups)[2]


# --- mixed models ---------------------------------------------------------------------------------


def _mixed(draws: _Draws, analysis: DeclaredAnalysis, measure: str) -> Found:
    """Without assumed means, the last level of each factor is raised; then only the effects of
    factors are tested, because nothing is assumed of interactions, periods and orders.
    """
    study = draws.study
    simulated = [
        effect
        for effect in analysis.effects
        if draws.assumption.means or effect in _raised_by(study)
    ]
    p = _fitted(draws, analysis)
    for effect in simulated:
        test = _named(study, analysis, measure, effect, effect=effect)
        yield test, p[:, analysis.effects.index(effect)]


def _fitted(draws: _Draws, analysis: DeclaredAnalysis) -> Floats:
    """Return the p values of every effect, (studies, effects); 1 where the model cannot be fitted
    to so few participants.
    """
    rows, who, places = _observations(draws, analysis)
    samples = draws.samples()
    outcomes = np.stack(
        [samples[kind][:, person, column] for kind, person, column in places], axis=1
    )
    if not draws.assumption.means:
        outcomes += np.array([_raised(draws, analysis, row) for row in rows])
    try:
        design = design_of(_levels(draws.study, rows), analysis.effects, rows, analysis.coding)
        return term_p_values(outcomes, design, analysis.effects, who)
    except CannotFitError:
        return np.ones((len(outcomes), len(analysis.effects)))


def _raised_by(study: StudyDefinition) -> dict[str, str]:
    """Return the level that is raised by default, by factor."""
    last = {factor.key: factor.levels[-1].key for factor in study.factors}
    return {**last, "condition": study.conditions[-1].key}


def _raised(draws: _Draws, analysis: DeclaredAnalysis, row: Mapping[str, str]) -> float:
    last = _raised_by(draws.study)
    count = sum(row.get(effect) == last[effect] for effect in analysis.effects if effect in last)
    return DIFFERENCE * draws.assumption.sd(row["condition"]) * count


Rows = list[dict[str, str]]


def _observations(
    draws: _Draws, analysis: DeclaredAnalysis
) -> tuple[Rows, list[str], list[tuple[int, int, int]]]:
    """Return the levels of each observation, whose it is, and its place: kind of participant,
    participant, and condition.
    """
    rows: Rows = []
    who: list[str] = []
    places: list[tuple[int, int, int]] = []
    for kind, (keys, noise) in enumerate(zip(draws.kinds, draws.noise, strict=True)):
        orders = draws.orders.get(keys, (keys,))
        for person in range(noise.shape[1]):
            order = orders[person % len(orders)]
            for column, key in enumerate(keys):
                condition = draws.study.condition(key)
                if condition is None or (analysis.conditions and key not in analysis.conditions):
                    continue
                own = {"condition": key, "order": "-".join(order)}
                rows.append({**condition.levels, **own, "period": str(order.index(key) + 1)})
                who.append(f"{kind}-{person:06d}")
                places.append((kind, person, column))
    return rows, who, places


def _levels(study: StudyDefinition, rows: Rows) -> dict[str, list[str]]:
    written = {factor.key: [level.key for level in factor.levels] for factor in study.factors}
    written["condition"] = [condition.key for condition in study.conditions]
    given = {name: {row[name] for row in rows if name in row} for name in written}
    found = {
        name: [level for level in levels if level in given[name]]
        for name, levels in written.items()
    }
    return found | {name: sorted({row[name] for row in rows}) for name in ("period", "order")}
