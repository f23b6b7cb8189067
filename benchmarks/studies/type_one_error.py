"""How often each test of the reports finds something where there is nothing, and how often each of
their intervals holds the true value: by simulated studies on data that are difficult (ties, zeros,
unequal variances and group sizes, time-outs, drives that are missing).

    python -m benchmarks.studies.type_one_error [--runs 2000] [--only WORDS]

prints the tables of docs/explanation/statistics.md, and fails where a rate is out of its bounds: at
α = 5 %, 3 to 7 % of true nulls may be rejected, and 93 to 97 % of intervals hold the true value.
Studies without a test (all drives completed, say) do not count; the share of the others is printed.
"""

import argparse
import sys
import warnings
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
import scipy

from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.milestones import Milestones
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.comparisons import IntervalEstimate, Test, correlation
from experiments.analysis.statistics.conditions import Compared, compare
from experiments.analysis.statistics.descriptive import wilson
from experiments.analysis.statistics.internal_consistency import (
    UndefinedCoefficientError,
    cronbach,
    mcdonald,
)
from experiments.analysis.statistics.mixed_models import fit
from experiments.analysis.statistics.models import CannotFitError, FittedModel, design_of
from experiments.analysis.statistics.regression import (
    DriveOutcome,
    Family,
    compare_drives,
    fit_family,
)
from experiments.analysis.tables.declared import declared
from experiments.dataset.columns import Floats
from experiments.dataset.counting import counting
from experiments.dataset.records import Dataset, ParticipantRecord, SessionRecord
from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped
from surveys.likert import half_width

RUNS, SEED = 2000, 7
REJECTED, HELD = (3.0, 7.0), (93.0, 97.0)  # per cent
Rng = np.random.Generator


Drives = list[list[DriveOutcome]]  # of each condition


@dataclass(frozen=True)
class Case:
    """A test or an interval, and the data that it is tried on. `run` makes a study and returns the
    test, or whether a null was rejected or an interval held the true value; None where there was
    none. Several of one study are by name.
    """

    what: str
    data: str
    run: Callable[[Rng], Test | bool | dict[str, bool | None] | None]


def holds(found: IntervalEstimate, true: float) -> bool | None:
    return found.low <= true <= found.high if np.isfinite([found.low, found.high]).all() else None


def named(n: int, at: int, *, paired: bool) -> list[str]:
    """Return the participants of a condition: the same in all if they are paired."""
    return [f"P{one if paired else 1000 * at + one:05d}" for one in range(n)]


def compared(*arrays: Floats, paired: bool = False, by: Compared = "means") -> Test:
    groups = {
        f"c{at}": dict(zip(named(len(own), at, paired=paired), own.tolist(), strict=True))
        for at, own in enumerate(arrays)
    }
    return compare(groups, is_paired=paired, by=by)


def of_two_kinds(rng: Rng, n: int, m: int) -> Test:
    """Compare four conditions, of which two kinds of participants have two each."""
    kinds = [
        (f"kind{at}", correlated(rng, *of))
        for at, of in enumerate(((n, (1.0, 2.0)), (m, (2.0, 1.0))))
    ]
    groups = {
        f"{kind}-{at}": {f"{kind}-{who}": float(one) for who, one in enumerate(column)}
        for kind, own in kinds
        for at, column in enumerate(own.T)
    }
    return compare(groups, is_paired=None)


# --- data -----------------------------------------------------------------------------------------


def correlated(rng: Rng, n: int, sds: Sequence[float], r: float = 0.5) -> Floats:
    """Return normal values of n participants under conditions, (n, k), with mean 0; values of
    conditions that are farther apart correlate less.
    """
    places = np.arange(len(sds))
    correlations = r ** np.abs(places[:, None] - places)
    return np.asarray(rng.multivariate_normal(np.zeros(len(sds)), correlations, n) * np.array(sds))


def answers(rng: Rng, n: int, k: int) -> Floats:
    """Return answers from 1 to 5, (n, k), of which most are 4 or 5; a participant's are alike."""
    latent = 0.7 * rng.standard_normal((n, 1)) + 0.7 * rng.standard_normal((n, k)) + 0.6
    return np.asarray(np.digitize(latent, (-1.0, -0.3, 0.2, 0.9)) + 1.0)


