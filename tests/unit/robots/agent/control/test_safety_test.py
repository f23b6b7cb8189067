"""The safety test that an owner starts: what it measures, and when it ends early."""

from dataclasses import replace

import pytest

from robots.agent.control.stopping import SpeedSample, travelled
from robots.agent.ramp import ZERO
from robots.api import messages as m
from tests.support.agents.control_rig import ControlRig, stamped
from tests.support.agents.scripted_robot import PROFILE, ScriptedRobot, still

LIMIT = 0.15


class MovingBase(ScriptedRobot):
    """A base that does what it is told after `lag` seconds, or at a fixed `runs` m/s."""

    lag = 0.04
    runs = None
    factor = 1.0  # times the velocity that it was sent

    async def states(self):
        async for state in super().states():
            yield replace(state, velocity=self._velocity())

    def _velocity(self):
        if self.runs is not None:
            return m.Velocity(linear=self.runs, angular=0.0)
        due = [velocity for at, velocity in self.applied if at <= self.times.now() - self.lag]
        linear = due[-1].linear * self.factor if due else 0.0
        return m.Velocity(linear=linear, angular=0.0)


@pytest.fixture
def rig(tmp_path):
    with ControlRig(tmp_path, robot=MovingBase()) as rig:
        yield rig


def begin(rig, *, peer="t1", role="owner", **lease):
    limits = m.LeaseLimits(linear=LIMIT)
    rig.lease(**{"peer": peer, "limits": limits, "video": "required", **lease})
    rig.wait(lambda: rig.kernel.leases.live(rig.now()) is not None)
    rig.act(stamped(m.SafetyTest, "t1", role=role, user="Ada"))


def ended(rig, within=60.0):
    """Return the test's last status, with the lease renewed meanwhile as the server does."""
    found = lambda: [
        each
        for each in rig.link.all("action")
        if each.action_id == "t1" and each.status in {"FINISHED", "FAILED", "CANCELLED"}
    ]
    rig.wait(found, within)
    return found()[0]


def refused(rig, reason):
    status = rig.status("t1", "FAILED")
    assert status.reason == reason
    assert all(velocity == ZERO for _, velocity in rig.robot.applied)


def test_it_measures_three_ways_to_stop_and_leaves_a_robot_that_can_be_driven(rig):
    begin(rig, ttl=60.0)
    status = ended(rig)
    assert (status.status, status.reason) == ("FINISHED", "")
    result = status.result
    assert 0.3 <= result["silence_s"] <= 0.45
    assert 0.04 <= result["silence_m"] <= 0.08
    assert result["stop_s"] <= 0.15
    assert result["estop_s"] <= 0.15
    assert result["stop_holds"] is True
    assert result["estop_holds"] is True
    assert LIMIT - 0.01 <= result["fastest"] <= LIMIT + 0.01
    assert (result["limit"], result["deadman"]) == (LIMIT, 0.3)
    assert len(result) <= 16
    assert rig.kernel.latch is None
    assert rig.kernel.is_released
    rig.wait(lambda: rig.robot.told == ZERO)
    kinds = [event.type for event in rig.link.all("event")]
    assert [kind for kind in kinds if kind in {"stopped", "estop", "estop_cleared", "released"}][
        :5
    ] == ["stopped", "released", "estop", "estop_cleared", "released"]
    assert rig.event("estop").detail == "owner:Ada safety_test"


def test_it_moves_less_than_half_a_metre_either_way(rig):
    begin(rig, ttl=60.0)
    ended(rig)
    place, places, before = 0.0, [0.0], None
    for at, velocity in rig.robot.velocities():
        if before is not None:
            place += before[1].linear * (at - before[0])
            places.append(place)
        before = (at, velocity)
    assert -0.5 < min(places) <= max(places) < 0.5


def test_a_base_that_stops_late_fails_with_the_function_that_was_too_late(rig):
    rig.robot.lag = 0.8
    begin(rig, ttl=60.0)
    status = ended(rig)
    assert (status.status, status.reason) == ("FAILED", "too_late: silence")
    assert status.result["silence_s"] > 1.0, "the figures come with the failure"


def test_a_base_that_drives_faster_than_it_is_told_fails(rig):
    rig.robot.factor = 1.5
    begin(rig, ttl=60.0)
    assert ended(rig).reason == "too_fast"


def test_a_base_that_does_not_move_is_not_measured(rig):
    rig.robot.factor = 0.0
    begin(rig, ttl=60.0)
    assert ended(rig).reason == "did_not_move"
    rig.wait(lambda: rig.robot.told == ZERO)


def test_a_base_that_never_stops_is_reported_and_gets_zeros(rig):
    begin(rig, ttl=60.0)
    rig.wait(lambda: rig.robot.told.linear > LIMIT - 0.01)
    rig.robot.runs = 0.1
    assert ended(rig).reason == "did_not_stop: silence"
    rig.wait(lambda: rig.robot.told == ZERO)


@pytest.mark.parametrize("role", ["staff", "owner"])
def test_owner_and_staff_may_start_it(rig, role):
    begin(rig, role=role, ttl=60.0)
    rig.status("t1", "RUNNING")


