"""The power of a study by numbers of participants, and the least number that is enough."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from experiments.analysis.power.draws import REASONS, Assumption, Orders, assumed
from experiments.analysis.power.simulation import SimulatedStudies, simulate
from experiments.analysis.statistics.descriptive import wilson
from experiments.analysis.tables.table import Table, number
from experiments.dataset.grouping import by_key
from experiments.definition.factors import conditions_together
from experiments.definition.plan import StudyPlan
from experiments.definition.schema import StudyDefinition

STUDIES = 2000  # that are simulated for each number of participants
MOST = 2000  # participants up to whom a number is looked for
LEAST = 4  # participants of a kind in the smallest study that is tried
HEAD = (
    *("Participants", "Analysis", "Measure", "Test", "Hypothesis", "Power"),
    *("Power: from", "Power: to"),
)
METHOD = (
    (
        "Power: the share of simulated studies in which p, corrected within the family in which the"
        " report corrects it, is below {alpha:g}, with its 95 % Monte-Carlo interval (Wilson),"
        " {studies} studies each. The families have all of their tests, also {null} that are"
        " assumed to have nothing to find and are not listed."
    ),
    (
        "Values are normal; answers are simulated as if continuous, measures as independent of each"
        " other, covariates as if they explained nothing, and nobody drops out. Participants: in"
        " all, spread evenly over the cells."
    ),
)


@dataclass(frozen=True)
class PowerOptions:
    seed: int = 1
    studies: int = STUDIES
    orders: Orders = field(default_factory=dict)


@dataclass(frozen=True)
class PowerReport:
    """Power by numbers of participants, and the least that is enough for every test of a
    hypothesis. `needed` is None above MOST and, without `is_searched`, if no test has anything to
    find.
    """

    simulations: tuple[SimulatedStudies, ...]
    needed: int | None
    is_searched: bool
    assumptions: Mapping[str, Assumption]


def power_report(
    study: StudyDefinition, participants: Sequence[int], options: PowerOptions
) -> PowerReport:
    """Return the power of a study for numbers of participants, and the least number that is enough
    for the tests that decide on hypotheses; without these, for all that have something to find.
    """

    def at(people: int) -> SimulatedStudies:
        return simulate(study, people, options.studies, options.seed, orders=options.orders)

    def least_power(people: int) -> float:
        found = at(people).power(plan.alpha)
        return min(found[n][0] / found[n][1] for n in deciding)

    plan = study.plan or StudyPlan()
    kinds = len(conditions_together(study))
    simulated = [at(max(one, 2 * kinds)) for one in dict.fromkeys(participants)]
    tests = (simulated[0] if simulated else at(LEAST * kinds)).tests
    known = [n for n, one in enumerate(tests) if not one.is_null]
    deciding = [n for n in known if tests[n].hypotheses] or known
    needed = least_participants(least_power, kinds, plan.power) if deciding else None
    if needed is not None and all(one.participants != needed for one in simulated):
        simulated.append(at(needed))
    measures = dict.fromkeys(one for it in study.analyses for one in it.measures)
    about = {one: assumed(study, one) for one in measures}
    return PowerReport(tuple(simulated), needed, bool(deciding), about)


def least_participants(
    power: Callable[[int], float], kinds: int, target: float, most: int = MOST
) -> int | None:
    """Return the least multiple of `kinds` whose power is at least `target`, or None above `most`;
    power is taken to grow with participants.
    """
    low, high = LEAST - 1, LEAST
    while power(high * kinds) < target:
        low, high = high, high * 2
        if low * kinds >= most:
            return None
        high = min(high, max(most // kinds, low + 1))
    while high - low > 1:
        middle = (low + high) // 2
        is_enough = power(middle * kinds) >= target
        low, high = (low, middle) if is_enough else (middle, high)
    return high * kinds


# --- the table ------------------------------------------------------------------------------------


def power_table(study: StudyDefinition, found: PowerReport, studies: int) -> Table:
    plan = study.plan or StudyPlan()
    rows = (row for one in found.simulations for row in _rows(one, plan.alpha))
    null = sum(one.is_null for one in found.simulations[0].tests) if found.simulations else 0
    method = [text.format(alpha=plan.alpha, studies=studies, null=null) for text in METHOD]
    notes = (_needed(found, plan), *_assumptions(study, found), *method, *REASONS)
    return Table.of("power", "Power by simulation.", HEAD, rows, notes)


def _rows(found: SimulatedStudies, alpha: float) -> Iterator[tuple[object, ...]]:
    for one, (hits, studies) in zip(found.tests, found.power(alpha), strict=True):
        if not one.is_null:
            names = (one.analysis, one.measure, one.label, ", ".join(one.hypotheses))
            shares = (hits / studies, *(wilson(hits, studies) or (None, None)))
            yield found.participants, *names, *(number(share, 3) for share in shares)


def _needed(found: PowerReport, plan: StudyPlan) -> str:
    if not found.is_searched:
        return "No difference is expected by any declared test, so no number is enough."
    which = "every test of a hypothesis" if plan.hypotheses else "every declared test"
    if found.needed is None:
        return f"Not even {MOST} participants give {which} a power of {plan.power:g}."
    return f"{found.needed} participants give {which} a power of at least {plan.power:g}."


def _assumptions(study: StudyDefinition, found: PowerReport) -> list[str]:
    texts = (
        (f"({one.source}): {_means(study, one)}; correlation {one.correlation:.2f}.", measure)
        for measure, one in found.assumptions.items()
    )
    return [f"{', '.join(names)} {text}" for text, names in by_key(texts).items()]


def _means(study: StudyDefinition, one: Assumption) -> str:
    if one.levels:
        return ", ".join(f"{key} {level:.4g}" for key, level in one.levels.items())
    if not one.means:
        return "0.5 SD between the sides of each test"
    return ", ".join(
        f"{it.key} {one.mean(it.key):.4g} (SD {one.sd(it.key):.4g})" for it in study.conditions
    )