def mostly_best(rng: Rng, n: int, share: float) -> Floats:
    """Return values at the end of a scale, 1, of which some groups have nothing else."""
    return np.where(rng.random(n) < share, 1.0, 1.0 - rng.gamma(2.0, 0.05, n))


def many_zeros(rng: Rng, *shape: int) -> Floats:
    """Return counts with more variance than those of Poisson: half of them are 0."""
    return rng.poisson(rng.gamma(0.5, 3.0, shape)).astype(np.float64)


def drives_of(*outcomes: tuple[Floats, Floats] | Floats, paired: bool = True) -> Drives:
    """Return the drives of conditions from their values, or values and weights."""
    found = []
    for at, own in enumerate(outcomes):
        values, weights = own if isinstance(own, tuple) else (own, np.ones(len(own)))
        who = named(len(values), at, paired=paired)
        drives = zip(who, values.tolist(), weights.tolist(), strict=True)
        found.append([DriveOutcome(*one) for one in drives])
    return found


def stops(rng: Rng, n: int, k: int, ratio: float = 1.0, *, paired: bool) -> Drives:
    """Return numbers of stops in drives of unequal length, some of which end by a time-out or after
    a minute. Participants differ in their rates, and so do their drives.
    """
    found = []
    own = rng.gamma(2.0, 0.5, n)
    for at in range(k):
        minutes = np.where(rng.random(n) < 0.15, 1.0, np.minimum(rng.gamma(6.0, 1.0, n), 8.0))
        person = own if paired else rng.gamma(2.0, 0.5, n)
        rate = person * rng.gamma(2.0, 0.5, n) * (ratio if at == 0 else 1.0)
        found.append((rng.poisson(rate * minutes).astype(np.float64), minutes))
    return drives_of(*found, paired=paired)


def times(rng: Rng, n: int, k: int, ratio: float = 1.0, *, paired: bool) -> Drives:
    """Return times to success in seconds; a fifth end by a time-out, a tenth by leaving. `ratio` is
    how many times longer they are under the first condition, or the hazard ratio.
    """
    found = []
    own = rng.gamma(3.0, 1.0 / 3.0, n)
    for at in range(k):
        frailty = own if paired else np.ones(n)
        seconds = rng.exponential(300.0, n) / frailty * (ratio if at == 0 else 1.0)
        ends = np.where(rng.random(n) < 0.1, rng.uniform(30.0, 400.0, n), 480.0)
        found.append((np.minimum(seconds, ends), (seconds <= ends).astype(np.float64)))
    return drives_of(*found, paired=paired)


def successes(rng: Rng, n: int, k: int, share: float, *, paired: bool) -> Floats:
    """Return zeros and ones, (n, k); those of a participant are alike."""
    latent = rng.standard_normal((n, k))
    if paired:
        latent = 0.7 * rng.standard_normal((n, 1)) + np.sqrt(0.51) * latent
    return np.asarray(latent < scipy.special.ndtri(share), dtype=np.float64)


def completed(rng: Rng, n: int, k: int, share: float) -> Drives:
    return drives_of(*successes(rng, n, k, share, paired=True).T)


def shares(rng: Rng, first: float, second: float) -> Test:
    groups = (rng.random(24) < first, rng.random(40) < second)
    return by_drives("proportions", drives_of(*(one.astype(float) for one in groups), paired=False))


def by_drives(family: Family, drives: Drives, *, with_ratio: bool = False) -> Test:
    """Return the test of conditions by their drives."""
    sides = {f"c{at}": own for at, own in enumerate(drives)}
    who = [{one.who for one in side} for side in drives]
    is_paired = bool(set.intersection(*who))
    is_single = all(len(own) == len(side) for own, side in zip(who, drives, strict=True))
    layout = {"is_paired": is_paired, "is_single": is_single}
    return compare_drives(family, sides, **layout, with_ratio=with_ratio)


# --- models ---------------------------------------------------------------------------------------

