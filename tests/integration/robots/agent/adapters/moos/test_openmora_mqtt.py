"""The paper's Giraff over MQTT: the conformance suite on a real Mosquitto, and tests of its
dialect.
"""

import asyncio
import time

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
    async def test_a_place_of_its_topology_is_reached_by_name(self, adapter):
        await wait_for(adapter, lambda _: adapter._nodes)
        await adapter.start(Goto(action_id="g", stamp=0.0, place="CorridorMiddle"))
        assert (await heard(adapter, ended("g"), 15.0))[-1].status == "FINISHED"

    async def test_it_says_who_drives_and_when_it_leaves(self, adapter):
        await adapter.close()
        # a name of its own: what others said may still be on its way through the broker
        ada = self.rig.adapter(user="ada")
        said = lambda: [text for _, text in self.rig.said if text.endswith(" ada")]
        await ada.connect()
        await wait_for(ada, lambda _: said() == ["Start ada"])
        await ada.close()
        await ada.connect()
        await wait_for(ada, lambda _: len(said()) == 3)
        assert said() == ["Start ada", "Stop ada", "Start ada"]
        await ada.close()

    async def test_its_errors_are_shown(self, adapter):
        self.rig.error = "laser disconnected"
        assert (await wait_for(adapter, lambda s: s.errors)).errors == ("laser disconnected",)

    async def test_a_journey_right_after_driving_is_not_cancelled_by_the_robots_own_time_limit(
        self, adapter
    ):
        await drive(adapter, Velocity(linear=0.2, angular=0.0), lambda s: s.velocity.linear > 0.1)
        goal = self.rig.world.truth.x + 0.6, self.rig.world.truth.y
        await adapter.start(Goto(action_id="g", stamp=0.0, x=goal[0], y=goal[1]))
        assert (await heard(adapter, ended("g")))[-1].status == "FINISHED"

    async def test_a_goal_that_is_cancelled_before_it_was_sent_is_never_sent(self, adapter):
        await drive(adapter, Velocity(linear=0.2, angular=0.0), lambda s: s.velocity.linear > 0.1)
        adapter.apply(Velocity(linear=0.0, angular=0.0))
        goal, before = self.rig.world.truth.compose(Pose2D(2.0, 0.0, 0.0)), len(self.rig.said)
        goal = Goto(action_id="g", stamp=0.0, x=goal.x, y=goal.y)
        starting = asyncio.ensure_future(adapter.start(goal))
        await asyncio.sleep(0)  # it waits for the robot to forget the last Motion
        await adapter.cancel("g")
        with pytest.raises(ActionRefusedError, match="cancelled"):
            await starting
        await cancelled(adapter, "g")
        await self.has_stopped()
        assert not any(text.startswith("GoToPoint") for _, text in self.rig.said[before:])

    async def test_a_docking_that_never_begins_is_cancelled(self, near_dock, monkeypatch):
        monkeypatch.setattr(openmora, "SETTING_OUT", 1.0)
        self.rig.world.accept_after = 60.0
        before = self.rig.world.cancels
        await near_dock.start(Dock(action_id="d", stamp=0.0))
        last = (await heard(near_dock, ended("d")))[-1]
        assert (last.status, last.reason) == ("FAILED", "does_not_start")
        assert self.rig.world.cancels > before

    async def test_motion_that_the_robot_starts_itself_is_cancelled(self, adapter):
        await wait_for(adapter, lambda _: not adapter._mode[0])
        await asyncio.sleep(openmora_mqtt.MOTION_ENDS)  # connecting has sent a Motion
        self.rig.resume(self.rig.world.truth.compose(Pose2D(2.0, 0.0, 0.0)))
        await wait_for(adapter, lambda s: self.rig.world.journey == "running")
        await wait_for(adapter, lambda s: self.rig.world.journey != "running")
        await self.has_stopped()

    async def test_a_velocity_that_the_broker_kept_waiting_is_never_sent(self, adapter):
        """Late commands are obeyed by this robot: what waited in the agent must not leave it."""
        await some(adapter.states(), 2)
        self.rig.world.commands.clear()
        late = 0.123  # which no other test asks for
        adapter.apply(Velocity(linear=late, angular=0.0))
        # the loop hangs, as in a stalled computer, for longer than a velocity may wait
        time.sleep(remote_adapter.GATE.oldest + 0.15)
        await some(adapter.states(), 5)
        assert late not in [round(linear, 6) for _, linear, _ in self.rig.world.commands], (
            self.rig.world.commands
        )

    async def test_a_broker_that_dies_or_hangs_is_noticed(self, adapter, monkeypatch):
        monkeypatch.setattr(remote_adapter, "SILENCE", 1.0)
        await some(adapter.states(), 2)
        self.rig.broker.freeze(on=True)
        try:
            assert "has stopped sending" in await lost(
                adapter, Velocity(linear=0.1, angular=0.0), 5.0
            )
        finally:
            self.rig.broker.freeze(on=False)

    async def test_without_a_place_it_cannot_look_for_itself(self, adapter):
        with pytest.raises(AdapterError, match="no_goal"):
            await adapter.start(Relocalize(action_id="r", stamp=0.0))


