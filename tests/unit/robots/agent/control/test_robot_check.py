"""A robot tested with its wheels off the ground: its readings and its base's watchdog."""

import asyncio
import dataclasses

import pytest

from robots.agent.control.robot_check import (
    CheckParams,
    RobotCheck,
    noise,
    reported,
    verdict,
)
from robots.agent.control.stopping import SpeedSample, stopped_after
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import UNKNOWN_BATTERY, AdapterError
from robots.api.geometry import Pose2D
from robots.api.messages import Velocity
from tests.support.agents.scripted_robot import PROFILE, ScriptedRobot, still
from tests.support.virtual_time import VirtualTime

QUICK = CheckParams(listening=0.2, driving=0.4, longest=1.5, picture=1.0, stood=0.2)
NEVER = 1e9


class Base(ScriptedRobot):
    """A robot whose base executes the last velocity for `watchdog` seconds."""

    def __init__(self, time, watchdog, stuck=False):
        super().__init__(
            profile=dataclasses.replace(PROFILE, capabilities=("velocity",)), times=time.times
        )
        self.watchdog, self.stuck, self.hum = watchdog, stuck, ZERO
        self.mute = ""  # the error that ends its reports; it still takes velocities

    async def states(self):
        while True:
            if self.mute:
                raise AdapterError(self.mute)
            at, velocity = self.applied[-1] if self.applied else (0.0, ZERO)
            moves = not self.stuck and self.times.now() - at < self.watchdog
            yield still(
                stamp=self.times.unix(),
                velocity=velocity if moves else self.hum,
                odometry=Pose2D(0.0, 0.0, 0.0),
                battery=UNKNOWN_BATTERY,
            )
            await asyncio.sleep(0.02)

    def video(self):
        return None


@pytest.fixture
def time():
    with VirtualTime() as time:
        yield time


def tried(time, base):
    lines = []
    return time.run(RobotCheck(base, lines.append, params=QUICK).run()), lines


def begun(time, base, lines):
    """A trial under way, as a task of the loop."""
    return time.loop.create_task(RobotCheck(base, lines.append, params=QUICK).run())


def speeds(base):
    return [velocity.linear for _, velocity in base.applied]


# --- decisions ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("samples", "seconds"),
    [
        ([(10.1, 0.05), (10.2, 0.05), (10.4, 0.0), (10.6, 0.0)], 0.4),
        ([(10.1, 0.05), (10.2, 0.0), (10.3, 0.05), (10.5, 0.001)], 0.5),  # it did not stay
        ([(10.1, 0.05), (10.2, -0.05)], None),
        ([(10.1, -0.05), (10.2, 0.05)], None),
        ([], None),
    ],
)
def test_a_base_has_stopped_when_it_stays_at_rest(samples, seconds):
    found = stopped_after([SpeedSample(at, speed) for at, speed in samples], 10.0, 0.01)
    assert found == (None if seconds is None else pytest.approx(seconds))


@pytest.mark.parametrize(
    ("measured", "is_well"), [(0.3, True), (0.74, True), (0.76, False), (None, False)]
)
def test_a_base_keeps_its_watchdog_up_to_the_measurable_delay(measured, is_well):
    assert verdict(measured, 0.5, CheckParams())[0] is is_well


def test_missing_data_is_named():
    state = still(battery=UNKNOWN_BATTERY, estop=True, errors=("laser disconnected",))
    lines = reported([state] * 30, ("velocity", "scan"), 3.0)
    assert (True, "Battery: unknown.") in lines
    assert (False, "Laser: no scan received.") in lines
    assert (False, "The robot's emergency button is pressed.") in lines
    assert (False, "The robot reports: laser disconnected") in lines
    assert reported([], (), 3.0) == [(False, "Readings: none received.")]


def at_rest(*noise):
    return [still(velocity=Velocity(linear=linear, angular=angular)) for linear, angular in noise]


def test_noise_within_the_thresholds_of_the_profile_is_no_complaint():
    assert noise(at_rest((0.02, -0.05), (-0.01, 0.0)), PROFILE) == ""
    lifted = dataclasses.replace(PROFILE, standstill_linear=0.04, standstill_angular=0.1)
    assert noise(at_rest((0.039, 0.09)), lifted) == ""


def test_noise_beyond_a_threshold_names_the_setting_that_exceeds_it_by_half():
    line = noise(at_rest((0.0, 0.0), (0.01, -0.06), (0.0, 0.0)), PROFILE)
    assert "0.060 rad/s (0.05 counts as rest)" in line
    assert "Set standstill_angular = 0.09 in its profile" in line
    assert "standstill_linear" not in line
    both = noise(at_rest((0.03, 0.1)), PROFILE)
    assert "Set standstill_linear = 0.045 and standstill_angular = 0.15 in its profile" in both


def test_noise_for_which_no_threshold_is_allowed_is_to_be_filtered():
    line = noise(at_rest((0.07, 0.0)), PROFILE)
    assert "filter its odometry" in line
    assert "Set " not in line


# --- trials ---------------------------------------------------------------------------------------


def test_a_base_that_stops_by_itself_passes_and_gets_no_zeros_meanwhile(time):
    base = Base(time, 0.3)
    for _ in range(2):
        base.applied.clear()
        is_well, lines = tried(time, base)
        assert is_well, lines
        assert "it keeps the watchdog of 0.3 s" in lines[-1]
        sent = speeds(base)
        zero = sent.index(0.0)
        assert set(sent[:zero]) == {0.05}
        silence = base.applied[zero][0] - base.applied[zero - 1][0]
        assert silence > 0.3, "no zero before the base has stopped by itself"
        assert sent[-1] == 0.0
        assert base.closed


def test_a_base_without_a_watchdog_fails_and_is_stopped(time):
    base = Base(time, NEVER)
    is_well, lines = tried(time, base)
    assert not is_well
    assert "did not stop within 1.5 s" in lines[-1]
    assert speeds(base)[-1] == 0.0


def test_a_base_that_stops_later_than_its_profile_states_fails(time):
    is_well, lines = tried(time, Base(time, 1.0))
    assert not is_well
    assert "The profile states a watchdog of 0.3 s" in lines[-1]


def test_a_base_that_does_not_move_cannot_be_measured(time):
    is_well, lines = tried(time, Base(time, 0.3, stuck=True))
    assert not is_well
    assert "did not move" in lines[-1]


def test_noise_at_rest_is_measured_and_the_owner_reads_which_threshold_to_set(time):
    base = Base(time, 0.3)
    base.hum = Velocity(linear=0.0, angular=0.06)
    is_well, lines = tried(time, base)
    assert not is_well
    assert any("Set standstill_angular = 0.09" in line for line in lines)
    base.profile = dataclasses.replace(base.profile, standstill_angular=0.09)
    is_well, lines = tried(time, base)
    assert is_well, lines


def test_an_interrupted_check_ends_with_zeros(time):
    base, lines = Base(time, NEVER), []
    work = begun(time, base, lines)
    time.wait(lambda: "Silence…" in lines)
    work.cancel()
    with pytest.raises(asyncio.CancelledError):
        time.run(work)
    assert speeds(base)[-1] == 0.0
    assert base.closed


def test_a_robot_that_is_lost_during_the_check_is_stopped_and_reported(time):
    base, lines = Base(time, NEVER), []
    work = begun(time, base, lines)
    time.wait(lambda: base.applied)
    base.mute = "its odometry is gone"
    with pytest.raises(AdapterError, match="its odometry is gone"):
        time.run(work)
    assert speeds(base)[-1] == 0.0