CELLS = [(a, b) for a in ("none", "long") for b in ("alone", "helped")]
LEVELS = {"delay": ("none", "long"), "help": ("alone", "helped")}
CROSSED = ("delay", "help", "delay:help")


def mixed(
    values: Floats,
    terms: Sequence[str],
    rows: Sequence[dict[str, str | float]],
    **levels: Sequence[str],
) -> FittedModel | None:
    """Fit a mixed model to values of participants under conditions, (n, k); NaN is missing."""
    given = np.isfinite(values)
    kept = [row for row, known in zip(rows, given.ravel(), strict=True) if known]
    who = np.repeat([f"P{n:04d}" for n in range(len(values))], values.shape[1])[given.ravel()]
    try:
        design = design_of(LEVELS | levels, terms, kept)
        return fit(values[given], design, terms, who.tolist())
    except CannotFitError:
        return None


def terms(model: FittedModel | None, *names: str) -> dict[str, bool | None]:
    found = {} if model is None else {one.name: one.p < 0.05 for one in model.terms}
    return {name: found.get(name) for name in names}


def two_by_two(rng: Rng, n: int, *, missing: float = 0.0) -> FittedModel | None:
    """A pure interaction: both main effects are 0; one condition has three times the SD."""
    values = correlated(rng, n, (1.0, 1.0, 1.0, 3.0)) + np.array([1.0, -1.0, -1.0, 1.0])
    values[rng.random(values.shape) < missing] = np.nan
    rows = [{"delay": a, "help": b} for _ in range(n) for a, b in CELLS]
    return mixed(values, CROSSED, rows)


def four_levels(rng: Rng, n: int, *, missing: float = 0.0) -> FittedModel | None:
    """Four conditions in a Latin square, with a true effect of the round; the SDs differ."""
    square = np.array([(0, 1, 3, 2), (1, 2, 0, 3), (2, 3, 1, 0), (3, 0, 2, 1)])
    orders = square[np.arange(n) % 4]
    periods = np.argsort(orders, axis=1)
    values = correlated(rng, n, (1.0, 1.0, 2.0, 4.0)) - 0.5 * periods
    values[rng.random(values.shape) < missing] = np.nan
    places = [(person, at) for person in range(n) for at in range(4)]
    rows = [{"condition": f"c{at}", "period": str(periods[who, at] + 1)} for who, at in places]
    levels = {"condition": [f"c{at}" for at in range(4)], "period": list("1234")}
    return mixed(values, ("condition", "period"), rows, **levels)


def groups_by_conditions(rng: Rng, n: int, m: int, sd: float) -> FittedModel | None:
    """Two groups of different size under three conditions; the SD of the first is `sd`."""
    values = np.concatenate([correlated(rng, n, (sd, sd, sd)), correlated(rng, m, (1.0, 1.0, 2.0))])
    rows: list[dict[str, str | float]] = [
        {"group": group, "condition": f"c{at}"}
        for group, size in (("novice", n), ("expert", m))
        for _ in range(size)
        for at in range(3)
    ]
    terms, names = ("group", "condition", "group:condition"), [f"c{at}" for at in range(3)]
    return mixed(values, terms, rows, group=["novice", "expert"], condition=names)


def with_age(rng: Rng, n: int) -> FittedModel | None:
    """Two groups of one value each, which depends on age; the variance of one is four times that of
    the other.
    """
    ages = rng.integers(18, 70, n)
    is_first = np.arange(n) % 3 == 0
    values = 0.1 * ages + rng.standard_normal(n) * np.where(is_first, 4.0, 2.0)
    rows: list[dict[str, str | float]] = [
        {"delay": "none" if first else "long", "age": float(age)}
        for first, age in zip(is_first, ages, strict=True)
    ]
    return mixed(values[:, None], ("delay", "age"), rows)


def family_model(family: Family, drives: Drives) -> FittedModel | None:
    outcomes = [one for own in drives for one in own]
    rows = [{"delay": a, "help": b} for (a, b), own in zip(CELLS, drives, strict=True) for _ in own]
    design = design_of(LEVELS, CROSSED, rows)
    try:
        return fit_family(family, outcomes, design, CROSSED, with_coefficients=False)
    except CannotFitError:
        return None


