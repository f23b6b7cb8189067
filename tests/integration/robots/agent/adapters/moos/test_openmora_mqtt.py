"""The paper's Giraff over MQTT: the conformance suite on a real Mosquitto, and its dialect."""

import asyncio
import time
from functools import partial

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.common import remote_adapter
from robots.agent.adapters.common.robot_profile import load_profile
from robots.agent.adapters.moos import openmora, openmora_mqtt
from robots.agent.robot_interface import ActionRefusedError, AdapterError
from robots.api.geometry import Pose2D
from robots.api.messages import Dock, Goto, Relocalize, Velocity
from tests.support.architectures.adapter_conformance import some, wait_for
from tests.support.architectures.openmora_robot import OpenMoraRig
from tests.support.architectures.rca_conformance import (
    RcaConformance,
    cancelled,
    drive,
    ended,
    heard,
    lost,
)
from tests.support.patience import patient
from tests.support.sessions.broker_rig import HOST, BrokerRig


class TestGiraff(RcaConformance):
    @pytest.fixture(autouse=True)
    def _soon(self, monkeypatch):
        monkeypatch.setattr(openmora_mqtt, "GIVEN_UP", patient(4.0))

    def make_rig(self, directory):
        return OpenMoraRig(directory)

    @pytest.mark.nightly
    async def test_goto_reaches_a_place_of_the_topology_by_name(self, adapter):
        await wait_for(adapter, lambda _: adapter._nodes)
        await adapter.start(Goto(action_id="g", stamp=0.0, place="CorridorMiddle"))
        assert (await heard(adapter, ended("g"), 15.0))[-1].status == "FINISHED"

    async def test_user_is_announced_on_connecting_and_on_closing(self, adapter):
        await adapter.close()
        # a unique name: messages of other tests may still be in the broker
        ada = self.rig.adapter(user="ada")
        received = lambda: [text for _, text in self.rig.received if text.endswith(" ada")]
        await ada.connect()
        await wait_for(ada, lambda _: received() == ["Start ada"])
        await ada.close()
        await ada.connect()
        await wait_for(ada, lambda _: received() == ["Start ada", "Stop ada", "Start ada"])
        await ada.close()

    async def test_errors_of_the_robot_are_reported(self, adapter):
        self.rig.error = "laser disconnected"
        assert (await wait_for(adapter, lambda s: s.errors)).errors == ("laser disconnected",)

    async def test_goto_right_after_driving_is_not_ended_by_the_time_limit_of_the_last_motion(
        self, adapter
    ):
        await drive(adapter, Velocity(linear=0.2, angular=0.0), lambda s: s.velocity.linear > 0.1)
        await self.start_goto(adapter, 0.6)
        assert (await heard(adapter, ended("g")))[-1].status == "FINISHED"

    async def test_goal_that_is_cancelled_before_it_was_sent_is_never_sent(self, adapter):
        await drive(adapter, Velocity(linear=0.2, angular=0.0), lambda s: s.velocity.linear > 0.1)
        adapter.apply(Velocity(linear=0.0, angular=0.0))
        before = len(self.rig.received)
        starting = asyncio.ensure_future(self.start_goto(adapter))
        await asyncio.sleep(0)  # it waits until the time limit of the last Motion is over
        await adapter.cancel("g")
        with pytest.raises(ActionRefusedError, match="cancelled"):
            await starting
        await cancelled(adapter, "g")
        await self.has_stopped()
        assert not any(text.startswith("GoToPoint") for _, text in self.rig.received[before:])

    async def test_docking_that_never_begins_is_cancelled(self, near_dock, monkeypatch):
        monkeypatch.setattr(openmora, "SETTING_OUT", 1.0)
        self.rig.world.accept_after = 60.0
        before = self.rig.world.cancels
        await near_dock.start(Dock(action_id="d", stamp=0.0))
        last = (await heard(near_dock, ended("d")))[-1]
        assert (last.status, last.reason) == ("FAILED", "does_not_start")
        assert self.rig.world.cancels > before

    async def test_motion_that_the_robot_starts_is_cancelled(self, adapter):
        await wait_for(adapter, lambda _: not adapter._mode[0])
        await asyncio.sleep(openmora_mqtt.MOTION_ENDS)  # connecting has sent a Motion
        self.rig.resume(self.rig.world.truth.compose(Pose2D(2.0, 0.0, 0.0)))
        # it may be cancelled before the next state
        await wait_for(adapter, lambda _: self.rig.world.kind == "goto")
        await wait_for(adapter, lambda _: self.rig.world.journey != "running")
        await self.has_stopped()

    async def test_velocity_that_waited_too_long_is_never_sent(self, adapter):
        """This robot obeys late commands, and so the agent must not send them."""
        await some(adapter.states(), 2)
        self.rig.world.commands.clear()
        late = 0.123  # used by no other test
        adapter.apply(Velocity(linear=late, angular=0.0))
        # the loop hangs, as on a stalled computer, for longer than a velocity may wait
        time.sleep(remote_adapter.GATE.oldest + 0.15)
        await some(adapter.states(), 5)
        assert late not in [round(linear, 6) for _, linear, _ in self.rig.world.commands], (
            self.rig.world.commands
        )

    async def test_hung_broker_is_reported(self, adapter, monkeypatch):
        monkeypatch.setattr(remote_adapter, "SILENCE", 1.0)
        await some(adapter.states(), 2)
        self.rig.broker.freeze(on=True)
        try:
            assert "has stopped sending" in await lost(
                adapter, Velocity(linear=0.1, angular=0.0), 5.0
            )
        finally:
            self.rig.broker.freeze(on=False)

    async def test_relocalizing_needs_a_position(self, adapter):
        with pytest.raises(AdapterError, match="no_goal"):
            await adapter.start(Relocalize(action_id="r", stamp=0.0))


