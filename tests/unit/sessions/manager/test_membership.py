"""Session managers that join, stop, die and resume, with a virtual clock and rows in memory: none
acts for the robots of another.
"""

from pathlib import Path

import pytest
from django.db import OperationalError
from hypothesis import given, strategies as st

from sessions.manager.health import ManagerHealth
from sessions.manager.membership import SHARED_INTERVAL_S, WAIT_SECONDS, Membership
from sessions.shards.division import ALL
from sessions.shards.hashing import share_of
from tests.support.examples import examples
from tests.support.sessions.manager_rows import MemoryRows

NOWHERE = Path("/nonexistent")  # no lock file: as if each had a computer of its own
STEP = 0.1


class Manager:
    """A process as sessions/manager/service.py runs it, without its database and its broker."""

    def __init__(self, world: "World") -> None:
        self.world = world
        self.membership = Membership(NOWHERE, ManagerHealth(), lambda: world.now, world.rows)
        self.joined = False
        self.due = 0.0
        self.stopped_until = 0.0
        self.given = {}
        self.past = []  # ownerships of former slots

    @property
    def ownership(self):
        return self.membership.ownership

    def step(self) -> None:
        if self.world.now < max(self.due, self.stopped_until):
            return
        if not self.joined:
            self.joined = self.membership._join()
            self.due = self.world.now + WAIT_SECONDS
        elif self.given:
            self.membership._hand_over(self.given)
            self.given = {}
        else:
            self._beat()

    def _beat(self) -> None:
        membership = self.membership
        self.due = self.world.now + membership.interval
        if not membership._beat({"prepared": list(self.ownership.slots)}):
            self.past.append(self.ownership)
            membership._begin_anew()
            self.joined = False
        elif membership.gifts:
            self.given = dict(membership.gifts)
            membership._release(frozenset().union(*self.given.values()))
            self.due = self.world.now + STEP  # until all is written


class World:
    def __init__(self) -> None:
        self.now = 1000.0
        self.rows = MemoryRows()
        self.managers = []
        self.knew = {}  # (shard, epoch): its holder

    def add(self) -> Manager:
        self.managers.append(Manager(self))
        return self.managers[-1]

    def run(self, seconds: float) -> None:
        until = self.now + seconds - STEP / 2
        while self.now < until:
            self.now += STEP
            for manager in self.managers:
                manager.step()
            self.check()

    def check(self) -> None:
        for manager in self.managers:
            holder, ownership = manager.membership.holder, manager.ownership
            for number, epoch in ownership.epochs.items():
                assert self.knew.setdefault((number, epoch), holder) == holder, "two have one epoch"
                row = self.rows.shards[number]
                if ownership.is_confirmed:
                    assert (row.owner, row.epoch) == (holder, epoch), "acts for another's robots"

    def owners(self) -> dict[str, frozenset[int]]:
        return {one.membership.holder: frozenset(one.ownership.epochs) for one in self.managers}

    def divided(self) -> bool:
        slots = {one.membership.slot for one in self.managers}
        return all(
            one.joined
            and one.ownership.epochs.keys() == share_of(one.membership.slot, slots, ALL)
            and one.ownership.is_confirmed
            for one in self.managers
        )


def alone() -> tuple[World, Manager]:
    world = World()
    first = world.add()
    world.run(STEP)
    return world, first


def pair() -> tuple[World, Manager, Manager]:
    world, first = alone()
    second = world.add()
    world.run(5.0)
    assert world.divided()
    return world, first, second


def test_one_process_owns_every_robot_from_its_first_step():
    _, first = alone()
    assert first.ownership.is_whole
    assert first.ownership.owns_site


def test_a_single_process_beats_once_a_second_without_reading_shards(monkeypatch):
    world, first = alone()
    monkeypatch.setattr(world.rows, "holdings", None)
    before = first.membership._beats
    world.run(10.0)
    assert 9 <= first.membership._beats - before <= 11


def test_a_second_process_gets_its_share_and_the_first_keeps_the_rest():
    world, first = alone()
    epochs = dict(first.ownership.epochs)
    second = world.add()
    world.run(5.0)
    assert world.divided()
    assert first.ownership.epochs.items() <= epochs.items()
    assert all(second.ownership.epochs[n] > epochs[n] for n in second.ownership.epochs)


def test_a_third_process_takes_shards_from_both():
    world, first, second = pair()
    before = world.owners()
    world.add()
    world.run(5.0)
    assert world.divided()
    for one in (first, second):
        assert one.ownership.epochs.keys() < before[one.membership.holder]


def test_the_robots_of_a_process_that_was_killed_are_served_within_two_seconds():
    world, first, second = pair()
    world.run(SHARED_INTERVAL_S)
    world.managers.remove(second)
    world.run(2.0)
    assert first.ownership.is_whole


def test_a_process_that_was_stopped_for_ten_seconds_joins_again_before_it_acts():
    world, first, second = pair()
    before = second.ownership
    second.stopped_until = world.now + 10.0
    world.run(9.9)
    assert first.ownership.is_whole
    assert before.epochs, "it does not know yet"
    assert not before.is_confirmed
    assert all(world.rows.shards[n].epoch > epoch for n, epoch in before.epochs.items())
    world.run(6.0)
    assert second.past == [before]
    assert world.divided()


def test_a_single_process_that_was_stopped_keeps_its_shards():
    world, first = alone()
    epochs = dict(first.ownership.epochs)
    first.stopped_until = world.now + 10.0
    world.run(9.0)
    assert not first.ownership.is_confirmed
    world.run(1.5)
    assert first.ownership.is_confirmed
    assert first.ownership.epochs == epochs


