"""What a session manager decides from the rows of members and shards."""

from sessions.shards.division import (
    ALL,
    FIRST_SECONDS,
    SILENT_SECONDS,
    Holding,
    ManagerSlot,
    Observer,
    claims,
    gifts,
)
from sessions.shards.hashing import share_of

A, B = ManagerSlot(0, "a", 5, (0, 1)), ManagerSlot(1, "b", 7, (0, 1))
ALL_OF_A = [Holding(number, "a", 1) for number in ALL]


def test_a_member_with_a_constant_count_is_silent_by_the_observers_clock():
    observer = Observer()
    observer.see([A], 100.0)
    assert not observer.is_alive(A, 100.0), "one look does not say whether it beats"
    grown = ManagerSlot(0, "a", 6)
    observer.see([grown], 100.5)
    assert observer.is_alive(grown, 100.5 + SILENT_SECONDS - 0.01)
    assert observer.is_silent(grown, 100.5 + SILENT_SECONDS)


def test_a_member_without_an_observed_heartbeat_has_more_time():
    observer = Observer()
    observer.see([A], 100.0)
    observer.see([A], 102.0)
    assert not observer.is_silent(A, 100.0 + FIRST_SECONDS - 0.01)
    assert observer.is_silent(A, 100.0 + FIRST_SECONDS)


def test_another_process_in_the_slot_has_a_new_time():
    observer = Observer()
    observer.see([A], 100.0)
    other = ManagerSlot(0, "c", 5)
    observer.see([other], 110.0)
    assert not observer.is_silent(other, 110.0)
    assert not observer.is_silent(A, 120.0), "nothing is known of a row that was not seen last"


def test_the_first_process_takes_every_shard():
    nobodys = [Holding(number, "", 0) for number in ALL]
    assert claims(nobodys, [ManagerSlot(0, "a", 1)], 0) == set(ALL)


def test_shards_of_a_process_without_a_slot_are_divided_among_the_others():
    living = [ManagerSlot(0, "", 9), ManagerSlot(1, "b", 7, (1, 2)), ManagerSlot(2, "c", 3, (1, 2))]
    taken = [claims(ALL_OF_A, living, slot) for slot in (1, 2)]
    assert taken[0] | taken[1] == set(ALL)
    assert not taken[0] & taken[1]


def test_a_process_that_has_not_reached_the_broker_takes_nothing_from_one_that_has():
    fresh = ManagerSlot(1, "b", 1)
    orphans = [Holding(number, "dead", 1) for number in ALL]
    assert claims(orphans, [A, fresh], 0) == set(ALL)
    assert claims(orphans, [A, fresh], 1) == set()


def test_shards_go_to_one_that_joins_when_it_has_subscribed_and_not_before():
    assert gifts(ALL_OF_A, [A, ManagerSlot(1, "b", 7)], "a") == {}
    assert gifts(ALL_OF_A, [A, ManagerSlot(1, "b", 7, (0, 1, 2))], "a") == {}, "of another division"
    assert gifts(ALL_OF_A, [A, B], "a") == {"b": share_of(1, (0, 1), ALL)}
    assert gifts(ALL_OF_A, [A, B], "b") == {}
    assert gifts(ALL_OF_A, [A], "a") == {}