# --- whole reports --------------------------------------------------------------------------------

REPORTED = {"speed": "means", "near_seconds": "ranks", "completed": "proportions"}
REPORTED |= {"stops": "counts", "task_time": "times"}


def reported_study(*, within: bool) -> StudyDefinition:
    """A study of two conditions whose analyses test one measure each."""
    shipped_ = msgspec.to_builtins(shipped()["assistance"])
    first = shipped_["conditions"][0]
    contrast = {"title": {"en": "a − b"}, "first": ["a"], "second": ["b"]}
    own = {
        "factors": [],
        "plan": None,
        "conditions": [{**first, "key": key, "levels": {}} for key in "ab"],
        "allocation": {"design": "within" if within else "between"},
        "analyses": [
            {
                "key": f"of_{n}",
                "title": {},
                "measures": [name],
                "test": test,
                "contrasts": [contrast],
            }
            for n, (name, test) in enumerate(REPORTED.items())
        ],
    }
    return msgspec.convert({**shipped_, **own}, StudyDefinition)


def reported(rng: Rng, study: StudyDefinition, people: int) -> dict[str, bool | None]:
    """Tell of each declared test of a study without any effect whether it is significant. Under one
    condition a third of the participants see the video and never move the robot; they are drawn
    again where each has one condition. Drives end at a time limit or early.
    """
    is_within = study.allocation.design == "within"
    participants, drives = [], []
    for number in range(people):
        who, order = f"P{number:03d}", ["a", "b"] if number % 2 else ["b", "a"]
        participants.append(ParticipantRecord(who, cell="-".join(order)))
        ability = float(rng.gamma(4.0, 0.25))
        planned = order if is_within else order[:1]
        for condition in planned:
            if condition == "b" and rng.random() < 1.0 / 3.0:
                drives.append(drive_of(who, condition, dict.fromkeys(ZEROS, 0.0), "left"))
                if is_within:
                    continue
                condition = "a"  # noqa: PLW2901 - drawn again
            seconds, ends = rng.exponential(200.0) / ability, min(480.0, rng.exponential(900.0))
            total = min(seconds, ends)
            values = {
                "total_time": total,
                "seen": 1.0,
                "completed": float(seconds <= ends),
                "stops": float(rng.poisson(rng.gamma(2.0, 0.02) * total)),
                "near_seconds": float(max(0.0, rng.normal(-5.0, 10.0)) * total / 300.0),
                "speed": float(0.2 + 0.05 * ability + rng.normal(0.0, 0.03)),
            }
            values |= {"task_time": seconds} if seconds <= ends else {}
            drives.append(
                drive_of(who, condition, values, "completed" if seconds <= ends else "left")
            )
    whole = Dataset(study, participants=tuple(participants), sessions=tuple(s for s, _ in drives))
    counted = counting(whole)
    kept = {one.id for one in counted.sessions}
    measured = [
        Measured(session, Milestones(), values, (), np.empty((0, 2)))
        for session, values in drives
        if session.id in kept
    ]
    tables = declared(counted, measured)
    found = {}
    for name, table_ in zip(REPORTED, tables, strict=True):
        p = table_.rows[0][table_.head.index("p")].value
        found[name] = None if p is None else p < 0.05
    return found


ZEROS = ("path", "speed", "stops", "collisions", "near_seconds", "completed", "total_time", "seen")


def drive_of(
    who: str, condition: str, known: dict[str, float], outcome: str
) -> tuple[SessionRecord, dict[str, float]]:
    """Return a drive with its metrics; without a total time, the robot was never moved."""
    session = SessionRecord(
        f"{who}-{condition}",
        who,
        "giraff",
        condition=condition,
        outcome=outcome,
        first_frame=0.0,
        first_motion=1.0 if known["total_time"] else float("nan"),
        ended=known["total_time"] or 39.0,
    )
    return session, {column.name: float("nan") for column in METRICS} | known


# --- type I error ---------------------------------------------------------------------------------


