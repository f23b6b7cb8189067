"""The sensors of the collision monitor, their loss, and speeds where none observes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from robots.agent.control.state_validation import UnsoundReadingError, sound
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import DepthCamera, ObstaclePoints, Sonar, SonarEcho
from robots.agent.safety.collision.odometry import OdometryTrack
from robots.agent.safety.collision.swept import hull, outside
from robots.agent.safety.collision_monitor import MONITOR, CollisionMonitor
from robots.agent.safety.obstacle_sources import (
    BumperSource,
    DepthSource,
    LaserSource,
    SonarSource,
    sources_of,
)
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Laser, Scan, Velocity
from tests.support.agents.kernel_bench import LIMITS, TICK, bench_with_driver
from tests.support.agents.scripted_robot import PROFILE, still

FOOTPRINT = ((0.3, -0.25), (0.3, 0.25), (-0.3, 0.25), (-0.3, -0.25))
ORIGIN = Pose2D(0.0, 0.0, 0.0)
AHEAD, BACK = Velocity(linear=0.5, angular=0.0), Velocity(linear=-0.3, angular=0.0)
FRONT = Sonar(0.3, 0.0, 0.0, width=0.5, nearest=0.05)
REAR = Sonar(-0.3, 0.0, math.pi, width=0.5, nearest=0.05)


def reading(stamp=1.0, odometry=ORIGIN, **fields):
    return still(stamp=stamp, odometry=odometry, **fields)


def monitor(*sources):
    return CollisionMonitor(FOOTPRINT, LIMITS, sources)


def echoes(*distances, stamp=1.0):
    return tuple(SonarEcho(index, stamp, distance) for index, distance in enumerate(distances))


def depth(points=(), stamp=1.0):
    """Return points (n, 2) of a depth camera."""
    return ObstaclePoints(stamp, np.array(points, dtype=float).reshape(-1, 2))


class SonarRig:
    """A sonar source and the robot's track."""

    def __init__(self, *sonars):
        self.source, self.track, self.stamp = SonarSource(sonars), OdometryTrack(), 0.0

    def hear(self, *distances, at=ORIGIN):
        """Take echoes 0.5 s after the last ones; return the points (n, 2) within 3 m."""
        self.stamp += 0.5
        here = self.track.add(self.stamp, at)
        sensed = reading(self.stamp, sonar=echoes(*distances, stamp=self.stamp))
        self.source.sense(sensed, self.track, self.stamp)
        return self.source.seen(here, 3.0)


def depth_source(*points):
    """Return a depth camera's source after a reading at the origin, and the robot's track."""
    source, track = DepthSource(DepthCamera(x=0.2, width=1.2, farthest=3.0)), OdometryTrack()
    track.add(1.0, ORIGIN)
    source.sense(reading(points=depth(points)), track, 1.0)
    return source, track


# --- the sensors of a profile ---------------------------------------------------------------------


def test_each_sensor_of_a_profile_is_a_separate_source():
    def kinds(**fields):
        return [type(source).__name__ for source in sources_of(replace(PROFILE, **fields))]

    assert kinds() == []
    assert kinds(laser=Laser(x=0.0)) == ["LaserSource"]
    assert kinds(sonars=(FRONT,), bumper=True) == ["SonarSource", "BumperSource"]
    assert kinds(depth=DepthCamera(), laser=Laser(x=0.0)) == ["LaserSource", "DepthSource"]


# --- sonar ----------------------------------------------------------------------------------------


def test_an_echo_may_lie_anywhere_on_its_arc():
    arc = SonarRig(FRONT).hear(1.0)
    assert np.hypot(arc[:, 0] - 0.3, arc[:, 1]) == pytest.approx(np.ones(len(arc)))
    assert np.abs(np.arctan2(arc[:, 1], arc[:, 0] - 0.3)).max() == pytest.approx(0.25)
    assert np.diff(arc[:, 1]).max() <= SonarSource.SPACING


def test_echo_below_the_nearest_distance_counts_at_half_of_it():
    assert np.allclose(np.hypot(*(SonarRig(FRONT).hear(0.05) - (0.3, 0.0)).T), 0.025)


def test_a_point_is_removed_after_two_lost_echoes():
    rig = SonarRig(FRONT)
    rig.hear(0.6)
    assert len(rig.hear(None))
    assert len(rig.hear(None)) == 0


