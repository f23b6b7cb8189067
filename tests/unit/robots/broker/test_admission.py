"""Who gets a place at the broker, and who goes for it."""

import pytest

from robots.broker import admission as admission_module
from robots.broker.admission import Admission
from robots.broker.permissions import ROBOT_ALLOWANCE, BrokerUser, of_robot, of_server

GIRAFF = BrokerUser("giraff", "hash", of_robot("giraff"))
WEB = BrokerUser("web", "hash", of_server())


@pytest.fixture
def admission(monkeypatch):
    monkeypatch.setattr(admission_module, "MAX_STRANGERS", 4)
    return Admission()


def arrive(admission, *strangers):
    return [admission.arrive(name, address) for name, address in strangers]


def test_while_there_is_room_nobody_goes(admission):
    assert arrive(admission, *((f"s{n}", "1.1.1.1") for n in range(4))) == [None] * 4


def test_the_oldest_idle_stranger_goes_when_a_new_one_comes(admission):
    arrive(admission, *((f"s{n}", "1.1.1.1") for n in range(4)))
    assert arrive(admission, ("s4", "1.1.1.1"), ("s5", "1.1.1.1")) == ["s0", "s1"]
    assert admission.strangers == 4


def test_a_stranger_whose_connect_is_looked_at_stays_longer_than_an_idle_one(admission):
    arrive(admission, *((f"s{n}", "1.1.1.1") for n in range(4)))
    admission.progress("s0")
    assert arrive(admission, ("s4", "1.1.1.1")) == ["s1"]


def test_a_crowd_displaces_itself_and_nobody_at_other_addresses(admission):
    arrive(admission, ("quiet", "2.2.2.2"), *((f"s{n}", "1.1.1.1") for n in range(3)))
    assert arrive(admission, ("other", "3.3.3.3"), *((f"t{n}", "1.1.1.1") for n in range(3))) == [
        "s0",
        "s1",
        "s2",
        "t0",
    ]


def test_a_crowd_of_a_64_counts_as_one_and_in_it_the_busiest_address_loses(admission):
    arrive(
        admission,
        ("neighbour", "2001:db8::1"),
        ("far", "2001:db8:1::1"),
        ("s0", "2001:db8::2"),
        ("s1", "2001:db8::2"),
    )
    assert arrive(admission, ("s2", "2001:db8::2"), ("s3", "2001:db8::2")) == ["s0", "s1"]


def test_who_is_signed_in_counts_no_more_as_a_stranger(admission):
    arrive(admission, *((f"s{n}", "1.1.1.1") for n in range(4)))
    assert admission.sign_in("s0", GIRAFF, 0.0) == (True, None)
    assert admission.strangers == 3
    assert arrive(admission, ("s4", "1.1.1.1")) == [None]


def test_of_one_users_connections_the_oldest_goes(admission):
    names = [f"c{n}" for n in range(ROBOT_ALLOWANCE.connections + 2)]
    displaced = []
    for name in names:
        admission.arrive(name, "1.1.1.1")
        is_in, gone = admission.sign_in(name, GIRAFF, 0.0)
        assert is_in
        displaced.append(gone)
    assert displaced == [None] * ROBOT_ALLOWANCE.connections + ["c0", "c1"]


def test_a_user_that_comes_again_and_again_is_refused_until_it_has_waited():
    admission = Admission()
    answers = []
    for number in range(200):
        admission.arrive(number, "1.1.1.1")
        answers.append(admission.sign_in(number, GIRAFF, 0.0)[0])
        admission.leave(number)
    assert answers.index(False) == ROBOT_ALLOWANCE.packets_per_s / admission_module.CONNECT_COST
    assert not any(answers[answers.index(False) :])
    admission.arrive("later", "1.1.1.1")
    assert admission.sign_in("later", GIRAFF, 1.0)[0]
    admission.arrive("server", "1.1.1.1")
    assert admission.sign_in("server", WEB, 0.0)[0]


def test_the_broker_is_full_for_those_that_have_no_connection_to_lose(monkeypatch):
    monkeypatch.setattr(admission_module, "MAX_CONNECTIONS", 1)
    admission = Admission()
    for name, user in (("first", GIRAFF), ("second", WEB)):
        admission.arrive(name, "1.1.1.1")
        assert admission.sign_in(name, user, 0.0) == (user is GIRAFF, None)


def test_who_left_leaves_nothing_behind(admission):
    for name, address in (("a", "1.1.1.1"), ("b", "2001:db8::1")):
        admission.arrive(name, address)
    admission.sign_in("a", GIRAFF, 0.0)
    for name in ("a", "b", "b", "never"):
        admission.leave(name)
    admission.forget_users({})
    assert not any((admission._strangers, admission._places, admission._users, admission._usages))
