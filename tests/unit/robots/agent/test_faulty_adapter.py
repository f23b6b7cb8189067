"""An adapter that raises, hangs or returns nonsense: the robot brakes and recovers."""

import asyncio
import contextlib
import dataclasses
import functools
import math
from typing import ClassVar

import numpy as np
import pytest

from robots.agent.ramp import ZERO
from robots.agent.robot_interface import ActionProgress, ObstaclePoints, Sonar, SonarEcho
from robots.api import messages as m
from robots.api.geometry import Pose2D
from tests.support.agents.control_rig import ControlRig, own, stamped
from tests.support.agents.scripted_robot import PROFILE, NavigatingRobot, SelfDrivingRobot

REASON = "ZeroDivisionError: in its SDK"


class FaultyRobot(NavigatingRobot):
    """`faulty` names the call that does what `fault` says."""

    faulty, fault = "", "raises"

    async def _maybe(self, call):
        if call == self.faulty and self.fault == "raises":
            raise ZeroDivisionError("in its SDK")
        if call == self.faulty and self.fault == "hangs":
            await asyncio.sleep(30.0)

    async def connect(self):
        await self._maybe("connect")
        await super().connect()

    def apply(self, velocity):
        if self.faulty == "apply" and self.fault == "raises":
            raise ZeroDivisionError("in its SDK")
        sent = super().apply(velocity)
        return "ok" if self.faulty == "apply" and self.fault == "returns nonsense" else sent

    async def start(self, action):
        await self._maybe("start")
        await super().start(action)

    async def cancel(self, action_id):
        await self._maybe("cancel")
        await super().cancel(action_id)

    async def states(self):
        async for reading in super().states():
            await self._maybe("states")
            if self.faulty == "states" and self.fault == "returns nonsense":
                velocity = m.Velocity(linear=math.nan, angular=0.0)
                yield dataclasses.replace(reading, velocity=velocity)
            else:
                yield reading


ROBOT = FaultyRobot


def errors_of(rig):
    return rig.link.wait("state", lambda s: s.errors, since=rig.link.count, within=40.0).errors


def drives_again(rig):
    vars(rig.robot).update({"faulty": "", "lost": "", "silent": False, "deaf": False})
    rig.wait(lambda: rig.kernel.fault is None and rig.kernel.is_at_rest, 60.0)
    rig.lease(epoch=2)
    rig.know_clock()
    rig.release(epoch=2)
    rig.drive(0.4, epoch=2)


FAULTS = {
    "apply raises": {"faulty": "apply"},
    "apply returns nonsense": {"faulty": "apply", "fault": "returns nonsense"},
    "states raise": {"faulty": "states"},
    "states hang": {"faulty": "states", "fault": "hangs"},
    "states are nonsense": {"faulty": "states", "fault": "returns nonsense"},
    "it is silent": {"silent": True},
    "it takes no velocities": {"deaf": True},
    "it is lost": {"lost": "the cable is out"},
}


@pytest.mark.parametrize("what", FAULTS)
def test_a_fault_while_driving_stops_the_robot_is_reported_and_passes(rig, what):
    rig.drive(0.5)
    vars(rig.robot).update(FAULTS[what])
    begun = rig.now()
    # A silent or nonsensical robot is lost after two seconds; until then its driver stays in
    # command.
    with contextlib.suppress(AssertionError):
        rig.drive(0.5, until=lambda: rig.kernel.fault is not None, within=4.0)
    assert rig.kernel.fault == "adapter_lost"
    assert rig.now() - begun < 2.2
    rig.sleep(rig.robot.profile.watchdog + 0.05)
    assert rig.robot.base_at(rig.now()) == ZERO
    rig.event("adapter_lost")
    (why,) = errors_of(rig)
    assert why.startswith("adapter_lost: ")
    assert "raise" not in what or REASON in why
    drives_again(rig)
    rig.event("adapter_back")