def test_point_between_two_cones_is_kept():
    rig = SonarRig(FRONT)
    rig.hear(0.5)
    kept = rig.hear(2.0, at=Pose2D(0.3, 0.0, 1.2))
    assert any(math.hypot(x, y) < 0.6 for x, y in kept)


def test_echo_is_forgotten_by_distance_driven_and_not_by_time():
    rig = SonarRig(FRONT)
    rig.hear(0.6)
    rig.stamp += 3600.0
    assert len(rig.hear(0.6))
    for step in range(1, 13):
        rig.hear(0.6, at=Pose2D(0.0, 0.2 * step, math.pi / 2))
    assert all(seen[2] > 0.2 for seen in rig.source._points)


def test_an_echo_of_a_sonar_that_the_profile_does_not_name_is_ignored():
    assert len(SonarRig(FRONT).hear(None, 0.5)) == 0


# --- collision monitoring by sonar and bumper -----------------------------------------------------


def test_a_driver_is_stopped_before_an_obstacle_of_a_sonar():
    watch = monitor(SonarSource((FRONT, REAR)))
    watch.sense(reading(sonar=echoes(0.12, None)), 1.0)
    assert watch.shape(AHEAD, ZERO, "slow", 1.1).velocity.linear < 0.02
    assert watch.why(1.1)[0] == "stop"
    assert watch.shape(BACK, ZERO, "slow", 1.1).velocity == BACK


def test_one_silent_sonar_stops_the_driver():
    watch = monitor(SonarSource((FRONT, REAR)))
    watch.sense(reading(sonar=echoes(None, None)), 1.0)
    for step in range(1, 12):
        now = 1.0 + step / 10
        watch.sense(reading(now, sonar=echoes(None, stamp=now)), now)
        assert (watch.shape(AHEAD, AHEAD, "slow", now).why == "blind") == (step > 10), step


def corners_of(velocity, footprint=FOOTPRINT):
    """The (n,) speeds of the robot's corners, and their directions."""
    arms = np.array(footprint)
    x = velocity.linear - velocity.angular * arms[:, 1]
    y = velocity.angular * arms[:, 0]
    return np.hypot(x, y), np.arctan2(y, x)


def test_an_assisted_driver_creeps_backwards_where_no_sensor_observes():
    watch = monitor(SonarSource((FRONT,)))
    watch.sense(reading(sonar=echoes(None)), 1.0)
    assert watch.shape(AHEAD, AHEAD, "slow", 1.1).velocity == AHEAD
    back = watch.shape(BACK, ZERO, "slow", 1.1)
    assert back.velocity.linear == pytest.approx(-MONITOR.creep)
    assert back.why == "slow"


@pytest.mark.parametrize("level", ["slow", "steer"])
def test_an_assisted_robot_with_a_front_camera_turns_at_a_creep(level):
    watch = monitor(DepthSource(DepthCamera()))
    watch.sense(reading(points=depth()), 1.0)
    turn = Velocity(linear=0.0, angular=1.0)
    shaped = watch.shape(turn, turn, level, 1.1)
    speeds, _ = corners_of(shaped.velocity)
    assert speeds.max() == pytest.approx(MONITOR.creep)
    assert shaped.why == "slow"
    curve = Velocity(linear=0.5, angular=0.3)  # every corner moves into the view
    assert watch.shape(curve, curve, "slow", 1.1).velocity == curve


@pytest.mark.parametrize("level", ["slow", "steer"])
def test_a_robot_with_sensors_all_round_turns_as_fast_as_its_driver_wants(level):
    ring = SonarSource(
        tuple(Sonar(0.0, 0.0, math.tau / 12 * number, width=0.4) for number in range(12))
    )
    watch = monitor(ring)
    watch.sense(reading(sonar=echoes(*[None] * 12)), 1.0)
    for wanted in (Velocity(linear=0.0, angular=1.0), Velocity(linear=-0.2, angular=0.7)):
        assert watch.shape(wanted, wanted, level, 1.1).velocity == wanted


cones = st.tuples(st.floats(-math.pi, math.pi), st.floats(0.1, 3.0))
boxes = st.tuples(st.floats(0.1, 0.6), st.floats(0.1, 0.6), st.floats(0.1, 0.6))
speeds = st.builds(Velocity, linear=st.floats(-0.5, 1.0), angular=st.floats(-2.0, 2.0))


