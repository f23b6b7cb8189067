"""Factors and their crossing: which conditions one participant may have, and what is wrong with the
cells of a design. Pure.

A condition is one cell: it has one level of each factor. A factor is *within* when a participant
has all of its levels, *between* when they have one; a study with both kinds is a mixed design.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product

from experiments.definition.design import Factor
from experiments.definition.schema import Condition, StudyDefinition
from surveys.documents import Problem, ProblemPlace, duplicates, within
from surveys.documents import gettext_noop as _

LEAST_LEVELS = 2
MOST_PERMUTED = 4  # conditions of which all orders are made: 24
MOST_ORDERED = 9  # conditions of one participant, in balanced or fixed order


def groups(study: StudyDefinition, access: str) -> tuple[tuple[Condition, ...], ...]:
    """Return the conditions that are open to people who came that way, in groups: of one group a
    participant has one condition (between) or all (within, or mixed designs).
    """
    found: dict[tuple[str, ...], list[Condition]] = {}
    for condition in study.conditions:
        if condition.access == access:
            found.setdefault(_between_cell(study, condition), []).append(condition)
    return tuple(tuple(one) for one in found.values())


def conditions_together(study: StudyDefinition) -> list[tuple[str, ...]]:
    """Return the keys of the conditions that one participant may have, a tuple for each kind of
    participant: one condition between participants, several within them.
    """
    found = [
        tuple(one.key for one in group)
        for access in ("open", "invitation")
        for group in groups(study, access)
    ]
    if study.allocation.design == "within":
        return found
    return [(key,) for group in found for key in group]


def problems(study: StudyDefinition) -> Iterator[Problem]:
    """Yield what is wrong with the factors of a study and their cells."""
    keys = (factor.key for factor in study.factors)
    yield from within(duplicates(_("Factor"), keys), ProblemPlace("factors"))
    for n, factor in enumerate(study.factors):
        place = ProblemPlace("factors", n)
        yield from within(_of_factor(factor), place, _("Factor"), factor.key)
    wrong = list(_of_levels(study))
    yield from wrong
    if study.factors and not wrong:
        yield from _of_cells(study)
    yield from within(_of_design(study), ProblemPlace("rules"))


def _of_factor(factor: Factor) -> Iterator[Problem]:
    if len(factor.levels) < LEAST_LEVELS:
        yield Problem(_("it needs at least %(n)d levels."), {"n": LEAST_LEVELS})
    yield from duplicates(_("Level"), (level.key for level in factor.levels))


def _of_levels(study: StudyDefinition) -> Iterator[Problem]:
    known = {factor.key: [level.key for level in factor.levels] for factor in study.factors}
    for n, condition in enumerate(study.conditions):
        yield from of_condition(n, condition, _of_own_levels(condition, known))


def of_condition(n: int, condition: Condition, found: Iterable[Problem]) -> Iterator[Problem]:
    """Yield problems as those of the condition with a number."""
    return within(found, ProblemPlace("conditions", n), _("Condition"), condition.key)


def _of_own_levels(condition: Condition, known: Mapping[str, list[str]]) -> Iterator[Problem]:
    for key, levels in known.items():
        own = condition.levels.get(key, "")
        if not own:
            yield Problem(_("choose its level of the factor %(key)s."), {"key": key})
        elif own not in levels:
            words = _("the factor %(key)s has no level %(level)s.")
            yield Problem(words, {"key": key, "level": own})
    for key in condition.levels:
        if key not in known:
            yield Problem(_("there is no factor %(key)s."), {"key": key})


def _of_cells(study: StudyDefinition) -> Iterator[Problem]:
    wanted = product(*([(one.key, level.key) for level in one.levels] for one in study.factors))
    first: dict[tuple[tuple[str, str], ...], str] = {}
    for n, condition in enumerate(study.conditions):
        cell = cell_of(condition, study.factors)
        if cell in first:
            words = _(
                "it has the same levels as the condition %(key)s; each cell of the factors needs "
                "exactly one condition."
            )
            yield from of_condition(n, condition, [Problem(words, {"key": first[cell]})])
        first.setdefault(cell, condition.key)
    for cell in wanted:
        if cell not in first:
            words = _(
                "No condition has %(levels)s; each cell of the factors needs exactly one condition."
            )
            named = {"levels": ", ".join(f"{factor} {level}" for factor, level in cell)}
            yield Problem(words, named, place=ProblemPlace("conditions"))


def cell_of(condition: Condition, factors: Sequence[Factor]) -> tuple[tuple[str, str], ...]:
    """Return the levels of a condition, in the order of the factors."""
    return tuple((factor.key, condition.levels.get(factor.key, "")) for factor in factors)


def _of_design(study: StudyDefinition) -> Iterator[Problem]:
    inside = [factor.key for factor in study.factors if factor.design == "within"]
    if study.factors and (study.allocation.design == "within") != bool(inside):
        if inside:
            words = _("The assignment must be within participants, because the factor %(key)s is.")
            yield Problem(words, {"key": inside[0]})
        else:
            words = _("The assignment must be between participants, because all factors are.")
            yield Problem(words)
    if study.allocation.design != "within":
        return
    most = MOST_PERMUTED if study.allocation.order == "all" else MOST_ORDERED
    for access in ("open", "invitation"):
        for group in groups(study, access):
            if len(group) > most:
                words = _("%(n)d conditions for each participant; at most %(most)d can be ordered.")
                yield Problem(words, {"n": len(group), "most": most})
    yield from _of_access(study)


def _of_access(study: StudyDefinition) -> Iterator[Problem]:
    """A participant has every level of a within factor, so its conditions are open to the same
    people.
    """
    if not any(factor.design == "within" for factor in study.factors):
        return
    ways: dict[tuple[str, ...], set[str]] = {}
    for condition in study.conditions:
        ways.setdefault(_between_cell(study, condition), set()).add(condition.access)
    if any(len(one) > 1 for one in ways.values()):
        words = _(
            "The assignment gives a participant every level of a within factor: all conditions of "
            "one participant must have the same access (open, or by invitation)."
        )
        yield Problem(words)


def _between_cell(study: StudyDefinition, condition: Condition) -> tuple[str, ...]:
    apart = (factor.key for factor in study.factors if factor.design == "between")
    return tuple(condition.levels.get(key, "") for key in apart)
