"""Factors and their crossing: which conditions one participant may have, and what is wrong with the
cells of a design. Pure.

A condition is one cell: it has one level of each factor. A factor is *within* when a participant
has all of its levels, *between* when they have one; a study with both kinds is a mixed design.
"""

from collections.abc import Iterator, Sequence
from itertools import product

from experiments.definition.design import Factor
from experiments.definition.schema import Condition, StudyDefinition
from surveys.documents import duplicates

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


def problems(study: StudyDefinition) -> Iterator[str]:
    """Yield what is wrong with the factors of a study and their cells."""
    yield from duplicates("factor", (factor.key for factor in study.factors))
    for factor in study.factors:
        if len(factor.levels) < LEAST_LEVELS:
            yield f"Factor {factor.key}: it needs at least {LEAST_LEVELS} levels."
        for told in duplicates("level", (level.key for level in factor.levels)):
            yield f"Factor {factor.key}: {told}"
    wrong = list(_of_levels(study))
    yield from wrong
    if study.factors and not wrong:
        yield from _of_cells(study)
    yield from _of_design(study)


def _of_levels(study: StudyDefinition) -> Iterator[str]:
    known = {factor.key: [level.key for level in factor.levels] for factor in study.factors}
    for condition in study.conditions:
        for key, levels in known.items():
            own = condition.levels.get(key, "")
            if not own:
                yield f"Condition {condition.key}: choose its level of the factor {key}."
            elif own not in levels:
                yield f"Condition {condition.key}: the factor {key} has no level {own}."
        for key in condition.levels:
            if key not in known:
                yield f"Condition {condition.key}: there is no factor {key}."


def _of_cells(study: StudyDefinition) -> Iterator[str]:
    wanted = product(*([(one.key, level.key) for level in one.levels] for one in study.factors))
    first: dict[tuple[tuple[str, str], ...], str] = {}
    for condition in study.conditions:
        cell = cell_of(condition, study.factors)
        if cell in first:
            yield (
                f"Condition {condition.key}: it has the same levels as the condition"
                f" {first[cell]}; each cell of the factors needs exactly one condition."
            )
        first.setdefault(cell, condition.key)
    for cell in wanted:
        if cell not in first:
            named = ", ".join(f"{factor} {level}" for factor, level in cell)
            yield f"No condition has {named}; each cell of the factors needs exactly one condition."


def cell_of(condition: Condition, factors: Sequence[Factor]) -> tuple[tuple[str, str], ...]:
    """Return the levels of a condition, in the order of the factors."""
    return tuple((factor.key, condition.levels.get(factor.key, "")) for factor in factors)


def _of_design(study: StudyDefinition) -> Iterator[str]:
    within = [factor.key for factor in study.factors if factor.design == "within"]
    if study.factors and (study.allocation.design == "within") != bool(within):
        wanted = "within" if within else "between"
        yield (
            f"The assignment must be {wanted} participants, because"
            f" {f'the factor {within[0]} is' if within else 'all factors are between'}."
        )
    if study.allocation.design != "within":
        return
    most = MOST_PERMUTED if study.allocation.order == "all" else MOST_ORDERED
    for access in ("open", "invitation"):
        for group in groups(study, access):
            if len(group) > most:
                yield (
                    f"{len(group)} conditions for each participant; at most {most} can be ordered."
                )
    yield from _of_access(study)


def _of_access(study: StudyDefinition) -> Iterator[str]:
    """A participant has every level of a within factor, so its conditions are open to the same
    people.
    """
    if not any(factor.design == "within" for factor in study.factors):
        return
    ways: dict[tuple[str, ...], set[str]] = {}
    for condition in study.conditions:
        ways.setdefault(_between_cell(study, condition), set()).add(condition.access)
    if any(len(one) > 1 for one in ways.values()):
        yield (
            "The assignment gives a participant every level of a within factor: all conditions of"
            " one participant must have the same access (open, or by invitation)."
        )


def _between_cell(study: StudyDefinition, condition: Condition) -> tuple[str, ...]:
    apart = (factor.key for factor in study.factors if factor.design == "between")
    return tuple(condition.levels.get(key, "") for key in apart)
