"""Which participant gets which condition. They are drawn at the first grant of the robot, or before
instructions that only some conditions have, preferably for the cell that has the fewest.

A *cell* is what a participant is assigned to: one condition (between participants), or one order of
conditions (within them). A participant then holds a place in it, which is

- freed only when the participant left without having seen the robot's video, in practice or in the
  task, or anything else that only their condition has. They are drawn again if they return;
- filled by every other ending, whose outcome counts in the cell;
- refilled: filled and yet given to another participant, when the study's frozen rule says so of its
  outcome, as often as the rule allows;
- left, where a participant has several conditions to do, or learned of theirs before the task (from
  practice, too), and is gone before being exposed to all of them in the task: such a place is given
  to another, so that the *complete cases* of the orders are even. Whether someone is gone is
  computed each time; those who return keep their place.

Smallest first alone would be predictable: of two cells, every second participant's would be known
beforehand. So the best cell is only the most probable one (a biased coin, Efron, "Forcing a
sequential experiment to be balanced", 1971), and the counts can be of alike participants
(minimization after Pocock and Simon, "Sequential treatment assignment with balancing for prognostic
factors in the controlled clinical trial", 1975, with the totals of all cells as in Altman and
Bland, "Treatment allocation by minimisation", 2005).

With `best_probability` 1 and no factors, the numbers of filled places never differ by more than the
greatest number of participants in progress at once. When the last participant of the largest cell
was drawn, no other cell was smaller; since then, cells can only have lost the places of the other
participants who were in progress at that moment. (A refill rule frees places when they would be
filled, which does not change this.) tests/unit/experiments/participation/test_assignment.py checks
it, and simulates how predictable and how uneven other probabilities are.

Pure: a function of the places that are held, and of a seed that is stored with the choice.
"""

import random
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Literal

from experiments.definition.factors import groups
from experiments.definition.schema import (
    Allocation,
    BalanceFactor,
    Outcome,
    Refill,
    StudyDefinition,
)

Access = Literal["open", "invitation"]
Stage = Literal["under_way", "freed", "filled", "refilled", "left"]


@dataclass(frozen=True)
class Cell:
    """A cell: the keys of conditions, in the order in which they are done."""

    key: str
    conditions: tuple[str, ...]


@dataclass(frozen=True)
class Held:
    """A place in a cell, with its participant's level of each balance factor."""

    cell: str
    stage: Stage = "under_way"
    levels: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class AssignmentChoice:
    """The cell of a participant, and the facts from which the choice can be repeated."""

    cell: Cell
    best: tuple[str, ...]
    counts: Mapping[str, int]
    scores: Mapping[str, int]
    seed: int


def cells(study: StudyDefinition, access: Access = "open") -> tuple[Cell, ...]:
    """Return the cells for participants with an open link, or with an invitation. In a mixed design
    they are the orders within each cell of the between factors.
    """
    several = [[condition.key for condition in group] for group in groups(study, access)]
    if study.allocation.design == "between":
        return tuple(Cell(key, (key,)) for keys in several for key in keys)
    orders = ORDERS[study.allocation.order]
    return tuple(Cell("-".join(one), one) for keys in several if keys for one in orders(keys))


def balanced(keys: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return orders in which each condition is equally often in each position, and equally often
    after each other one: n orders when n is even; when it is odd, they and their reverses
    (Williams, "Experimental designs balanced for the estimation of residual effects of treatments",
    1949).
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


ORDERS: Mapping[str, Callable[[Sequence[str]], Iterable[tuple[str, ...]]]] = {
    "fixed": lambda keys: (tuple(keys),),
    "all": permutations,
    "balanced": balanced,
}


def choose(
    offered: Sequence[Cell],
    held: Iterable[Held],
    allocation: Allocation,
    seed: int,
    levels: Mapping[str, str] | None = None,
) -> AssignmentChoice | None:
    """Return the cell for a new participant; None when all are full. `held` has every place of the
    study that is, or was, held; `levels` the participant's level of each balance factor, by its
    item. `seed` is to be new each time, and stored.
    """
    held = list(held)
    taken = load(held)
    free = open_cells(offered, taken, allocation.quota)
    if not free:
        return None
    alike = [load(some) for some in _alike(held, allocation, levels or {})]
    scores = {cell.key: sum(counts[cell.key] for counts in alike) for cell in free}
    least = min(scores.values())
    best = [cell for cell in free if scores[cell.key] == least]
    others = [cell for cell in free if scores[cell.key] > least]
    chance = random.Random(seed)
    is_best = not others or chance.random() < allocation.best_probability
    drawn = chance.choice(best if is_best else others)
    counts = {cell.key: taken[cell.key] for cell in free}
    return AssignmentChoice(drawn, tuple(cell.key for cell in best), counts, scores, seed)


def open_cells(offered: Sequence[Cell], taken: Mapping[str, int], quota: int | None) -> list[Cell]:
    return [cell for cell in offered if quota is None or taken[cell.key] < quota]


def _alike(
    held: Sequence[Held], allocation: Allocation, levels: Mapping[str, str]
) -> Iterator[list[Held]]:
    """Yield the places that count for a participant with these levels: all of them, those of
    participants alike in every factor, or for each factor those alike in it.
    """
    items = [factor.item for factor in allocation.balance]
    is_minimized = items and allocation.balancing == "minimization"
    for some in [[item] for item in items] if is_minimized else [items]:
        own = [levels.get(item) for item in some]
        yield [place for place in held if [place.levels.get(item) for item in some] == own]


def level_of(factor: BalanceFactor, value: object) -> str:
    """Return the level of a factor to which an answer belongs; empty without an answer."""
    if value is None or value == "":
        return ""
    if not factor.limits or isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    passed = [limit for limit in sorted(factor.limits) if value >= limit]
    return f"from {passed[-1]:g}" if passed else f"below {min(factor.limits):g}"


def load(held: Iterable[Held]) -> Counter[str]:
    """Return how many places of each cell are taken: filled, or under way."""
    return Counter(place.cell for place in held if place.stage in {"under_way", "filled"})


def stage_at_end(outcome: Outcome, refill: Refill, refilled: int) -> Stage:
    """Return the stage of the place of an exposed participant after their drive; `refilled` counts
    the places of the cell that were given to others before.
    """
    is_passed_on = outcome in refill.outcomes and refilled < refill.most
    return "refilled" if is_passed_on else "filled"


def stage_now(
    stage: Stage, *, conditions: int, done: int, is_gone: bool, knows_condition: bool = False
) -> Stage:
    """Return the stage of a place as it counts now, of a participant who is to do a number of
    `conditions` and was exposed to `done` of them; `is_gone` tells whether they withdrew, or were
    not seen for as long as the study waits, `knows_condition` whether they learned of their
    condition before the video of the task.
    """
    is_taken = stage in {"under_way", "filled"}
    may_leave = conditions > 1 or knows_condition
    return "left" if may_leave and is_taken and is_gone and done < conditions else stage
