"""What pages say waits in a bounded place for each of them, and stops go first."""

from robots.agent.control.ingress import ACTIONS_WAITING, Ingress
from robots.api.errors import Rejection
from robots.api.messages import Cancel, CommandHeartbeat, EStop, Goto, Photo, Stop, VelocityCommand


class Loop:
    """Counts how often it was woken."""

    def __init__(self) -> None:
        self.woken = 0
        self.ingress = Ingress(self.wake)

    def wake(self) -> None:
        self.woken += 1

    def heard(self):
        return [command for _, _, command in self.ingress.drain()[0]]


def velocity(seq: int) -> VelocityCommand:
    return VelocityCommand(
        session="s1", epoch=1, seq=seq, stamp=1.0, linear=0.3, angular=0.0, method="keyboard"
    )


def test_only_the_newest_of_a_flood_is_handled_and_the_loop_is_woken_once() -> None:
    loop = Loop()
    for n in range(10_000):
        loop.ingress.put("p1", "driver", velocity(n))
        loop.ingress.put("p2", "observer", Stop(action_id=f"s{n}", stamp=1.0))
        loop.ingress.put("p2", "observer", CommandHeartbeat(n=n, stamp=1.0, peer="p2"))
    said, rejected = loop.ingress.drain()
    heard = [command for _, _, command in said]
    assert (loop.woken, len(heard), rejected) == (1, 3, {"replaced": 9999})
    assert heard[0] == Stop(action_id="s9999", stamp=1.0)
    assert velocity(9999) in heard
    loop.ingress.put("p1", "driver", velocity(1))
    assert loop.woken == 2


def test_stops_of_all_pages_are_handled_first() -> None:
    loop = Loop()
    for peer in ("p1", "p2"):
        loop.ingress.put(peer, "observer", EStop(action_id=f"e-{peer}", stamp=1.0))
        loop.ingress.put(peer, "observer", velocity(1))
    assert [type(command) for command in loop.heard()] == [
        EStop,
        EStop,
        VelocityCommand,
        VelocityCommand,
    ]


def test_stop_voids_earlier_motion_of_its_page() -> None:
    loop = Loop()
    goto = Goto(action_id="g1", stamp=1.0, x=1.0, y=2.0)
    stop, cancel = Stop(action_id="s1", stamp=1.0), Cancel(action_id="c1", stamp=1.0)
    for said in (velocity(1), goto, cancel, stop, velocity(2)):
        loop.ingress.put("p1", "driver", said)
    loop.ingress.put("p2", "driver", goto)
    said, rejected = loop.ingress.drain()
    assert [command for _, _, command in said] == [stop, cancel, velocity(2), goto]
    assert rejected == {"stopped": 2}


def test_commands_of_one_page_keep_their_order() -> None:
    loop = Loop()
    goto = Goto(action_id="g1", stamp=1.0, x=1.0, y=2.0)
    for said in (velocity(1), Cancel(action_id="c1", stamp=1.0), goto, velocity(2)):
        loop.ingress.put("p1", "driver", said)
    assert loop.heard() == [Cancel(action_id="c1", stamp=1.0), goto, velocity(2)]


def test_a_release_is_handled_though_a_key_was_pressed_again_at_once() -> None:
    loop = Loop()
    zero = VelocityCommand(
        session="s1", epoch=1, seq=2, stamp=1.0, linear=0.0, angular=0.0, method="keyboard"
    )
    for said in (velocity(1), zero, velocity(3)):
        loop.ingress.put("p1", "driver", said)
    assert loop.heard() == [zero, velocity(3)]


def test_each_page_has_room_for_its_own_actions() -> None:
    loop = Loop()
    for n in range(100):
        loop.ingress.put("p1", "driver", Photo(action_id=f"a{n}", stamp=1.0))
        loop.ingress.put("p1", "driver", Photo(action_id="a0", stamp=1.0))
    loop.ingress.put("p2", "driver", Photo(action_id="b", stamp=1.0))
    said, rejected = loop.ingress.drain()
    assert [peer for peer, _, _ in said].count("p1") == ACTIONS_WAITING
    assert said[-1][2].action_id == "b"
    assert rejected == {"too_many": 100 - ACTIONS_WAITING}


def test_unreadable_packets_are_counted_and_dropped() -> None:
    loop = Loop()
    for _ in range(1000):
        loop.ingress.put("p1", "driver", Rejection("malformed"))
    said, rejected = loop.ingress.drain()
    assert (said, rejected, loop.woken) == ([], {"malformed": 1000}, 1)
    assert loop.ingress.drain() == ([], {})