@given(
    boxes,
    st.lists(cones, max_size=4),
    st.none() | cones,
    speeds,
    st.sampled_from(("slow", "steer")),
)
def test_no_corner_moves_faster_than_a_creep_where_no_sensor_observes(
    box, sonars, camera, wanted, level
):
    nose, tail, half = box
    footprint = ((nose, half), (-tail, half), (-tail, -half), (nose, -half))
    mounted = [Sonar(0.0, 0.0, theta, width=width) for theta, width in sonars]
    seen = [DepthCamera(theta=theta, width=width) for theta, width in (camera and [camera]) or []]
    sources = [SonarSource(mounted)] if mounted else []
    sources += [DepthSource(each) for each in seen]
    watch = CollisionMonitor(footprint, LIMITS, [*sources, BumperSource(hull(footprint))])
    watch.sense(reading(sonar=echoes(*[None] * len(mounted)), points=depth(), bumper=()), 1.0)
    sent = watch.shape(wanted, wanted, level, 1.1).velocity
    share = sent.linear / wanted.linear if wanted.linear else sent.angular / (wanted.angular or 1.0)
    assert 0.0 <= share <= 1.0
    assert sent.angular == pytest.approx(share * wanted.angular), "the robot keeps to its arc"
    for speed, direction in zip(*corners_of(sent, footprint), strict=True):
        beside = [
            abs(wrap_angle(direction - each.theta)) - each.width / 2 for each in mounted + seen
        ]
        if speed > MONITOR.creep + 1e-9:
            assert min(beside, default=math.inf) < MONITOR.unobserved_beside


def test_a_turn_that_steering_adds_is_slowed_too_where_no_sensor_observes():
    dice, turned = np.random.default_rng(1), 0
    for _ in range(300):
        camera = DepthCamera(width=dice.uniform(0.3, 1.2))
        watch = monitor(DepthSource(camera))
        posts = dice.uniform((0.35, -0.8), (1.5, 0.8), (6, 2))
        watch.sense(reading(points=depth(posts)), 1.0)
        wanted = Velocity(linear=dice.uniform(0.0, 1.0), angular=dice.uniform(-1.0, 1.0))
        shaped = watch.shape(wanted, wanted, "steer", 1.1)
        turned += abs(shaped.turn) > 0.05
        edge = camera.width / 2 + MONITOR.unobserved_beside
        for speed, direction in zip(*corners_of(shaped.velocity), strict=True):
            assert speed <= MONITOR.creep + 1e-9 or abs(direction) < edge
    assert turned > 30


def test_a_driver_who_turns_along_the_edge_of_a_view_is_slowed_without_jumps():
    bench = bench_with_driver(monitor=monitor(DepthSource(DepthCamera())))
    bench.kernel.assist.level = "slow"
    for _ in range(200):
        bench.kernel.monitor.sense(reading(bench.now, points=depth(stamp=bench.now)), bench.now)
        bench.run(TICK, every=TICK, linear=0.4, angular=1.2)
    sent = [decision.velocity for _, decision in bench.outputs if decision.velocity]
    assert sent[-1].angular > 0.1
    steps = np.diff([velocity.linear for velocity in sent[100:]])
    assert np.abs(steps).max() < 1e-3


def test_a_robot_whose_bumper_is_silent_creeps_though_its_sonars_report_no_obstacle():
    watch = monitor(SonarSource((FRONT, REAR)), BumperSource(hull(FOOTPRINT)))
    watch.sense(reading(sonar=echoes(None, None), bumper=()), 1.0)
    assert watch.shape(AHEAD, AHEAD, "slow", 1.1).velocity == AHEAD
    watch.sense(reading(1.6, sonar=echoes(None, None, stamp=1.6)), 1.6)
    sent = watch.shape(AHEAD, AHEAD, "slow", 1.6).velocity
    assert sent.linear == pytest.approx(MONITOR.creep)


def test_an_obstacle_nearer_than_a_sonar_can_measure_makes_every_corner_creep():
    left = Sonar(0.0, 0.25, math.pi / 2, width=0.5, nearest=0.05)
    watch = monitor(SonarSource((FRONT, REAR, left)))
    watch.sense(reading(sonar=echoes(None, None, 0.05)), 1.0)
    sent = watch.shape(AHEAD, ZERO, "slow", 1.1).velocity
    assert 0.0 < sent.linear <= MONITOR.creep + 1e-9


