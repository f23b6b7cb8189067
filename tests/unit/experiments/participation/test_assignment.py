import random
from collections import Counter
from itertools import pairwise, permutations

import pytest
from hypothesis import given, strategies as st

from experiments.definition.schema import Allocation, BalanceFactor, Refill
from experiments.definition.shipped import shipped
from experiments.participation.assignment import (
    Cell,
    Held,
    balanced,
    cells,
    choose,
    level_of,
    load,
    stage_at_end,
)
from tests.support.examples import examples
from tests.support.studies.studies import STUDY, small_study

NONE = Refill()
SURE = Allocation(best_probability=1.0)


def within(count: int, order: str):
    conditions = [{**STUDY["conditions"][0], "key": f"c{n}"} for n in range(count)]
    return small_study(conditions=conditions, allocation={"design": "within", "order": order})


class Month:
    """A running study: so many participants in progress at once, some of which leave before they
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
        self.leaving, self.failing, self.refill = leaving, failing, refill
        self.allocation = Allocation(quota=quota, best_probability=1.0)
        self.held: list[Held] = []
        self.under_way: list[int] = []
        self.exposed = Counter()

    def admit(self) -> bool:
        choice = choose(self.offered, self.held, self.allocation, self.rng.getrandbits(32))
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
        refilled = self.count("refilled")[cell]
        stage = stage_at_end(outcome, self.refill, refilled) if exposed else "freed"
        self.held[index] = Held(cell, stage)

    def count(self, *stages: str) -> Counter:
        return Counter({cell.key: 0 for cell in self.offered}) + Counter(
            place.cell for place in self.held if place.stage in stages
        )

    def difference(self) -> int:
        counts = self.count("filled")
        filled = [counts[cell.key] for cell in self.offered]
        return max(filled) - min(filled)


@pytest.mark.parametrize("most", [1, 4, 16])
@pytest.mark.parametrize(
    "leaving", [(0.1, 0.1), (0.1, 0.5), (0.5, 0.1, 0.3), (0.1, 0.2, 0.3, 0.4, 0.5, 0.5)]
)
def test_cells_differ_by_at_most_the_participants_under_way(most, leaving):
    names = [f"c{n}" for n in range(len(leaving))]
    month = Month(names, dict(zip(names, leaving, strict=True)), 0.0, seed=most)
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
def test_cells_stay_even_and_keep_every_participant_who_drove(
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
        taken = [place for place in month.held if place.stage in {"under_way", "filled"}]
        assert sum(loads.values()) == len(taken)
    assert month.count("filled", "refilled") == +month.exposed
    assert all(number <= refills for number in month.count("refilled").values())


def test_quota_is_met_exactly_and_then_closes_admission():
    leaving, refill = {"a": 0.4, "b": 0.1, "c": 0.5}, Refill(outcomes=("robot_fault",), most=5)
    month = Month(["a", "b", "c"], leaving, 0.3, seed=3, refill=refill, quota=7)
    for _ in range(400):
        while len(month.under_way) < 4 and month.admit():
            pass
        if month.under_way:
            month.finish_one()
    assert not month.admit()
    assert month.count("filled") == {"a": 7, "b": 7, "c": 7}


def test_place_is_refilled_as_often_as_the_rule_allows():
    refill = Refill(outcomes=("connection_lost",), most=1)
    assert stage_at_end("cancelled", refill, 0) == "filled"
    assert stage_at_end("timed_out", refill, 0) == "filled"
    assert stage_at_end("connection_lost", refill, 0) == "refilled"
    assert stage_at_end("connection_lost", refill, 1) == "filled"


def test_ties_are_drawn_by_a_seed_that_draws_them_again():
    offered = [Cell(name, (name,)) for name in "abcd"]
    held = [Held("a"), Held("b", "freed"), Held("d", "filled")]
    choice = choose(offered, held, SURE, 7)
    assert choice.best == ("b", "c")
    assert choice.counts == {"a": 1, "b": 0, "c": 0, "d": 1}
    assert choose(offered, held, SURE, choice.seed) == choice
    drawn = Counter(choose(offered, [], SURE, seed).cell.key for seed in range(4000))
    assert all(850 < drawn[name] < 1150 for name in "abcd")


def assigned_in_turn(probability: float, count: int, names: str = "ab", seed: int = 1):
    """Assign people one after the other; return how many draws were not tied, how often the cell
    with the fewest came then, and by how much the cells differ at the end of each 64.
    """
    allocation = Allocation(best_probability=probability)
    offered, rng = [Cell(name, (name,)) for name in names], random.Random(seed)
    decided, guessed, differences = 0, 0, []
    held: list[Held] = []
    for number in range(1, count + 1):
        choice = choose(offered, held, allocation, rng.getrandbits(31))
        if len(choice.best) < len(offered):
            decided += 1
            guessed += choice.cell.key in choice.best
        held.append(Held(choice.cell.key, "filled"))
        if number % 64 == 0:
            counts = load(held)
            differences.append(max(counts[name] for name in names) - min(counts.values()))
            held = []
    return decided, guessed, differences


def test_smallest_cell_alone_is_known_beforehand_whenever_cells_differ():
    decided, guessed, differences = assigned_in_turn(1.0, 4000)
    assert (decided, guessed, max(differences)) == (2000, 2000, 0)


@pytest.mark.parametrize("names", ["ab", "abcd"])
def test_default_random_factor_keeps_cells_even_and_no_draw_is_certain(names):
    decided, guessed, differences = assigned_in_turn(Allocation().best_probability, 6400, names)
    assert 0.72 < guessed / decided < 0.78
    assert sum(differences) / len(differences) < 3.0
    by_coin = assigned_in_turn(1.0 / len(names), 6400, names)[2]
    assert sum(differences) < 0.6 * sum(by_coin)


def test_strata_and_minimization_balance_cells_within_factors():
    """A factor that half of the participants have, and a rare one."""
    for balancing in ("strata", "minimization"):
        factors = (BalanceFactor(item="ict.games"), BalanceFactor(item="age", limits=(30.0, 50.0)))
        allocation = Allocation(best_probability=1.0, balancing=balancing, balance=factors)
        offered, rng, held = [Cell(name, (name,)) for name in "ab"], random.Random(5), []
        for _ in range(80):
            levels = {
                "ict.games": level_of(factors[0], rng.choice(["daily", "never"])),
                "age": level_of(factors[1], rng.choice([20, 25, 60])),
            }
            choice = choose(offered, held, allocation, rng.getrandbits(31), levels)
            held.append(Held(choice.cell.key, "filled", levels))
        for item in ("ict.games", "age"):
            for level in {place.levels[item] for place in held}:
                counts = load(place for place in held if place.levels[item] == level)
                assert abs(counts["a"] - counts["b"]) <= 3, (balancing, item, level)


def test_participants_of_another_stratum_do_not_count():
    factor = BalanceFactor(item="ict.games")
    allocation = Allocation(best_probability=1.0, balancing="strata", balance=(factor,))
    held = [Held("a", "filled", {"ict.games": "daily"})] * 3
    held += [Held("b", "filled", {"ict.games": "never"})]
    offered = [Cell(name, (name,)) for name in "ab"]
    choice = choose(offered, held, allocation, 1, {"ict.games": "never"})
    assert choice.cell.key == "a"
    assert (choice.counts, choice.scores) == ({"a": 3, "b": 1}, {"a": 0, "b": 1})


def test_numbers_are_grouped_by_their_limits():
    age = BalanceFactor(item="age", limits=(30.0, 50.0))
    levels = [level_of(age, value) for value in (29, 30, 49.5, 50, 99, None)]
    assert levels == ["below 30", "from 30", "from 30", "from 50", "from 50", ""]


def test_there_is_no_assignment_without_a_cell():
    assert choose([], [], SURE, 1) is None
    assert cells(small_study(), "invitation") == ()


def test_open_links_lead_to_open_conditions_and_invitations_to_the_others():
    paper, doors = shipped()["exploration"], ("open", "lab_closed", "lounge_closed")
    for access, robot in (("open", "giraff"), ("invitation", "rhodon")):
        found = {cell.key for cell in cells(paper, access)}
        assert found == {f"{robot}_{door}" for door in doors}


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
def test_balanced_orders_balance_the_places_and_successions_of_conditions(count):
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