def test_a_process_that_leaves_is_succeeded_by_the_next_beat():
    world, first, second = pair()
    world.rows.give_back(second.membership.holder)
    world.managers.remove(second)
    world.run(SHARED_INTERVAL_S + STEP)
    assert first.ownership.is_whole
    assert first.membership.departed == {1}


def test_a_process_that_is_alone_again_acts_on_a_slow_beat():
    world, first = alone()
    world.run(1.5)
    second = world.add()
    world.run(2.0)
    assert second.joined
    second.ownership.slots = ()  # it never reaches the broker, and gets no shard
    world.managers.remove(second)
    world.rows.give_back(second.membership.holder)
    world.run(3.0)
    for _ in range(30):
        world.run(STEP)
        assert first.ownership.is_confirmed


def test_a_process_takes_the_lowest_free_slot_and_waits_until_it_knows_the_others():
    world, first, _ = pair()
    world.managers.remove(first)
    third = world.add()
    world.run(STEP)
    assert not third.joined
    world.run(6.0)
    assert third.membership.slot == 0
    assert world.divided()


# --- the database is unavailable, or another process was first ------------------------------------


def away(*_):
    raise OperationalError("the database is away")


def test_a_single_process_acts_while_the_database_is_unavailable(monkeypatch):
    world, first = alone()
    monkeypatch.setattr(world.rows, "beat", away)
    for _ in range(30):
        world.now += 1.0
        with pytest.raises(OperationalError):
            first.membership._beat({})
        assert first.ownership.is_confirmed, "no other process can have beaten either"


def test_one_of_several_processes_stops_acting_when_its_beats_fail(monkeypatch):
    world, first, second = pair()
    beat = world.rows.beat
    monkeypatch.setattr(
        world.rows, "beat", lambda slot, *rest: (away if slot == 0 else beat)(slot, *rest)
    )
    for seconds in (0.0, 10.0):
        world.now += seconds
        with pytest.raises(OperationalError):
            first.membership._beat({})
    assert not first.ownership.is_confirmed, "the second may have taken every shard"
    assert second.membership._beat({})


async def test_a_process_without_its_database_neither_joins_nor_gives_up_its_slot(monkeypatch):
    world = World()
    membership = world.add().membership
    with monkeypatch.context() as patched:
        patched.setattr(world.rows, "members", away)
        assert not await membership.join()
    assert await membership.join()
    with monkeypatch.context() as patched:
        patched.setattr(world.rows, "beat", away)
        assert await membership.beat({})
    world.rows.dismiss(world.rows.members()[0])
    assert not await membership.beat({})
    await membership.close()


def test_two_processes_that_take_a_slot_at_once_get_different_slots(monkeypatch):
    world = World()
    first, second = world.add(), world.add()
    occupy = world.rows.occupy
    with monkeypatch.context() as patched:

        def late(*asked):
            patched.setattr(world.rows, "occupy", occupy)
            first.step()
            return occupy(*asked)

        patched.setattr(world.rows, "occupy", late)
        second.step()
    assert (first.joined, second.joined) == (True, False)
    world.run(5.0)
    assert world.divided()
    assert (first.membership.slot, second.membership.slot) == (0, 1)


def test_a_process_that_beats_just_before_it_is_dismissed_keeps_its_slot(monkeypatch, caplog):
    world, _, second = pair()
    second.stopped_until = world.now + 60.0
    monkeypatch.setattr(world.rows, "dismiss", lambda _: False)
    world.run(10.0)
    assert second.membership.holder in {one.holder for one in world.rows.members()}
    assert "session_manager_dismissed" not in caplog.text
    second.stopped_until = 0.0
    world.run(1.0)
    assert world.divided()


async def test_shards_that_could_not_be_handed_over_stay_with_their_owner(monkeypatch):
    world, first, second = pair()
    membership, before = first.membership, dict(first.ownership.epochs)
    number = next(iter(before))
    gift = {second.membership.holder: frozenset({number})}
    await membership.release(frozenset({number}))
    assert number not in first.ownership.epochs
    with monkeypatch.context() as patched:
        patched.setattr(world.rows, "hand_over", away)
        await membership.hand_over(gift)
    world.run(1.0)
    assert first.ownership.epochs == before
    await membership.release(frozenset({number}))
    await membership.hand_over(gift)
    assert world.rows.shards[number].owner == second.membership.holder
    await membership.close()


EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just("run"), st.floats(0.1, 3.0)),
        st.tuples(st.just("add"), st.just(0)),
        st.tuples(st.just("kill"), st.integers(0, 3)),
        st.tuples(st.just("leave"), st.integers(0, 3)),
        st.tuples(st.just("stop"), st.tuples(st.integers(0, 3), st.floats(0.1, 12.0))),
    ),
    max_size=25,
)


@examples(20, thorough=3000, deadline=None)
@given(EVENTS)
def test_no_process_acts_for_anothers_robots_and_all_are_served_in_the_end(events):
    world = World()
    world.add()
    for kind, what in events:
        happen(world, kind, what)
        world.check()
    if not world.managers:
        world.add()
    world.run(max(0.0, *(one.stopped_until - world.now for one in world.managers)) + 12.0)
    assert world.divided(), world.owners()


def happen(world: World, kind: str, what) -> None:
    managers = world.managers
    if kind == "run":
        world.run(what)
    elif kind == "add" and len(managers) < 4:
        world.add()
    elif kind == "stop" and what[0] < len(managers):
        managers[what[0]].stopped_until = world.now + what[1]
    elif kind in {"kill", "leave"} and what < len(managers):
        left = managers.pop(what)
        if kind == "leave":
            world.rows.give_back(left.membership.holder)
