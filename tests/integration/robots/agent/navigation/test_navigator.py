"""A simulated robot that navigates, and what stops it."""

import math
from itertools import pairwise

import numpy as np
import pytest

from robots.agent.navigation.navigator import IN_VAIN, Navigator, WheelWatch
from robots.agent.navigation.planning.costmap import NoWayError
from robots.agent.navigation.pose_buffer import PoseBuffer
from robots.agent.ramp import ZERO
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Velocity
from robots.simulator.physics.drive import STILL
from robots.simulator.physics.simulation import Simulation
from robots.world.grid import OccupancyGrid
from robots.world.render_plan import rasterise
from robots.world.robot_models import GIRAFF, RHODON
from robots.world.sensing import CENTRE, Estimate
from robots.world.sites import load_site
from tests.support.agents.mapped_building import THICK, building
from tests.support.agents.navigation_rig import Rig

SITE = load_site("office")
MIRROR = next(place for place in SITE.plan.places if place.name == "mirror")


def rig(start, model=GIRAFF, seed=1):
    return Rig(Simulation(model, SITE.plan, seed=seed, start=start), SITE.grid, seed)


def moving(goal_x=8.4):
    """Return a robot on its way along the corridor."""
    made = rig("corridor-centre")
    made.navigator.goto(goal_x, 1.0)
    made.run(3.0)
    assert made.sim.motion != STILL
    return made


def away_from(made, x, y):
    return math.hypot(made.sim.pose.x - x, made.sim.pose.y - y)


@pytest.mark.parametrize(
    ("start", "model", "goal"),
    [
        pytest.param("lab-before-door", GIRAFF, (4.0, 1.1, 1.0), id="through a door"),
        pytest.param("lab-before-door", RHODON, (4.0, 1.1, 1.0), id="the larger robot"),
        pytest.param("lounge-centre", GIRAFF, (MIRROR.x, MIRROR.y, MIRROR.theta), id="the mirror"),
        pytest.param("dock", GIRAFF, (2.5, 5.2), id="out of the dock"),
        pytest.param("lab-centre", RHODON, (8.6, 4.4, 0.0), id="archway, narrow laser"),
    ],
)
def test_robot_reaches_its_goal_with_its_heading_and_without_contact(start, model, goal):
    made = rig(start, model)
    made.navigator.goto(*goal)
    done = made.run(60.0)
    assert (done.status, made.sim.contacts, done.progress) == ("FINISHED", 0, 1.0)
    assert not made.sim.docked
    assert away_from(made, *goal[:2]) < 0.2
    assert abs(wrap_angle(made.sim.pose.theta - [*goal, made.sim.pose.theta][2])) < 0.15
    made.settle()
    assert made.sim.motion == STILL
    assert made.step().velocity is None


def test_path_shrinks_and_progress_grows():
    made = rig("corridor-centre")
    made.navigator.goto(8.4, 1.0)
    steps = [made.step() for _ in range(60)]
    assert len(steps[0].path) > len(steps[-1].path) > 0
    assert steps[0].path[-1] == pytest.approx((8.4, 1.0))
    assert all(0.0 <= a.progress <= b.progress + 0.05 for a, b in pairwise(steps))


@pytest.mark.nightly
def test_drawn_line_is_followed_and_leads_around_a_desk():
    made = rig("lab-centre")
    made.navigator.follow([(3.2, 4.6), (4.6, 4.9), (5.0, 3.6), (3.4, 3.3), (1.6, 4.0), (2.2, 5.4)])
    done = made.run(80.0)
    assert (done.status, made.sim.contacts) == ("FINISHED", 0)
    trail = np.array(made.trail)[:, :2]
    for x, y in ((4.6, 4.9), (5.0, 3.6), (3.4, 3.3), (1.6, 4.0)):
        assert np.hypot(trail[:, 0] - x, trail[:, 1] - y).min() < 0.45
    through = rig("lab-centre")
    through.navigator.follow([(3.2, 5.2), (2.5, 6.5), (3.4, 6.4)])
    assert through.run(60.0).status == "FINISHED"
    assert through.sim.contacts == 0


@pytest.mark.nightly
def test_robot_takes_another_route_when_a_door_closes():
    made = rig("lab-before-door")
    made.navigator.goto(2.0, 1.0)
    made.run(1.0)
    made.sim.set_doors({"lab-door": "closed"})
    done = made.run(150.0)
    assert (done.status, made.collisions) == ("FINISHED", 0)
    closed = made.navigator._obstacle_map.doors.closed(made.sim.time)
    assert [door.name for door in closed] == ["lab-door"]
    assert made.sim.distance > 15.0


def test_robot_without_a_route_waits_and_then_names_the_doors():
    made = rig("2.0,1.0,0.5")
    made.sim.set_doors({"lab-door": "closed", "lounge-door": "closed"})
    made.navigator.goto(3.2, 4.6)
    done = made.run(150.0)
    assert done.status == "FAILED"
    assert done.reason == (
        "all_blocked: door_closed: Laboratory door, door_closed: Living room door"
    )
    assert "waits_for_route" in made.reasons
    made.settle()
    assert made.sim.motion == STILL