def _normal(rng: Rng, *groups: tuple[int, float]) -> Test:
    return compared(*(rng.normal(0.0, sd, n) for n, sd in groups))


def _crossed(family: Family, drives: Drives) -> dict[str, bool | None]:
    return terms(family_model(family, drives), "delay", "delay:help")


def _two_each(drives: Drives) -> Drives:
    return [[*drives[0], *drives[1]], [*drives[2], *drives[3]]]


def _whole(values: Floats) -> Floats:
    return np.asarray(np.round(2.0 * values) / 2.0)


NULLS = (
    Case("Welch t", "n = 12 and 24, SD 3 and 1", lambda rng: _normal(rng, (12, 3.0), (24, 1.0))),
    Case(
        "Welch t",
        "counts, half of them 0, n = 16 each",
        lambda rng: compared(many_zeros(rng, 16), many_zeros(rng, 16)),
    ),
    Case(
        "Welch t, by ranks where a group does not vary",
        "80 % are best at everything, n = 12 each",
        lambda rng: compared(*(mostly_best(rng, 12, 0.8) for _ in range(2))),
    ),
    Case(
        "Welch F, by ranks where a group does not vary",
        "70 % are best at everything, four groups, n = 10 each",
        lambda rng: compared(*(mostly_best(rng, 10, 0.7) for _ in range(4))),
    ),
    Case(
        "paired t",
        "n = 20, SD 1 and 3, ties",
        lambda rng: compared(*_whole(correlated(rng, 20, (1.0, 3.0))).T, paired=True),
    ),
    Case(
        "Welch F",
        "four groups, n = 12 to 24, SD 4, 1, 2, 1",
        lambda rng: _normal(rng, (12, 4.0), (16, 1.0), (20, 2.0), (24, 1.0)),
    ),
    Case(
        "repeated-measures F",
        "n = 20, four conditions, SD 1, 1, 2, 4",
        lambda rng: compared(*correlated(rng, 20, (1.0, 1.0, 2.0, 4.0)).T, paired=True),
    ),
    Case(
        "Wilcoxon signed rank",
        "answers 1 to 5, n = 20: ties and zeros",
        lambda rng: compared(*answers(rng, 20, 2).T, paired=True, by="ranks"),
    ),
    Case(
        "Mann-Whitney U",
        "answers 1 to 5, n = 12 and 24",
        lambda rng: compared(answers(rng, 12, 1)[:, 0], answers(rng, 24, 1)[:, 0], by="ranks"),
    ),
    Case(
        "Kruskal-Wallis H",
        "counts, half of them 0, four groups, n = 14 each",
        lambda rng: compared(*many_zeros(rng, 4, 14), by="ranks"),
    ),
    Case(
        "Friedman χ²",
        "answers 1 to 5, n = 20, four conditions",
        lambda rng: compared(*answers(rng, 20, 4).T, paired=True, by="ranks"),
    ),
    Case(
        "Spearman ρ",
        "n = 24, answers 1 to 5 and counts, half of them 0",
        lambda rng: correlation(answers(rng, 24, 1)[:, 0], many_zeros(rng, 24)),
    ),
    Case("N−1 χ², Boschloo", "90 % complete, n = 24 and 40", lambda rng: shares(rng, 0.9, 0.9)),
    Case(
        "N−1 χ²",
        "85 % complete, four groups, n = 24 each",
        lambda rng: compared(*successes(rng, 24, 4, 0.85, paired=False).T, by="proportions"),
    ),
    Case(
        "McNemar mid-p",
        "75 % complete, n = 40",
        lambda rng: by_drives("proportions", completed(rng, 40, 2, 0.75)),
    ),
    Case(
        "Cochran Q",
        "80 % complete, n = 24, four conditions",
        lambda rng: by_drives("proportions", completed(rng, 24, 4, 0.8)),
    ),
    Case(
        "score F (logistic), of a contrast",
        "75 % complete, n = 30, two drives on each side",
        lambda rng: by_drives("proportions", _two_each(completed(rng, 30, 4, 0.75))),
    ),
    Case(
        "score F (logistic)",
        "75 % complete, n = 30, 2 × 2 within",
        lambda rng: _crossed("proportions", completed(rng, 30, 4, 0.75)),
    ),
    Case(
        "score F (Poisson), of two groups",
        "stops, overdispersed, n = 20 each, drives of 1 to 8 min",
        lambda rng: by_drives("counts", stops(rng, 20, 2, paired=False)),
    ),
    Case(
        "score F (Poisson), of a contrast within",
        "the same, n = 20",
        lambda rng: by_drives("counts", stops(rng, 20, 2, paired=True)),
    ),
    Case(
        "score F (Poisson), of four conditions within",
        "the same, n = 24",
        lambda rng: by_drives("counts", stops(rng, 24, 4, paired=True)),
    ),
    Case(
        "score F (Poisson)",
        "the same, n = 24, 2 × 2 within",
        lambda rng: _crossed("counts", stops(rng, 24, 4, paired=True)),
    ),
    Case(
        "log-rank χ²",
        "n = 20 each, 20 % time-outs, 10 % left",
        lambda rng: by_drives("times", times(rng, 20, 2, paired=False)),
    ),
    Case(
        "log-rank χ²",
        "four groups, n = 16 each",
        lambda rng: by_drives("times", times(rng, 16, 4, paired=False)),
    ),
    Case(
        "score F (Cox), of a contrast within",
        "n = 24, 20 % time-outs, 10 % left",
        lambda rng: by_drives("times", times(rng, 24, 2, paired=True)),
    ),
    Case(
        "score F (Cox), of four conditions within",
        "the same",
        lambda rng: by_drives("times", times(rng, 24, 4, paired=True)),
    ),
    Case(
        "score F (Cox)",
        "the same, 2 × 2 within",
        lambda rng: _crossed("times", times(rng, 24, 4, paired=True)),
    ),
    Case(
        "Wald F (mixed)",
        "2 × 2 within, n = 16, pure interaction, one SD is 3",
        lambda rng: terms(two_by_two(rng, 16), "delay", "help"),
    ),
    Case(
        "Wald F (mixed)",
        "the same, 15 % of the drives missing",
        lambda rng: terms(two_by_two(rng, 16, missing=0.15), "delay"),
    ),
    Case(
        "Wald F (mixed)",
        "four levels, SD 1, 1, 2, 4, an effect of the round, n = 20",
        lambda rng: terms(four_levels(rng, 20), "condition"),
    ),
    Case(
        "Wald F (mixed)",
        "the same, 10 % of the drives missing",
        lambda rng: terms(four_levels(rng, 20, missing=0.1), "condition"),
    ),
    Case(
        "Wald F (mixed)",
        "groups of 12 and 24, SD 2 and 1, three conditions",
        lambda rng: terms(
            groups_by_conditions(rng, 12, 24, 2.0), "group", "condition", "group:condition"
        ),
    ),
    Case(
        "Wald F (mixed), of all conditions",
        "four conditions, two of groups of 16 and 20 each, SD 1 and 2",
        lambda rng: of_two_kinds(rng, 16, 20),
    ),
    Case(
        "Wald F (mixed)",
        "groups of 12 and 24 with a covariate (age), SD 4 and 2",
        lambda rng: terms(with_age(rng, 36), "delay"),
    ),
)