@pytest.mark.parametrize("role", ["driver", "observer", "screen", "server", "visitor"])
def test_nobody_else_may_start_it(rig, role):
    begin(rig, role=role, session="s1", epoch=1)
    assert rig.status("t1", "FAILED").reason
    assert all(velocity == ZERO for _, velocity in rig.robot.applied)


def test_it_does_not_start_while_another_page_has_the_robot(rig):
    begin(rig, peer="p1")
    refused(rig, "no_lease")


def test_it_does_not_start_without_a_lease(rig):
    rig.act(stamped(m.SafetyTest, "t1", role="owner", user="Ada"))
    refused(rig, "no_lease")


def test_it_does_not_start_on_the_charger(rig):
    rig.robot.reading = still(charger_contact=True)
    rig.wait(lambda: rig.control._dispatcher.reports.reading.charger_contact)
    begin(rig)
    refused(rig, "docked")


def test_a_robot_that_can_leave_its_station_does_so_first(tmp_path):
    capabilities = (*PROFILE.capabilities, "undock")
    robot = MovingBase(profile=replace(PROFILE, capabilities=capabilities))
    with ControlRig(tmp_path, robot=robot) as rig:
        robot.reading = still(charger_contact=True)
        rig.wait(lambda: rig.control._dispatcher.reports.reading.charger_contact)
        begin(rig, ttl=60.0, actions=("undock",))
        assert ended(rig).status == "FINISHED"
        assert [type(action) for action in robot.started] == [m.Undock]


def test_a_robot_that_does_not_get_off_its_station_is_not_measured(tmp_path):
    capabilities = (*PROFILE.capabilities, "undock")
    robot = MovingBase(profile=replace(PROFILE, capabilities=capabilities), refuses="boxed_in")
    with ControlRig(tmp_path, robot=robot) as rig:
        robot.reading = still(charger_contact=True)
        rig.wait(lambda: rig.control._dispatcher.reports.reading.charger_contact)
        begin(rig, ttl=60.0, actions=("undock",))
        assert ended(rig).reason == "boxed_in"


def test_it_does_not_start_under_an_emergency_stop(rig):
    rig.act(stamped(m.EStop, "e1", role="screen"))
    rig.status("e1", "FINISHED")
    begin(rig)
    refused(rig, "estop")


def test_it_does_not_start_while_the_robot_drives_by_itself(rig):
    rig.robot.finishes = False
    rig.act(stamped(m.Dock, "d1", role="server"))
    rig.beat("server", way="mqtt")
    rig.wait(lambda: rig.kernel.navigation is not None)
    begin(rig)
    assert rig.status("t1", "FAILED").reason == "navigating"


def running(rig):
    begin(rig, ttl=60.0)
    rig.wait(lambda: rig.robot.told.linear > 0.1)


def test_a_stop_by_somebody_ends_it_and_holds_the_robot(rig):
    running(rig)
    rig.act(stamped(m.Stop, "x1", role="screen"))
    assert ended(rig).reason == "stopped"
    rig.wait(lambda: rig.robot.told == ZERO)
    assert rig.kernel.held


def test_the_button_on_the_robot_ends_it_and_stays_latched(rig):
    running(rig)
    rig.robot.reading = still(estop=True)
    assert ended(rig).reason == "estop"
    rig.wait(lambda: rig.robot.told == ZERO)
    assert rig.kernel.latch.source == "button"


def test_another_lease_ends_it(rig):
    running(rig)
    rig.lease(session="s2", epoch=2, peer="p2")
    assert ended(rig).reason == "no_lease"
    rig.wait(lambda: rig.robot.told == ZERO)


def test_a_lost_server_ends_it_when_the_lease_expires(rig):
    begin(rig, ttl=1.5)
    assert ended(rig).reason == "no_lease"
    rig.wait(lambda: rig.robot.told == ZERO)


def test_a_robot_that_is_lost_ends_it(rig):
    running(rig)
    rig.robot.lost = "the cable is cut"
    assert ended(rig).reason == "fault"


def test_a_cancelled_one_stops_the_robot_and_reports_nothing_more(rig):
    running(rig)
    rig.act(stamped(m.Cancel, "c1", role="owner", target="t1"))
    assert ended(rig).status == "CANCELLED"
    rig.wait(lambda: rig.robot.told == ZERO)
    rig.sleep(1.0)
    assert rig.robot.told == ZERO


def test_it_can_be_repeated(rig):
    begin(rig, ttl=60.0)
    ended(rig)
    rig.lease(
        session="s2", epoch=2, peer="t2", limits=m.LeaseLimits(linear=LIMIT), video="required"
    )
    rig.act(stamped(m.SafetyTest, "t2", role="owner", user="Ada"))
    rig.wait(
        lambda: any(a.action_id == "t2" and a.status == "FINISHED" for a in rig.link.all("action")),
        30.0,
    )


def test_distance_is_the_area_below_the_speed():
    samples = [SpeedSample(0.0, 1.0), SpeedSample(0.5, 1.0), SpeedSample(1.5, 0.0)]
    assert travelled(samples) == pytest.approx(1.0)
    assert travelled([SpeedSample(0.0, -1.0), SpeedSample(0.5, -1.0)]) == pytest.approx(0.5)
    assert travelled([]) == 0.0