def test_a_timeout_in_the_sdk_is_a_fault_of_the_adapter(rig, monkeypatch):
    def times_out(_velocity):
        raise TimeoutError("in its SDK")

    with monkeypatch.context() as patch:
        patch.setattr(rig.robot, "apply", times_out)
        rig.push(0.5)
        rig.wait(lambda: rig.kernel.fault == "adapter_lost")
        assert "TimeoutError: in its SDK" in errors_of(rig)[0]
    drives_again(rig)


def test_an_adapter_whose_progress_of_actions_ends_is_not_lost(rig, monkeypatch):
    async def nothing():
        return
        yield

    monkeypatch.setattr(rig.robot, "progress", nothing)
    rig.robot.lost = "the cable is out"
    rig.wait(lambda: rig.kernel.fault is not None)
    rig.robot.lost = ""
    drives_again(rig)
    rig.sleep(1.0)
    assert rig.kernel.fault is None


@pytest.mark.parametrize("fault", ["raises", "hangs"])
def test_a_connection_that_raises_or_hangs_is_tried_again(rig, fault):
    rig.drive(0.5)
    rig.robot.faulty, rig.robot.fault = "connect", fault
    rig.robot.lost = "the cable is out"
    rig.wait(lambda: rig.kernel.fault is not None)
    rig.robot.lost = ""
    (why,) = rig.link.wait(
        "state",
        lambda s: any("cable" not in error for error in s.errors),
        since=rig.link.count,
        within=60.0,
    ).errors
    assert (REASON if fault == "raises" else "no answer within 30 s") in why
    drives_again(rig)


@pytest.mark.parametrize("fault", ["raises", "hangs"])
def test_an_action_that_raises_or_hangs_has_failed_and_its_driver_drives_on(rig, fault):
    rig.drive(0.5)
    rig.robot.faulty, rig.robot.fault = "start", fault
    rig.act(own(m.Goto, x=1.0, y=1.0))
    for _ in range(3):
        rig.beat()
        rig.sleep(0.2)
    if fault == "raises":
        assert rig.status("a1", "FAILED").reason == f"not_connected: {REASON}"
    rig.drive(0.3)
    assert rig.kernel.fault is None


def test_a_cancel_that_raises_is_named_and_tried_again(rig):
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.wait(lambda: rig.robot.going)
    rig.robot.faulty = "cancel"
    rig.act(stamped(m.Stop, "stop-1"), way="datachannel", peer="p2")
    assert any(REASON in error for error in errors_of(rig))
    assert rig.kernel.fault is None
    rig.robot.faulty = ""
    rig.status("a1", "CANCELLED", within=10.0)


@pytest.mark.parametrize("way", ["datachannel", "mqtt"])
def test_a_message_that_raises_stops_the_robot_and_the_next_is_handled(rig, way, monkeypatch):
    rig.drive(0.5)
    with monkeypatch.context() as broken:
        broken.setattr(rig.kernel, "permit", lambda *_, **__: 1 / 0)
        rig.act(own(m.Tilt, "t1", angle=0.1), way=way)
        rig.wait(lambda: rig.robot.told == ZERO)
    assert rig.link.wait("state", lambda s: s.refused.get("failed")).boot == "boot-1"
    rig.release()
    rig.drive(0.5)


class SensingRobot(NavigatingRobot):
    """One with every sensor for obstacles, which sometimes reports nonsense."""

    nonsense: ClassVar[dict[str, object]] = {}

    async def states(self):
        async for reading in super().states():
            yield dataclasses.replace(reading, **self.nonsense)


SENSING = dataclasses.replace(
    PROFILE, laser=m.Laser(x=0.0), sonars=(Sonar(0.2, 0.0, 0.0),), bumper=True
)


def scan(ranges=(1.0,), **fields):
    values = {"stamp": 1.0, "angle_min": 0.0, "angle_increment": 0.1, "range_max": 8.0} | fields
    return m.Scan(ranges=ranges, **values)


