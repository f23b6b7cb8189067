"""Who gets which condition: at the first grant of the robot, or when they come to instructions that
only some conditions have, to the cell that has the fewest.

A *cell* is what a participant is assigned to: one condition (between participants), or one order of
conditions (within them). A place in it is held from then on, and is

- freed only when its visitor left before the first velocity was applied: nothing was done to them.
  Participants who have read what only their condition says keep it, for as long as the study waits;
- filled by every other ending, whose outcome counts in the cell;
- filled and yet given to another when the study's frozen rule says so of its outcome, as often as
  the rule allows;
- left, where a participant is to do several conditions, by one who is gone before they had them
  all: such a place is given to another, so that the *complete cases* of the orders are even.
  Whether somebody is gone is asked anew each time; who comes back goes on in their place.

With all participants drawn to the smallest cell, the numbers of filled places never differ by more
than the greatest number of participants that were under way at once: the last one who filled the
largest cell was drawn when it was not larger than any other, and only those under way at that
moment, less than all by that one, can have left since. (A refill rule frees places too, at the
moment in which they would be filled, and changes nothing in this.)
tests/unit/experiments/participation/test_assignment.py tries it.

Pure: what is held comes in, a choice goes out. Ties are drawn with a seed that is kept with the
choice.
"""

import random
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Literal

from experiments.definition.factors import groups
from experiments.definition.schema import Outcome, Refill, StudyDefinition

Access = Literal["open", "invitation"]
Stage = Literal["under_way", "freed", "filled", "refilled", "left"]


@dataclass(frozen=True)
class Cell:
    """What a participant is assigned to: the keys of conditions, in the order in which they are
    done.
    """

    key: str
    conditions: tuple[str, ...]


@dataclass(frozen=True)
class Held:
    """A place in a cell, and what became of it."""

    cell: str
    stage: Stage = "under_way"


@dataclass(frozen=True)
class AssignmentChoice:
    """The cell of a participant, the ones that it was drawn from, and the seed
    that draws it again.
    """

    cell: Cell
    candidates: tuple[str, ...]
    seed: int


def cells(study: StudyDefinition, access: Access = "open") -> tuple[Cell, ...]:
    """Return the cells that somebody who came by an open link, or by invitation, can be assigned
    to. In a mixed design they are the orders within each cell of the between factors.
    """
    several = [[condition.key for condition in group] for group in groups(study, access)]
    if study.allocation.design == "between":
        return tuple(Cell(key, (key,)) for keys in several for key in keys)
    orders = {"fixed": _as_written, "all": _all_orders, "balanced": balanced}[
        study.allocation.order
    ]
    return tuple(Cell("-".join(order), order) for keys in several for order in orders(keys))


def _as_written(keys: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    return (tuple(keys),) if keys else ()


def _all_orders(keys: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    return tuple(permutations(keys)) if keys else ()


def balanced(keys: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return orders in which each condition stands as often in each place, and follows each other
    one as often.

    Williams, "Experimental designs balanced for the estimation of residual effects of treatments",
    1949: n orders when n is even; when it is odd, they and their reverses.
    """
    count = len(keys)
    if count == 0:
        return ()
    first = [0]
    for step in range(1, count):
        first.append((first[-1] + (step if step % 2 else -step)) % count)
    rows = [tuple(keys[(number + shift) % count] for number in first) for shift in range(count)]
    if count % 2 and count > 1:
        rows += [tuple(reversed(row)) for row in rows]
    return tuple(rows)


def choose(
    offered: Sequence[Cell], held: Iterable[Held], quota: int | None, seed: int
) -> AssignmentChoice | None:
    """Return the cell for a new participant; None when all are full.

    Args:
        offered: the cells that they may get.
        held: every place of the study that is, or was, held.
        quota: how many places a cell has; None is no end.
        seed: draws among cells with equally few. Take a new one each time, and keep it.
    """
    loads = load(held)
    free = [cell for cell in offered if quota is None or loads[cell.key] < quota]
    if not free:
        return None
    least = min(loads[cell.key] for cell in free)
    candidates = [cell for cell in free if loads[cell.key] == least]
    drawn = random.Random(seed).choice(candidates)
    return AssignmentChoice(drawn, tuple(cell.key for cell in candidates), seed)


def load(held: Iterable[Held]) -> Counter[str]:
    """Return how many places of each cell are taken: filled, or under way."""
    return Counter(place.cell for place in held if place.stage in {"under_way", "filled"})


def stage_at_end(
    cell: str, outcome: Outcome, *, exposed: bool, refill: Refill, held: Iterable[Held]
) -> Stage:
    """Return what becomes of a place whose participant is done, or gone.

    Args:
        cell: where the place is.
        outcome: of the session that ended it.
        exposed: whether a velocity of theirs was ever applied.
        refill: the study's rule.
        held: every place of the study, for the number of those refilled before.
    """
    if not exposed:
        return "freed"
    if outcome not in refill.outcomes:
        return "filled"
    before = sum(place.stage == "refilled" and place.cell == cell for place in held)
    return "refilled" if before < refill.most else "filled"


def stage_now(
    stage: Stage, *, conditions: int, done: int, is_gone: bool, is_told: bool = False
) -> Stage:
    """Return the stage of a place as it counts now.

    Args:
        stage: as it was stored.
        conditions: how many the participant is to do.
        done: in how many of them they drove.
        is_gone: whether they withdrew, or were not seen for as long as the study waits.
        is_told: whether they were assigned before they drove, to read their instructions.
    """
    is_taken = stage in {"under_way", "filled"}
    may_leave = conditions > 1 or is_told
    return "left" if may_leave and is_taken and is_gone and done < conditions else stage