REPORTS = (
    Case(
        "whole report",
        "between, n = 48; a third of one condition never move the robot, and get another draw",
        lambda rng: reported(rng, BETWEEN, 48),
    ),
    Case(
        "whole report",
        "within, n = 40; a third never move the robot under one condition",
        lambda rng: reported(rng, WITHIN, 40),
    ),
)
BETWEEN, WITHIN = reported_study(within=False), reported_study(within=True)


# --- coverage -------------------------------------------------------------------------------------


def _unequal(rng: Rng) -> dict[str, bool | None]:
    found = compared(rng.normal(2.0, 3.0, 12), rng.normal(0.0, 1.0, 24))
    d = 2.0 / float(np.sqrt(5.0))
    return {"difference": holds(found.difference, 2.0), "d": holds(found.effect, d)}


def _pairs(rng: Rng) -> dict[str, bool | None]:
    values = correlated(rng, 20, (1.0, 3.0)) + np.array([1.5, 0.0])
    found = compared(*values.T, paired=True)
    return {
        "difference": holds(found.difference, 1.5),
        "d_z": holds(found.effect, 1.5 / float(np.sqrt(7.0))),
        "Hodges-Lehmann": holds(compared(*values.T, paired=True, by="ranks").difference, 1.5),
    }


def _skewed(rng: Rng, shift: float) -> Test:
    return compared(rng.gamma(2.0, 1.0, 14) + shift, rng.gamma(2.0, 1.0, 20), by="ranks")