NONSENSE = {
    "beams that all go one way": {"scan": scan((1.0, 2.0), angle_increment=0.0)},
    "an echo without a time": {"sonar": (SonarEcho(0, None, 1.0),)},
    "an echo of letters": {"sonar": (SonarEcho(0, 1.0, "x"),)},
    "a contact nowhere": {"bumper": (None,)},
    "points that are none": {"points": ObstaclePoints(1.0, "x")},
    "a clearance of NumPy's": {"clearance": np.float64(0.5)},
    "a path of NumPy's": {"path": tuple(map(tuple, np.zeros((2, 2))))},
    "ranges of NumPy's": {"scan": scan((*np.ones(3),))},
    "an angle of NumPy's": {"scan": scan(angle_min=np.float32(0.0))},
    "a velocity that is none": {"velocity": None},
    "no pose": {"pose": None},
    "a pose of NaN": {"pose": m.Pose(x=math.nan, y=0.0, theta=0.0)},
    "odometry of NaN": {"odometry": Pose2D(math.nan, 0.0, 0.0)},
    "an infinite path": {"path": ((math.inf, 0.0),)},
    "a point too far away": {"assist_point": (1e9, 0.0)},
}


@pytest.mark.parametrize("what", NONSENSE)
@pytest.mark.parametrize("robot", [functools.partial(SensingRobot, SENSING)], indirect=True)
def test_an_invalid_reading_is_a_fault_of_the_adapter_and_the_loop_continues(rig, robot, what):
    for _ in range(2):
        robot.nonsense = NONSENSE[what]
        assert any("nonsense" in error for error in errors_of(rig))
        robot.nonsense = {}
        rig.wait(lambda: rig.kernel.fault is None, within=60.0)


UNSOUND_PROGRESS = {
    "a number of NumPy's": {"result": {"travelled": np.float32(0.5)}},
    "a number that is none": {"result": {"travelled": math.nan}},
    "no reason": {"reason": None},
    "an unknown status": {"status": "DONE"},
    "no action": {"action_id": None},
}


@pytest.mark.parametrize("what", UNSOUND_PROGRESS)
def test_invalid_progress_is_a_fault_of_the_adapter_and_the_loop_continues(rig, what):
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.status("a1", "RUNNING")
    fields = {"action_id": "a1", "status": "FINISHED"} | UNSOUND_PROGRESS[what]
    rig.robot._progress.put_nowait(ActionProgress(**fields))
    (why,) = errors_of(rig)
    assert why.startswith("adapter_lost: ")
    rig.robot.halt()
    drives_again(rig)


def test_progress_with_a_long_reason_is_shortened(rig):
    rig.act(own(m.Goto, x=1.0, y=1.0))
    rig.status("a1", "RUNNING")
    rig.robot.halt()
    rig.robot.report("a1", "FAILED", "no path " * 100)
    assert rig.status("a1", "FAILED").reason == ("no path " * 100)[:300]


class FaultyNavigation(SelfDrivingRobot):
    """A robot whose own navigation raises in `wanted` or `dock`, or wants an invalid velocity."""

    fault = ""

    def wanted(self):
        if self.fault == "wanted raises":
            raise ZeroDivisionError("in its SDK")
        return "ahead" if self.fault == "wanted is none" else super().wanted()

    @property
    def dock(self):
        if self.fault == "dock raises":
            raise ZeroDivisionError("in its SDK")


@pytest.mark.parametrize("fault", ["wanted raises", "wanted is none", "dock raises"])
def test_a_fault_of_its_navigation_is_named_and_passes(tmp_path, fault):
    robot = FaultyNavigation(dataclasses.replace(PROFILE, laser=m.Laser(x=0.0)), finishes=False)
    with ControlRig(tmp_path, robot=robot) as rig:
        rig.grant()
        rig.act(own(m.Goto, x=1.0, y=1.0))
        rig.status("a1", "RUNNING")
        robot.fault = fault
        (why,) = errors_of(rig)
        assert why.startswith("adapter_lost: ")
        robot.fault = ""
        rig.wait(lambda: rig.kernel.fault is None, 60.0)