async def test_missing_broker_is_reported_with_robot_and_address():
    adapter = registry.create("openmora_mqtt", "giraff", {"broker": "mqtt://127.0.0.1:1"})
    async with asyncio.timeout(patient(10.0)):
        with pytest.raises(AdapterError, match=r"Giraff at mqtt://127\.0\.0\.1:1"):
            await adapter.connect()
    await adapter.close()


async def test_broker_that_denies_access_is_reported(tmp_path):
    rig = BrokerRig("nats", tmp_path)
    await rig.start()
    options = {"username": "other", "broker": f"mqtt://{HOST}:{rig.port}"}
    try:
        await rig.robot("other")
        password = rig.tokens["other"]
        adapter = registry.create("openmora_mqtt", "giraff", options | {"password": password})
        async with asyncio.timeout(patient(10.0)):
            with pytest.raises(AdapterError, match="does not allow this robot to read"):
                await adapter.connect()
        await adapter.close()
    finally:
        await rig.stop()


# --- the dialect ----------------------------------------------------------------------------------

SCAN = partial(openmora.scan_of, stamp=0.0, farthest=10.0)


def test_payload_contains_milliseconds_since_1601():
    assert openmora.stamped("Motion 0.200 0.000", 0.0) == "11644473600000|Motion 0.200 0.000"
    assert openmora.unstamped(b"11644473601500|1 2 3|NULL") == ("1 2 3|NULL", 1.5)


@pytest.mark.parametrize("payload", [b"", b"Motion 1 0", b"x|y", b"\xff\xfe"])
def test_payload_without_a_time_is_refused(payload):
    with pytest.raises(openmora.DialectError):
        openmora.unstamped(payload)


@pytest.mark.parametrize(
    "text", ["[1.5 -2 90]", "1.5 -2 90", "[1.5 -2.0 90.0deg]", "[1.5 -2 450 deg]"]
)
def test_pose_is_read_in_each_of_its_spellings(text):
    pose = openmora.pose_of(text)
    assert (pose.x, pose.y, round(pose.theta, 4)) == (1.5, -2.0, 1.5708)


def test_null_fields_of_a_status_are_unknown():
    status = openmora.status_of("NULL|NULL|NULL|NULL|NULL|NULL|NULL|NULL|NULL")
    assert (status.pose, status.place, status.voltage) == (None, "", None)
    assert (status.autonomous, status.charging) == (False, None)


def test_scan_omits_ranges_beyond_its_limit():
    scan = openmora.scan_of("Aperture 3.14#Nsamples 3#Values 1.00 0.00 30.00", 5.0, 30.0)
    assert scan.ranges == (1.0, None, None)
    assert scan.angle_min == pytest.approx(-1.57)
    assert scan.angle_increment == pytest.approx(1.57)


@pytest.mark.parametrize(
    ("parse", "text"),
    [
        *[(openmora.pose_of, text) for text in ("[1 2]", "[a b c]", "nan nan nan", "1 2 inf")],
        *[(openmora.status_of, text) for text in ("", "a|b", "1 2 3|a|b|Manual|much|0")],
        (SCAN, ""),
        (SCAN, "Aperture x#Nsamples 2#Values 1 2"),
        (SCAN, "Aperture 3#Nsamples 1#Values 1"),
        (SCAN, "Aperture 9#Nsamples 2#Values 1 2"),
    ],
)
def test_invalid_text_is_refused(parse, text):
    with pytest.raises(openmora.DialectError):
        parse(text)


def test_places_of_a_topology_are_found():
    assert openmora.nodes_of("Graph#Charger Place 0.5 6.3#Lab Place 3 4.1") >= {"Charger", "Lab"}


def test_zero_voltage_is_unknown():
    """A variable of MOOS that was never written is 0.0 (MOOSVariable.cpp), and is published so."""
    assert openmora.status_of("|||Manual|0.00|0|0|0|0").voltage is None


def test_angle_of_the_head_is_unknown_until_a_first_turn_has_ended():
    head = openmora_mqtt._Head(load_profile("giraff"))
    assert head.angle(0.0) is None
    head.turn_to(0.5, 10.0)
    assert head.angle(10.5) is None  # still turning, from an unknown angle
    assert head.angle(13.0) == 0.5
    head.turn_to(0.1, 20.0)
    assert head.angle(20.25) == pytest.approx(0.3)