def _placed(rng: Rng) -> Test:
    """Two groups with different SD, of which the first is greater in 76 % of all pairs."""
    return compared(rng.normal(1.0, 1.3, 16), rng.normal(0.0, 0.6, 24), by="ranks")


PLACED = float(2.0 * scipy.special.ndtr(1.0 / np.hypot(1.3, 0.6)) - 1.0)
RHO = 0.5


def _spearman(rng: Rng) -> Test:
    x, y = rng.multivariate_normal((0.0, 0.0), ((1.0, RHO), (RHO, 1.0)), 30).T
    return correlation(x, np.exp(y))


def _paired_shares(rng: Rng) -> Test:
    latent = 0.7 * rng.standard_normal((40, 1)) + np.sqrt(0.51) * rng.standard_normal((40, 2))
    completed_ = (latent < scipy.special.ndtri([0.9, 0.7])).astype(np.float64)
    return by_drives("proportions", drives_of(*completed_.T))


def _ratio(family: Family, drives: Drives) -> bool | None:
    return holds(by_drives(family, drives, with_ratio=True).effect, 2.0)


def _wilson(rng: Rng, share: float, n: int) -> bool | None:
    low, high = wilson(int(rng.binomial(n, share)), n) or (np.nan, np.nan)
    return bool(low <= share <= high)


def _mean(rng: Rng, *, interval: str) -> bool | None:
    x = rng.normal(0.0, 1.0, 20 if interval == "t" else 60)
    slack = half_width(float(x.std(ddof=1)), len(x), 0.95, interval)  # type: ignore[arg-type]
    return slack is not None and abs(float(x.mean())) <= slack


LOADINGS = np.array([0.8, 0.7, 0.6, 0.5, 0.7])
OMEGA = float(LOADINGS.sum() ** 2 / (LOADINGS.sum() ** 2 + (1.0 - LOADINGS**2).sum()))
EQUAL = 0.7  # loading of each of five parallel items
ALPHA = float(25 * EQUAL**2 / (25 * EQUAL**2 + 5 * (1.0 - EQUAL**2)))


def _items(rng: Rng, loadings: Floats, n: int) -> Floats:
    own = rng.standard_normal((n, len(loadings))) * np.sqrt(1.0 - loadings**2)
    return np.asarray(rng.standard_normal((n, 1)) * loadings + own)


def _omega(rng: Rng) -> bool | None:
    try:
        found = mcdonald(_items(rng, LOADINGS, 60))
    except UndefinedCoefficientError:
        return None
    return holds(found[0], OMEGA)


def _alpha(rng: Rng) -> bool | None:
    return holds(cronbach(_items(rng, np.full(5, EQUAL), 30)), ALPHA)


def _coefficient(model: FittedModel | None, name: str, true: float) -> bool | None:
    if model is None:
        return None
    return holds(next(one.estimate for one in model.coefficients if one.name == name), true)


