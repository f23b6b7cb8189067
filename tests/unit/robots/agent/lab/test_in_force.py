"""Which network a driver gets, and what of theirs it carries."""

import pytest

from robots.agent.lab.in_force import CLEAN, Networks, in_force, is_held
from robots.agent.safety.permissions import CommandSender
from robots.api import messages as m
from tests.support import words

SLOW, NARROW = m.NetworkLab(delay=0.2, seed=3), m.NetworkLab(bitrate=4e5, seed=4)
BOTH = {"control_network": SLOW, "video_network": NARROW}
LEASE = words.lease(epoch=3)
OWN = Networks(m.NetworkLab(loss=0.5), None)


@pytest.mark.parametrize(
    ("lease", "config", "own", "found"),
    [
        (LEASE, BOTH | {"network_session": "s1"}, CLEAN, Networks(SLOW, NARROW, "s1")),
        (LEASE, BOTH | {"network_session": "s0"}, CLEAN, CLEAN),
        (LEASE, {"video_network": NARROW}, CLEAN, Networks(None, NARROW, "s1")),
        (None, BOTH, OWN, CLEAN),
        (LEASE, None, OWN, Networks(OWN.control, None, "s1")),
        (LEASE, {}, OWN, Networks(OWN.control, None, "s1")),
        (LEASE, BOTH | {"network_session": "s0"}, OWN, Networks(OWN.control, None, "s1")),
        (LEASE, {"control_network": SLOW}, OWN, Networks(SLOW, None, "s1")),
    ],
)
def test_a_driver_has_the_servers_networks_for_the_session_or_the_agents_own(
    lease, config, own, found
):
    message = None if config is None else m.Config(stamp=1.0, **config)
    assert in_force(lease, message, own) == found


VELOCITY = words.velocity(session="s1", epoch=3)
DRIVERS = {"action_id": "a", "stamp": 1.0, "session": "s1", "epoch": 3}


@pytest.mark.parametrize("sender", [CommandSender("datachannel", "p1"), CommandSender("mqtt")])
@pytest.mark.parametrize(
    "message",
    [VELOCITY, m.Goto(**DRIVERS, x=1.0, y=1.0), m.Photo(**DRIVERS), m.Tilt(**DRIVERS, angle=0.1)],
)
def test_the_drivers_commands_use_the_drivers_network_on_both_transports(message, sender):
    assert is_held(message, sender, LEASE)


@pytest.mark.parametrize("sender", [CommandSender("datachannel", "p1"), CommandSender("mqtt")])
@pytest.mark.parametrize(
    "message", [m.Stop(**DRIVERS, seq=2), m.EStop(**DRIVERS), m.Cancel(**DRIVERS)]
)
def test_stops_are_never_held(message, sender):
    assert not is_held(message, sender, LEASE)


@pytest.mark.parametrize(
    ("message", "sender"),
    [
        (VELOCITY, CommandSender("datachannel", "p2")),
        (VELOCITY, CommandSender("mqtt", retained=True)),
        (words.velocity(session="s2", epoch=1), CommandSender("mqtt")),
        (m.Photo(action_id="a", stamp=1.0, role="staff", user="ops"), CommandSender("mqtt")),
        (m.Dock(action_id="a", stamp=1.0, role="server"), CommandSender("mqtt")),
        (m.Goto(**DRIVERS, x=0.0, y=0.0), CommandSender("datachannel", "p2")),
    ],
)
def test_messages_of_others_are_not_held(message, sender):
    assert not is_held(message, sender, LEASE)


def test_no_message_is_held_without_a_driver():
    assert not is_held(VELOCITY, CommandSender("datachannel", "p1"), None)
