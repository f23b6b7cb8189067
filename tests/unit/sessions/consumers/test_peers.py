"""Who watches the robot itself, and who through the SFU."""

from dataclasses import dataclass

import pytest

from robots.bridge.known import KnownRobot
from sessions.consumers.authorization import Authorization
from sessions.consumers.peers import Peers
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


def test_whoever_watches_through_the_sfu_takes_no_place(known):
    assert room(direct=0, by_sfu=500).has_place_beside_sfu(known, operates=False)


def test_a_site_may_have_fewer_watch_the_robot_itself(known, settings):
    settings.DIRECT_WATCHERS = 2
    assert room(direct=1).has_place_beside_sfu(known, operates=False)
    assert not room(direct=2).has_place_beside_sfu(known, operates=False)
    assert room(direct=2).has_place_beside_sfu(known, operates=True)
