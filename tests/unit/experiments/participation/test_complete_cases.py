"""Who leaves a study of several conditions before the last is replaced, so that the complete cases
of the orders stay even.

A month of a study is simulated on the code that assigns participants: they come one after the
other, drive the first condition, and one in five leaves after it, half of them without a word.
"""

import random
from collections import Counter
from dataclasses import dataclass, field

import pytest

from experiments.definition.schema import Allocation, Refill
from experiments.participation.assignment import (
    Cell,
    Held,
    balanced,
    choose,
    stage_at_end,
    stage_now,
)
from tests.support.examples import repetitions

MONTHS, PARTICIPANTS, DROP_OUT = repetitions(12, thorough=50), 200, 0.2
MONTH_HOURS = 30 * 24.0
SURE = Allocation(best_probability=1.0)


@dataclass
class Person:
    cell: Cell
    seen: float
    rounds: int = 0
    stage: str = "under_way"
    withdrew: bool = False


@dataclass
class Month:
    """The participants of one simulated month, and what the assignment knows of them."""

    rng: random.Random
    cells: list[Cell]
    waits: float  # hours after which an absent participant counts as having left
    people: list[Person] = field(default_factory=list)

    def held(self, now):
        for one in self.people:
            rounds = {"conditions": len(one.cell.conditions)}
            rounds["done"] = 0 if one.withdrew else one.rounds
            has_left = one.withdrew or now - one.seen > self.waits
            yield Held(one.cell.key, stage_now(one.stage, **rounds, is_gone=has_left))

    def comes(self, now):
        """A participant drives one condition, then leaves or drives the others."""
        choice = choose(self.cells, self.held(now), SURE, self.rng.getrandbits(31))
        one = Person(choice.cell, now)
        self.people.append(one)
        self.drives(one, now)
        if self.rng.random() < DROP_OUT:
            one.withdrew = self.rng.random() < 0.5
            return
        while one.rounds < len(one.cell.conditions):
            self.drives(one, now)

    def drives(self, one, now):
        one.rounds, one.seen = one.rounds + 1, now
        one.stage = stage_at_end("completed", Refill(), 0)

    def worst(self):
        complete = Counter({cell.key: 0 for cell in self.cells})
        complete.update(
            one.cell.key for one in self.people if one.rounds == len(one.cell.conditions)
        )
        assert sum(complete.values()) > 0.7 * PARTICIPANTS
        return max(complete.values()) - min(complete.values())


def differences(orders, waits):
    """The greatest difference of complete cases between two orders, a run each."""
    cells = [Cell("-".join(order), order) for order in orders]
    found = []
    for run in range(MONTHS):
        month = Month(random.Random(run), cells, waits)
        now = 0.0
        for _ in range(PARTICIPANTS):
            now += month.rng.expovariate(PARTICIPANTS / MONTH_HOURS)
            month.comes(now)
        found.append(month.worst())
    return found


@pytest.mark.parametrize("conditions", ["ab", "abcd"])
def test_complete_cases_of_the_orders_differ_by_at_most_3_in_any_month_with_drop_out(conditions):
    assert max(differences(balanced(conditions), Allocation().left_after_hours)) <= 3


@pytest.mark.slow
def test_cells_differ_far_more_if_absence_never_frees_a_place():
    assert max(differences(balanced("ab"), float("inf"))) > 6