INTERVALS = (
    Case("two groups", "n = 12 and 24, SD 3 and 1", _unequal),
    Case("pairs", "n = 20, SD 1 and 3", _pairs),
    Case(
        "Hodges-Lehmann, groups",
        "skewed, n = 14 and 20",
        lambda rng: holds(_skewed(rng, 1.0).difference, 1.0),
    ),
    Case(
        "r, groups", "n = 16 and 24, SD 1.3 and 0.6", lambda rng: holds(_placed(rng).effect, PLACED)
    ),
    Case(
        "ρ",
        "n = 30, skewed",
        lambda rng: holds(_spearman(rng).effect, float(6.0 / np.pi * np.arcsin(RHO / 2.0))),
    ),
    Case(
        "difference of proportions, groups",
        "90 and 70 %, n = 24 and 40",
        lambda rng: holds(shares(rng, 0.9, 0.7).difference, 0.2),
    ),
    Case(
        "difference of proportions, pairs",
        "90 and 70 %, n = 40",
        lambda rng: holds(_paired_shares(rng).difference, 0.2),
    ),
    Case("share (Wilson)", "80 %, n = 30", lambda rng: _wilson(rng, 0.8, 30)),
    Case(
        "rate ratio, groups",
        "stops, ratio 2, n = 20 each",
        lambda rng: _ratio("counts", stops(rng, 20, 2, 2.0, paired=False)),
    ),
    Case(
        "rate ratio, within",
        "the same, n = 20",
        lambda rng: _ratio("counts", stops(rng, 20, 2, 2.0, paired=True)),
    ),
    Case(
        "hazard ratio, groups",
        "ratio 2, n = 24 each, time-outs",
        lambda rng: _ratio("times", times(rng, 24, 2, 2.0, paired=False)),
    ),
    Case("mean, Student's t", "n = 20", lambda rng: _mean(rng, interval="t")),
    Case("mean, normal", "n = 60", lambda rng: _mean(rng, interval="normal")),
    Case("Cronbach's α", "five parallel items, n = 30", _alpha),
    Case("McDonald's ω", "five items, n = 60", _omega),
    Case(
        "coefficient, mixed model",
        "2 × 2 within, n = 16, one SD is 3, 15 % of the drives missing",
        lambda rng: _coefficient(two_by_two(rng, 16, missing=0.15), "delay none:help alone", 1.0),
    ),
    Case(
        "coefficient, mixed model",
        "groups of 12 and 24, SD 3 and 1",
        lambda rng: _coefficient(groups_by_conditions(rng, 12, 24, 3.0), "group novice", 0.0),
    ),
)


# --- tables ---------------------------------------------------------------------------------------


def rates(case: Case, runs: int) -> dict[str, tuple[float, float]]:
    """Return how often a null was rejected, or an interval held the true value, in per cent of the
    studies that had one, and the per cent of studies that had one, by name.
    """
    rng = np.random.default_rng([SEED, zlib.crc32(f"{case.what}|{case.data}".encode())])
    found: dict[str, list[bool]] = {}
    for _ in range(runs):
        result = case.run(rng)
        if isinstance(result, Test):
            result = result.p < 0.05 if result.is_known else None
        for name, one in (result if isinstance(result, dict) else {"": result}).items():
            found.setdefault(name, []).extend([] if one is None else [one])
    return {
        name: (100.0 * float(np.mean(own)) if own else float("nan"), 100.0 * len(own) / runs)
        for name, own in found.items()
    }


def table(cases: Sequence[Case], bounds: tuple[float, float], runs: int, head: str) -> int:
    """Print a table in Markdown, and return how many rates are out of bounds."""
    print(f"| {head} | data | % | studies with it, % |\n| --- | --- | --- | --- |", flush=True)
    missed = 0
    for case in cases:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = rates(case, runs)
        for name, (share, tested) in found.items():
            is_out = not bounds[0] <= share <= bounds[1]
            missed += is_out
            what = ", ".join(filter(None, (case.what, name)))
            mark = " (out of bounds)" if is_out else ""
            print(f"| {what} | {case.data} | {share:.1f}{mark} | {tested:.0f} |", flush=True)
    return missed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--only", default="", help="of cases whose name has these words")
    wanted = parser.parse_args()
    missed = 0
    parts = ((*NULLS, *REPORTS), REJECTED, "test"), (INTERVALS, HELD, "interval of")
    for cases, bounds, head in parts:
        own = [one for one in cases if wanted.only in f"{head}: {one.what}"]
        missed += table(own, bounds, wanted.runs, head) if own else 0
        print()
    return missed


if __name__ == "__main__":
    sys.exit(main())