def test_a_bumper_remembers_where_a_contact_was():
    source, track = BumperSource(hull(FOOTPRINT)), OdometryTrack()
    track.add(1.0, ORIGIN)
    source.sense(reading(bumper=(0.0,)), track, 1.0)
    points = source.seen(ORIGIN, 1.0)
    assert 0.0 < outside(hull(FOOTPRINT), points).min() < 0.02
    assert source.seen(Pose2D(-0.2, 0.0, 0.0), 1.0)[:, 0].min() == pytest.approx(
        points[:, 0].min() + 0.2
    )
    source.sense(reading(30.0, bumper=(0.0,)), track, 30.0)
    assert len(source.seen(ORIGIN, 1.0)) == 0


# --- depth points ---------------------------------------------------------------------------------


def test_depth_points_have_the_places_of_objects_and_an_empty_view_is_no_fault():
    source, track = depth_source((1.0, 0.1), (9.0, 0.0), (-1.0, 0.0))
    near = source.seen(ORIGIN, 1.5)
    assert near == pytest.approx(np.array([[1.0, 0.1]]), abs=0.01)
    assert source.last_received_at() == 1.0
    for stamp in (1.1, 1.2, 1.3):
        source.sense(reading(stamp, points=depth(stamp=stamp)), track, stamp)
    assert source.last_received_at() == 1.3
    assert len(source.seen(ORIGIN, 4.0)) == 0, "no obstacle at the end of an empty view"
    assert source.beside(np.array([0.0, -0.6, 1.0, math.pi])) == pytest.approx(
        [0.0, 0.0, 0.4, math.pi - 0.6]
    )


def test_point_that_left_the_view_of_a_depth_camera_is_forgotten():
    source, track = depth_source((0.45, 0.0))
    assert len(source.seen(ORIGIN, 1.0)) == 1
    for stamp in np.arange(1.1, 2.05, 0.1).tolist():
        source.sense(reading(stamp, points=depth(stamp=stamp)), track, stamp)
    assert len(source.seen(ORIGIN, 1.0)) == 0


def test_navigation_uses_arcs_of_sonars_only_without_a_better_sensor():
    sensed = reading(points=depth([(1.0, 0.1)]), sonar=echoes(0.6))
    for others, expected in (
        ([], 0.9),
        ([BumperSource(hull(FOOTPRINT))], 0.9),
        ([DepthSource(DepthCamera())], 1.0),
    ):
        watch = monitor(SonarSource((FRONT,)), *others)
        watch.sense(sensed, 1.0)
        assert watch.points()[:, 0].max() == pytest.approx(expected, abs=0.02)
        assert watch.clearance() < 0.7


def test_navigation_stops_by_the_sonar_at_a_glass_door():
    scan = Scan(stamp=1.0, angle_min=-1.5, angle_increment=0.1, range_max=5.0, ranges=(4.0,) * 31)
    watch = monitor(LaserSource(Laser(x=0.0)), SonarSource((FRONT,)))
    watch.sense(reading(scan=scan, sonar=echoes(0.15)), 1.0)
    assert np.hypot(*watch.points().T).min() == pytest.approx(0.45, abs=0.03)


def test_a_silent_depth_camera_stops_the_driver():
    watch = monitor(DepthSource(DepthCamera()))
    watch.sense(reading(points=depth()), 1.0)
    assert watch.shape(AHEAD, AHEAD, "slow", 1.4).why == "free"
    assert watch.shape(AHEAD, AHEAD, "slow", 1.6).why == "blind"


# --- a robot without odometry ---------------------------------------------------------------------


def test_a_robot_without_odometry_is_tracked_by_its_velocity():
    watch = monitor(SonarSource((FRONT, REAR)))
    watch.sense(reading(odometry=None, sonar=echoes(1.0, None)), 1.0)
    for step in range(1, 51):
        stamp = 1.0 + step / 50
        watch.sense(reading(stamp, odometry=None, velocity=AHEAD), stamp)
    assert watch.clearance() == pytest.approx(0.45, abs=0.06)


# --- invalid readings -----------------------------------------------------------------------------


def test_invalid_numbers_are_left_out_or_refused():
    points = depth([[1.0, math.nan], [1.0, 2.0]])
    checked = sound(reading(sonar=echoes(1.0, math.nan, -1.0, None), points=points))
    assert [echo.distance for echo in checked.sonar] == [1.0, None]
    assert checked.points.points.tolist() == [[1.0, 2.0]]
    for nonsense in ({"bumper": (math.nan,)}, {"points": ObstaclePoints(1.0, np.zeros(3))}):
        with pytest.raises(UnsoundReadingError):
            sound(reading(**nonsense))