@pytest.mark.nightly
def test_waiting_robot_continues_when_a_door_opens():
    made = rig("10.0,1.0,1.57")
    made.sim.set_doors({"lab-door": "closed", "lounge-door": "closed"})
    made.navigator.goto(9.9, 3.6)
    while "waits_for_route" not in made.reasons:
        assert made.step().status == "RUNNING"
        assert made.sim.time < 90.0
    nearest = min(SITE.plan.doors, key=lambda door: away_from(made, *door.start))
    made.sim.set_doors({nearest.name: "open"})
    assert made.run(100.0).status == "FINISHED"
    assert made.collisions == 0


@pytest.mark.parametrize(
    ("x", "y", "theta", "reason"),
    [
        (40.0, 1.0, None, "outside: "),
        (math.inf, 1.0, None, "no_goal"),
        (3.0, 1.0, math.nan, "no_goal"),
        (9.4, 7.15, None, "in_wall: "),
    ],
)
def test_impossible_goals_are_refused_with_the_reason(x, y, theta, reason):
    navigator = rig("lab-centre").navigator
    with pytest.raises(NoWayError, match=reason):
        navigator.goto(x, y, theta)
    assert navigator._task is None


def test_short_lines_are_refused():
    navigator = rig("lab-centre").navigator
    with pytest.raises(NoWayError, match="no_goal"):
        navigator.follow([(1.0, 1.0)])
    with pytest.raises(NoWayError, match="no_goal"):
        navigator.follow([(1.0, 1.0), (math.nan, 2.0)])


def test_map_without_free_space_is_refused():
    full = OccupancyGrid(np.zeros_like(SITE.grid.image), SITE.grid.transform)
    with pytest.raises(NoWayError, match="no free space"):
        Navigator(full, None, np.array(GIRAFF.footprint), GIRAFF.limits, "giraff")


def test_cancel_brakes_to_rest_and_then_sends_no_velocity():
    made = moving()
    made.navigator.cancel()
    assert (made.step().velocity, made.step().reason) == (ZERO, "cancelled")
    made.settle()
    assert made.sim.motion == STILL
    assert made.step().velocity is None


def test_lost_robot_stops_and_reports_it():
    made = moving()
    made.knows_where = False
    done = made.run(20.0)
    assert (done.status, done.reason) == ("FAILED", "lost")
    assert made.sim.motion == STILL


def test_robot_continues_when_the_laser_is_back_in_time():
    made = moving(7.0)
    made.laser_works = False
    made.run(1.5)
    assert made.sim.motion == STILL
    made.laser_works = True
    assert made.run(30.0).status == "FINISHED"


@pytest.mark.nightly
def test_robot_does_not_collide_with_walking_people():
    made = Rig(
        Simulation(GIRAFF, SITE.plan, seed=1, start="corridor-centre", people=3), SITE.grid, 1
    )
    made.navigator.goto(8.6, 4.4)
    assert made.run(50.0).status != "FAILED"
    assert made.sim.distance > 1.0
    assert made.seen_collisions == 0


def test_wheel_watch_waits_for_as_long_as_a_base_may_take_to_start():
    watch, asked, here = WheelWatch(), Velocity(linear=0.3, angular=0.0), Pose2D(0.0, 0.0, 0.0)
    assert not any(watch.stuck(asked, here, step / 10.0) for step in range(round(IN_VAIN * 10)))
    assert watch.stuck(asked, here, IN_VAIN + 0.2)
    assert not watch.stuck(asked, Pose2D(0.05, 0.0, 0.0), IN_VAIN + 0.3)
    assert not watch.stuck(ZERO, here, 2.0 * IN_VAIN + 1.0)


def test_late_estimate_is_moved_by_the_odometry():
    where = PoseBuffer()
    unknown = Estimate(0.0, CENTRE, (0.0,) * 6, 1.0, localized=True)
    for step in range(11):
        where.take(step / 10.0, Pose2D(step / 10.0, 0.0, 0.0), unknown)
    late = Estimate(0.55, Pose2D(5.0, 5.0, math.pi / 2.0), (0.0,) * 6, 1.0, localized=True)
    where.take(1.1, Pose2D(1.1, 0.0, 0.0), late)
    assert where.odometry_at(0.55) == pytest.approx((0.55, 0.0, 0.0))
    assert where.pose() == pytest.approx((5.0, 5.55, math.pi / 2.0))
    assert where.odometry_at(-5.0) == pytest.approx((0.0, 0.0, 0.0))


def test_goal_is_reached_although_a_wall_blocks_the_last_centimetres():
    """The pose is wrong by the same six centimetres all the time."""
    plan, beside_wall = building(), 2.0 - THICK / 2.0 - 0.32
    made = Rig(Simulation(GIRAFF, plan, seed=1, start="3.0,1.0,1.57"), rasterise(plan), 1)
    made.wander.of = lambda truth, _dt: Pose2D(truth.x, truth.y - 0.06, truth.theta)
    made.navigator.goto(3.0, beside_wall)
    done = made.run(60.0)
    assert (done.status, done.reason, made.sim.contacts) == ("FINISHED", "", 0)
    assert abs(made.sim.pose.y - beside_wall) < 0.1