async def test_a_broker_where_nobody_is_gives_a_sentence():
    adapter = registry.create("openmora_mqtt", "giraff", {"broker": "mqtt://127.0.0.1:1"})
    async with asyncio.timeout(patient(10.0)):
        with pytest.raises(AdapterError, match=r"Giraff at mqtt://127\.0\.0\.1:1"):
            await adapter.connect()
    await adapter.close()


async def test_a_broker_that_does_not_let_it_command_the_robot_gives_a_sentence(tmp_path):
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


def test_a_payload_carries_milliseconds_since_1601():
    assert openmora.stamped("Motion 0.200 0.000", 0.0) == "11644473600000|Motion 0.200 0.000"
    assert openmora.unstamped(b"11644473601500|1 2 3|NULL") == ("1 2 3|NULL", 1.5)


@pytest.mark.parametrize("payload", [b"", b"Motion 1 0", b"x|y", b"\xff\xfe"])
def test_a_payload_without_its_time_is_none(payload):
    with pytest.raises(openmora.DialectError):
        openmora.unstamped(payload)


@pytest.mark.parametrize(
    "text", ["[1.5 -2 90]", "1.5 -2 90", "[1.5 -2.0 90.0deg]", "[1.5 -2 450 deg]"]
)
def test_a_pose_is_read_in_all_of_its_spellings(text):
    pose = openmora.pose_of(text)
    assert (pose.x, pose.y, round(pose.theta, 4)) == (1.5, -2.0, 1.5708)


@pytest.mark.parametrize("text", ["[1 2]", "[a b c]", "nan nan nan", "1 2 inf"])
def test_invalid_pose_is_refused(text):
    with pytest.raises(openmora.DialectError):
        openmora.pose_of(text)


def test_a_status_of_a_robot_that_knows_nothing_is_read():
    status = openmora.status_of("NULL|NULL|NULL|NULL|NULL|NULL|NULL|NULL|NULL")
    assert (status.pose, status.place, status.voltage, status.autonomous, status.charging) == (
        None,
        "",
        None,
        False,
        None,
    )


@pytest.mark.parametrize("text", ["", "a|b", "1 2 3|a|b|Manual|much|0"])
def test_invalid_status_is_refused(text):
    with pytest.raises(openmora.DialectError):
        openmora.status_of(text)


def test_a_scan_is_read_and_what_is_beyond_its_range_left_out():
    scan = openmora.scan_of("Aperture 3.14#Nsamples 3#Values 1.00 0.00 30.00", 5.0, 30.0)
    assert scan.ranges == (1.0, None, None)
    assert scan.angle_min == pytest.approx(-1.57)
    assert scan.angle_increment == pytest.approx(1.57)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "Aperture x#Nsamples 2#Values 1 2",
        "Aperture 3#Nsamples 1#Values 1",
        "Aperture 9#Nsamples 2#Values 1 2",
    ],
)
def test_invalid_scan_is_refused(text):
    with pytest.raises(openmora.DialectError):
        openmora.scan_of(text, 0.0, 10.0)


def test_the_places_of_a_topology_are_found():
    assert openmora.nodes_of("Graph#Charger Place 0.5 6.3#Lab Place 3 4.1") >= {"Charger", "Lab"}


def test_a_voltage_that_no_module_has_said_yet_is_unknown():
    """A variable of MOOS that was never written is 0.0 (MOOSVariable.cpp), and the module says it
    all the same.
    """
    assert openmora.status_of("|||Manual|0.00|0|0|0|0").voltage is None


def test_the_angle_of_a_head_that_nobody_has_turned_is_unknown_and_known_once_it_must_be_there():
    head = openmora_mqtt._Head(load_profile("giraff"))
    assert head.angle(0.0) is None
    head.turn_to(0.5, 10.0)
    assert head.angle(10.5) is None  # it turns from an unknown angle
    assert head.angle(13.0) == 0.5
    head.turn_to(0.1, 20.0)
    assert head.angle(20.25) == pytest.approx(0.3)
