import random
from collections import Counter
from itertools import pairwise, permutations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.definition.schema import Refill
from experiments.definition.shipped import shipped
from experiments.participation.assignment import (
    Cell,
    Held,
    balanced,
    cells,
    choose,
    load,
    stage_at_end,
)
from tests.support.examples import examples
from tests.support.studies.studies import STUDY, small_study

NONE = Refill()


def within(count: int, order: str):
    conditions = [{**STUDY["conditions"][0], "key": f"c{n}"} for n in range(count)]
    return small_study(conditions=conditions, allocation={"design": "within", "order": order})


class Month:
    """A study that runs: so many participants under way at once, of whom some leave before they
    drive and some have a broken robot.
    """

    def __init__(
        self,
        names: list[str],
        leaving: dict[str, float],
        failing: float,
        *,
        seed: int,
        refill: Refill = NONE,
        quota: int | None = None,
    ) -> None:
        self.rng = random.Random(seed)
        self.offered = [Cell(name, (name,)) for name in names]
        self.leaving, self.failing, self.refill, self.quota = leaving, failing, refill, quota
        self.held: list[Held] = []
        self.under_way: list[int] = []
        self.exposed = Counter()

    def admit(self) -> bool:
        choice = choose(self.offered, self.held, self.quota, self.rng.getrandbits(32))
        if choice is None:
            return False
        self.under_way.append(len(self.held))
        self.held.append(Held(choice.cell.key))
        return True

    def finish_one(self) -> None:
        index = self.under_way.pop(self.rng.randrange(len(self.under_way)))
        cell = self.held[index].cell
        exposed = self.rng.random() >= self.leaving[cell]
        outcome = "robot_fault" if self.rng.random() < self.failing else "completed"
        self.exposed[cell] += exposed
        self.held[index] = Held(
            cell, stage_at_end(cell, outcome, exposed=exposed, refill=self.refill, held=self.held)
        )

    def count(self, *stages: str) -> Counter:
        return Counter({cell.key: 0 for cell in self.offered}) + Counter(
            place.cell for place in self.held if place.stage in stages
        )

    def difference(self) -> int:
        filled = [
            sum(place.cell == cell.key and place.stage == "filled" for place in self.held)
            for cell in self.offered
        ]
        return max(filled) - min(filled)


@pytest.mark.parametrize("most", [1, 4, 16])
@pytest.mark.parametrize(
    "leaving", [(0.1, 0.1), (0.1, 0.5), (0.5, 0.1, 0.3), (0.1, 0.2, 0.3, 0.4, 0.5, 0.5)]
)
def test_cells_differ_by_no_more_than_are_under_way_whoever_leaves(most, leaving):
    month = Month(
        names := [f"c{n}" for n in range(len(leaving))],
        dict(zip(names, leaving, strict=True)),
        0.0,
        seed=most,
    )
    for _ in range(300):
        while len(month.under_way) < most:
            month.admit()
        month.finish_one()
        assert month.difference() <= most
    assert sum(month.exposed.values()) > 100


@examples(60, thorough=600)
@given(
    leaving=st.lists(st.floats(0.1, 0.5), min_size=2, max_size=6),
    most=st.sampled_from([1, 4, 16]),
    failing=st.floats(0.0, 0.5),
    refills=st.integers(0, 20),
    seed=st.integers(0, 2**32 - 1),
    steps=st.lists(st.booleans(), max_size=200),
)
def test_whatever_happens_the_cells_stay_even_and_nobody_who_drove_is_lost_from_them(
    *, leaving, most, failing, refills, seed, steps
):
    names = [f"c{n}" for n in range(len(leaving))]
    refill = Refill(outcomes=("robot_fault",), most=refills) if refills else NONE
    month = Month(names, dict(zip(names, leaving, strict=True)), failing, seed=seed, refill=refill)
    greatest = 0
    for comes in steps:
        if comes and len(month.under_way) < most:
            month.admit()
        elif month.under_way:
            month.finish_one()
        greatest = max(greatest, len(month.under_way))
        assert month.difference() <= greatest
        loads = load(month.held)
        assert sum(loads.values()) == sum(
            place.stage in {"under_way", "filled"} for place in month.held
        )
    assert month.count("filled", "refilled") == +month.exposed
    assert all(number <= refills for number in month.count("refilled").values())


