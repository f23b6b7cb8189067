"""Who watches the robot itself, and who through the SFU."""

from dataclasses import dataclass

import pytest

from robots.api.messages import Lease
from robots.bridge.known import KnownRobot
from sessions.consumers.authorization import Authorization
from sessions.consumers.peers import Peers
from sessions.leases.policy import PAGE_SEEN_EVERY
from tests.support import words


@dataclass(eq=False)
class Member:
    authorization: Authorization

    def replaced(self):
        raise AssertionError

    def peers_changed(self):
        pass


def room(*, direct, by_sfu=0):
    peers = Peers()
    for number in range(direct + by_sfu):
        authorization = Authorization(f"peer-{number}", "Ada")
        authorization.observe(by_sfu=number >= direct)
        peers.members.add(Member(authorization))
    return peers


def lease(epoch=1, renewal=1):
    return Lease(session="s", epoch=epoch, peer="p", who="Ada", renewal=renewal, stamp=1.0)


@pytest.fixture
def known():
    robot = KnownRobot("giraff")
    robot.factsheet = words.factsheet()
    return robot


def test_beside_an_sfu_a_robot_keeps_places_for_its_driver_the_sfu_and_an_operator(known):
    places = known.factsheet.viewers
    assert room(direct=places - 4).has_place_beside_sfu(known, operates=False)
    assert not room(direct=places - 3).has_place_beside_sfu(known, operates=False)
    assert room(direct=places - 3).has_place_beside_sfu(known, operates=True)
    assert not room(direct=places - 2).has_place_beside_sfu(known, operates=True)


def test_page_that_watches_through_the_sfu_takes_no_place(known):
    assert room(direct=0, by_sfu=500).has_place_beside_sfu(known, operates=False)


def test_page_that_waits_and_watches_counts_as_waiting_only(known):
    peers = room(direct=2)
    waits = Authorization("peer-waits", "Ben")
    waits.wait("session")
    waits.observe()
    peers.members.add(Member(waits))
    peers.waiting = 1
    known.state = words.state(viewers=3)
    described = peers.describe(known, 0.0)
    assert (described.observers, described.waiting) == (2, 1)
    # one more of either kind, at another web process
    known.state = words.state(viewers=4)
    assert peers.describe(known, 0.0).observers == 3
    peers.waiting = 2
    assert peers.describe(known, 0.0).observers == 2


def test_a_robot_is_read_again_after_each_lease_and_at_intervals_for_all_pages(known):
    peers = room(direct=3)
    assert peers.is_to_be_read(known, 0.0)
    assert not peers.is_to_be_read(known, 1.0)
    assert peers.is_to_be_read(known, PAGE_SEEN_EVERY)
    known.take_lease(lease(), 11.0)
    assert not peers.is_to_be_read(known, 11.0)
    known.take_lease(lease(renewal=2), 11.0 + PAGE_SEEN_EVERY)
    assert peers.is_to_be_read(known, 11.0 + PAGE_SEEN_EVERY), "who waits comes and goes, too"
    known.take_lease(None, 22.0)
    assert peers.is_to_be_read(known, 22.0)
    assert not peers.is_to_be_read(known, 22.5)


def test_a_site_may_limit_the_direct_watchers(known, settings):
    settings.DIRECT_WATCHERS = 2
    assert room(direct=1).has_place_beside_sfu(known, operates=False)
    assert not room(direct=2).has_place_beside_sfu(known, operates=False)
    assert room(direct=2).has_place_beside_sfu(known, operates=True)
