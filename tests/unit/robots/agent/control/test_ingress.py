"""Messages of pages wait in bounded places for each page, and stops come first."""

import msgspec
import pytest

from robots.agent.control.ingress import ACTIONS_WAITING, Ingress
from robots.api.errors import Rejection
from robots.api.messages import Cancel, CommandHeartbeat, EStop, Goto, Photo, Stop, VelocityCommand
from tests.support import words

GOTO, CANCEL = Goto(action_id="g1", stamp=1.0, x=1.0, y=2.0), Cancel(action_id="c1", stamp=1.0)


class Loop:
    """Counts how often it was woken."""

    def __init__(self) -> None:
        self.woken = 0
        self.ingress = Ingress(self.wake)

    def wake(self) -> None:
        self.woken += 1

    def put(self, *commands, peer="p1", role="driver"):
        for command in commands:
            self.ingress.put(peer, role, command)

    def drained(self):
        return [command for _, _, command in self.ingress.drain()[0]]


def velocity(seq: int) -> VelocityCommand:
    return words.velocity(seq)


@pytest.fixture
def loop() -> Loop:
    return Loop()


def test_only_the_newest_of_a_flood_is_handled_and_the_loop_is_woken_once(loop: Loop) -> None:
    for n in range(10_000):
        loop.put(velocity(n))
        stop, beat = Stop(action_id=f"s{n}", stamp=1.0), CommandHeartbeat(n=n, stamp=1.0, peer="p2")
        loop.put(stop, beat, peer="p2", role="observer")
    waiting, rejected = loop.ingress.drain()
    commands = [command for _, _, command in waiting]
    assert (loop.woken, len(commands), rejected) == (1, 3, {"replaced": 9999})
    assert commands[0] == Stop(action_id="s9999", stamp=1.0)
    assert velocity(9999) in commands
    loop.put(velocity(1))
    assert loop.woken == 2


def test_stops_of_all_pages_are_handled_first(loop: Loop) -> None:
    for peer in ("p1", "p2"):
        estop = EStop(action_id=f"e-{peer}", stamp=1.0)
        loop.put(estop, velocity(1), peer=peer, role="observer")
    found = [type(command) for command in loop.drained()]
    assert found == [EStop, EStop, VelocityCommand, VelocityCommand]


def test_stop_voids_earlier_motion_of_its_page(loop: Loop) -> None:
    stop = Stop(action_id="s1", stamp=1.0)
    loop.put(velocity(1), GOTO, CANCEL, stop, velocity(2))
    loop.put(GOTO, peer="p2")
    waiting, rejected = loop.ingress.drain()
    assert [command for _, _, command in waiting] == [stop, CANCEL, velocity(2), GOTO]
    assert rejected == {"stopped": 2}


def test_commands_of_one_page_keep_their_order(loop: Loop) -> None:
    loop.put(velocity(1), CANCEL, GOTO, velocity(2))
    assert loop.drained() == [CANCEL, GOTO, velocity(2)]


def test_a_release_is_handled_though_a_key_was_pressed_again_at_once(loop: Loop) -> None:
    zero = msgspec.structs.replace(velocity(2), linear=0.0)
    loop.put(velocity(1), zero, velocity(3))
    assert loop.drained() == [zero, velocity(3)]


def test_each_page_has_room_for_its_own_actions(loop: Loop) -> None:
    for n in range(100):
        loop.put(Photo(action_id=f"a{n}", stamp=1.0), Photo(action_id="a0", stamp=1.0))
    loop.put(Photo(action_id="b", stamp=1.0), peer="p2")
    waiting, rejected = loop.ingress.drain()
    assert [peer for peer, _, _ in waiting].count("p1") == ACTIONS_WAITING
    assert waiting[-1][2].action_id == "b"
    assert rejected == {"too_many": 100 - ACTIONS_WAITING}


def test_unreadable_packets_are_counted_and_dropped(loop: Loop) -> None:
    loop.put(*[Rejection("malformed")] * 1000)
    assert (loop.ingress.drain(), loop.woken) == (([], {"malformed": 1000}), 1)
    assert loop.ingress.drain() == ([], {})