def test_a_quota_is_met_exactly_and_then_nobody_is_admitted():
    month = Month(
        ["a", "b", "c"],
        {"a": 0.4, "b": 0.1, "c": 0.5},
        0.3,
        seed=3,
        refill=Refill(outcomes=("robot_fault",), most=5),
        quota=7,
    )
    for _ in range(400):
        while len(month.under_way) < 4 and month.admit():
            pass
        if month.under_way:
            month.finish_one()
    assert not month.admit()
    assert month.count("filled") == {"a": 7, "b": 7, "c": 7}


def test_a_place_is_freed_only_when_nothing_moved():
    refill = Refill(outcomes=("connection_lost",), most=1)
    held = [Held("a", "refilled")]
    assert stage_at_end("a", "cancelled", exposed=False, refill=refill, held=[]) == "freed"
    assert stage_at_end("a", "cancelled", exposed=True, refill=refill, held=[]) == "filled"
    assert stage_at_end("a", "timed_out", exposed=True, refill=refill, held=[]) == "filled"
    assert stage_at_end("a", "connection_lost", exposed=True, refill=refill, held=[]) == "refilled"
    assert stage_at_end("a", "connection_lost", exposed=True, refill=refill, held=held) == "filled"
    assert (
        stage_at_end("b", "connection_lost", exposed=True, refill=refill, held=held) == "refilled"
    )


def test_ties_are_drawn_by_a_seed_that_draws_them_again():
    offered = [Cell(name, (name,)) for name in "abcd"]
    held = [Held("a"), Held("b", "freed"), Held("d", "filled")]
    choice = choose(offered, held, None, 7)
    assert choice.candidates == ("b", "c")
    assert choose(offered, held, None, choice.seed) == choice
    drawn = Counter(choose(offered, [], None, seed).cell.key for seed in range(4000))
    assert all(850 < drawn[name] < 1150 for name in "abcd")


def test_without_a_cell_nobody_is_assigned():
    assert choose([], [], None, 1) is None
    assert cells(small_study(), "invitation") == ()


def test_open_links_lead_to_open_conditions_and_invitations_to_the_others():
    paper = shipped()["exploration"]
    assert {cell.key for cell in cells(paper)} == {
        "giraff_open",
        "giraff_lab_closed",
        "giraff_lounge_closed",
    }
    assert {cell.key for cell in cells(paper, "invitation")} == {
        "rhodon_open",
        "rhodon_lab_closed",
        "rhodon_lounge_closed",
    }


def test_participants_who_do_every_condition_get_an_order_of_them():
    study = shipped()["assistance"]
    offered = cells(study)
    assert [cell.conditions for cell in offered] == [("alone", "assisted"), ("assisted", "alone")]


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_all_orders_are_all_and_the_fixed_order_is_as_written(count):
    keys = tuple(f"c{n}" for n in range(count))
    assert {cell.conditions for cell in cells(within(count, "all"))} == set(permutations(keys))
    assert [cell.conditions for cell in cells(within(count, "fixed"))] == [keys]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6])
def test_in_balanced_orders_each_condition_has_each_place_and_follows_each_other_equally_often(
    count,
):
    rows = balanced([f"c{n}" for n in range(count)])
    assert len(rows) == (count if count % 2 == 0 or count == 1 else 2 * count)
    for place in range(count):
        assert len(set(Counter(row[place] for row in rows).values())) == 1
    following = Counter(pair for row in rows for pair in pairwise(row))
    assert len(following) == count * (count - 1)
    assert len(set(following.values())) <= 1


def test_the_cells_of_a_study_have_names_of_their_own():
    for study in (*shipped().values(), within(4, "all"), within(3, "balanced")):
        names = [cell.key for cell in cells(study)]
        assert len(names) == len(set(names))
