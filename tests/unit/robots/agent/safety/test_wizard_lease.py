"""A lease of kind `wizard`: the visitor has the session, and one hidden operator alone drives."""

import pytest
from hypothesis import given, settings, strategies as st

from robots.agent.media.peers.registry import PeerRegistry
from robots.agent.safety.permissions import CommandSender
from robots.api import messages as m
from tests.support.agents.kernel_bench import DRIVER_CLOCK, Bench

WIZARD = CommandSender("datachannel", "w1")
VISITOR = CommandSender("datachannel", "p1")


@pytest.fixture
def bench():
    return wizards_bench()


def wizards_bench():
    bench = Bench()
    bench.lease(kind="wizard", wizard="w1", wizard_epoch=7)
    bench.know_clock("w1")
    bench.know_clock("p1")
    return bench


def action(bench, kind, epoch, role, **fields):
    stamp = bench.unix + DRIVER_CLOCK
    return kind(action_id="a1", stamp=stamp, session="s1", epoch=epoch, role=role, **fields)


def test_the_wizard_drives_and_the_visitor_does_not(bench):
    assert bench.drive(0.5, sender=VISITOR).reason == "observer"
    assert bench.speed == 0.0
    assert bench.drive(0.5, sender=WIZARD, epoch=7).reason is None
    assert bench.speed > 0.0


def test_without_a_wizard_nobody_drives(bench):
    bench.lease(kind="wizard", wizard_epoch=8, renewal=1)
    for sender, epoch in ((WIZARD, 7), (WIZARD, 8), (VISITOR, 1), (CommandSender("mqtt"), 8)):
        assert bench.drive(0.5, sender=sender, epoch=epoch).reason == "observer"
    assert bench.speed == 0.0


def test_a_wizard_who_is_lost_stops_the_robot_at_once_and_at_the_latest_by_the_deadman(bench):
    bench.run(2.0, every=0.06, linear=0.5, sender=WIZARD, epoch=7)
    assert bench.speed == pytest.approx(0.5)
    bench.lease(kind="wizard", wizard_epoch=8, renewal=1)
    assert bench.run(1.0) == 0.0
    silent = wizards_bench()
    silent.run(2.0, every=0.06, linear=0.5, sender=WIZARD, epoch=7)
    assert silent.run(0.3 + 0.5 / 1.2 + 0.1) == 0.0


def test_the_next_wizard_counts_from_the_beginning_and_the_last_one_drives_no_more(bench):
    bench.drive(0.5, sender=WIZARD, epoch=7, seq=500)
    bench.lease(kind="wizard", wizard="w2", wizard_epoch=8, renewal=1)
    bench.know_clock("w2")
    bench.run(1.0)
    assert bench.drive(0.5, sender=WIZARD, epoch=7, seq=501).reason == "observer"
    assert bench.drive(0.5, sender=CommandSender("mqtt"), epoch=7, seq=502).reason == "wrong_epoch"
    assert (
        bench.drive(0.5, sender=CommandSender("datachannel", "w2"), epoch=8, seq=1).reason is None
    )


def test_the_visitors_stop_holds_the_robot_until_the_wizard_sends_zeros(bench):
    bench.run(2.0, every=0.06, linear=0.5, sender=WIZARD, epoch=7)
    assert bench.stop(session="s1", epoch=1, seq=9)
    assert bench.run(1.0, every=0.06, linear=0.5, sender=WIZARD, epoch=7) == 0.0
    bench.drive(0.0, sender=WIZARD, epoch=7)
    assert bench.run(1.0, every=0.06, linear=0.5, sender=WIZARD, epoch=7) > 0.0


def test_the_visitor_speaks_and_takes_photos_without_moving_the_robot(bench):
    for kind, fields in ((m.Photo, {}), (m.Say, {"text": "Hi"}), (m.Call, {})):
        assert bench.ask(action(bench, kind, 1, "visitor", **fields)) is None
    for kind, fields in ((m.Goto, {"place": "desk"}), (m.Dock, {}), (m.Tilt, {"angle": 0.1})):
        assert bench.ask(action(bench, kind, 1, "visitor", **fields)) == "role"
        assert bench.ask(action(bench, kind, 7, "driver", **fields)) is None


def test_on_the_data_channel_it_is_the_peer_that_counts_and_not_what_the_page_says(bench):
    asked = action(bench, m.Dock, 7, "driver")
    assert bench.ask(asked, way="datachannel", peer="p1") == "role"
    assert bench.ask(asked, way="datachannel", peer="x") == "observer"
    assert bench.ask(asked, way="datachannel", peer="w1") is None


def test_the_visitors_silence_is_the_visitors_while_the_wizard_drives(bench):
    bench.run(3.0)
    bench.kernel.heartbeat("w1", "mqtt", bench.now)
    assert bench.kernel.visitor_silence(bench.now) == pytest.approx(3.0, abs=0.1)
    bench.kernel.heartbeat("p1", "mqtt", bench.now)
    assert bench.kernel.visitor_silence(bench.now) == 0.0


SENDERS = st.sampled_from(
    [
        *(CommandSender("datachannel", peer) for peer in ("p1", "w1", "w2", "x")),
        CommandSender("mqtt"),
    ]
)
LEASES = st.fixed_dictionaries(
    {
        "kind": st.sampled_from(["visitor", "wizard"]),
        "wizard": st.sampled_from([None, "w1", "w2"]),
        "wizard_epoch": st.integers(2, 5),
    }
)


@given(LEASES, st.lists(st.tuples(SENDERS, st.integers(1, 5)), max_size=30))
@settings(deadline=None)
def test_under_any_lease_there_are_never_two_drivers(lease, commands):
    """Of all pages and epochs, one pair at most moves the robot."""
    bench = Bench()
    bench.lease(**lease)
    for peer in ("p1", "w1", "w2"):
        bench.know_clock(peer)
    drivers = set()
    for sender, epoch in commands:
        if bench.drive(0.5, sender=sender, epoch=epoch).reason is None:
            drivers.add(epoch)
            assert sender.peer in {None, bench.kernel.leases.live(bench.now).driver}
    assert len(drivers) <= 1


def test_a_wizards_page_finds_a_place_and_is_never_the_driver_of_the_media():
    registry = PeerRegistry(2)
    registry.lease_changed("p1", 0.0)
    registry.admit("p1", "driver", 0.0)
    registry.admit("x", "observer", 0.0)
    assert registry.admit("w1", "wizard", 0.0).leaves == "x"
    assert (registry.role("p1"), registry.role("w1")) == ("driver", "wizard")
