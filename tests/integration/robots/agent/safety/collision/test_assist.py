"""The driver's assistance: what it never does, and what it prevents."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from robots.agent.ramp import ZERO
from robots.agent.safety.collision.assist import AssistSettings, DriverAssistance
from robots.agent.safety.collision.steering import SteeringSettings, bounds, helping_turn
from robots.agent.safety.collision.swept import outside
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Velocity
from robots.simulator.physics.drive import WheelMotion, advance, follow
from robots.world.robot_models import GIRAFF, MODELS, RHODON
from robots.world.sensing import points_in_frame

NOTHING = np.zeros((0, 2))
LEVELS = ["slow", "steer"]
TICK = 0.02
STEERING = SteeringSettings()
START = Pose2D(0.0, 0.0, 0.0)


def line(x0, y0, x1, y1, spacing=0.02):
    count = max(2, int(math.hypot(x1 - x0, y1 - y0) / spacing))
    return np.column_stack([np.linspace(x0, x1, count), np.linspace(y0, y1, count)])


def doorway(x, half=0.5):
    """Return the points of a wall, 15 cm thick, with an opening of twice the half width."""
    faces = [(face, side) for face in (x, x + 0.15) for side in (1, -1)]
    return np.vstack([line(face, side * half, face, side * 2.0) for face, side in faces])


WALL = line(1.5, -2.0, 1.5, 2.0)


def go(model, level, stick, points, pose=START, *, seconds=10.0, dock=None, until=None, error=0.0):
    """Drive among world points with a constant stick, ramped as by the kernel; return the poses and
    the last answer.
    """
    assist, limits = DriverAssistance(model.footprint, model.limits), model.limits
    sent, own, motion, poses, answer = ZERO, ZERO, WheelMotion(0.0, 0.0), [pose], None
    for _ in range(int(seconds / TICK)):
        asked = follow(WheelMotion(own.linear, own.angular), WheelMotion(*stick), limits, TICK)
        near = points_in_frame(pose, points)
        goal = pose.inverse().compose(dock) if dock else None
        wish, errors = (
            Velocity(linear=asked.linear, angular=asked.angular),
            np.full(len(near), error),
        )
        answer = assist.shape(wish, sent, near, level, errors=errors, dock=goal)
        sent, own = answer.velocity, answer.own
        motion = follow(motion, WheelMotion(sent.linear, sent.angular), limits, TICK)
        pose = advance(pose, motion, TICK)
        poses.append(pose)
        if until and until(pose):
            break
    return poses, answer


def gap(model, pose, points):
    """Return the distance in metres from the robot's outline to the nearest of (n, 2) points."""
    hull = DriverAssistance(model.footprint, model.limits).hull
    return float(outside(hull, points_in_frame(pose, points)).min())


def shape(wanted, current, points, level, **more):
    """Return the Giraff's answer to a velocity."""
    assist = DriverAssistance(GIRAFF.footprint, GIRAFF.limits)
    return assist.shape(wanted, current, points, level, **more)


def turned(poses):
    """Return how far the robot turned in total, radians."""
    return sum(abs(wrap_angle(after.theta - before.theta)) for before, after in pairwise(poses))


VELOCITIES = st.builds(
    lambda v, w: Velocity(linear=v, angular=w),
    st.floats(-0.3, 0.7) | st.just(0.0),
    st.floats(-0.7, 0.7) | st.just(0.0),
)
POINTS = st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), max_size=12).map(
    lambda found: np.array(found).reshape(-1, 2)
)


@settings(deadline=None, max_examples=100)
@given(VELOCITIES, VELOCITIES, POINTS, st.sampled_from(LEVELS))
def test_velocity_is_never_faster_or_reversed(wanted, current, points, level):
    sent = shape(wanted, current, points, level).velocity
    assert min(0.0, wanted.linear) <= sent.linear <= max(0.0, wanted.linear)
    assert abs(sent.angular) <= max(abs(wanted.angular), STEERING.turn) + 1e-9


@settings(deadline=None, max_examples=100)
@given(VELOCITIES, VELOCITIES, POINTS)
def test_slowing_never_turns_faster_or_the_other_way(wanted, current, points):
    sent = shape(wanted, current, points, "slow").velocity
    assert min(0.0, wanted.angular) <= sent.angular <= max(0.0, wanted.angular)


@settings(deadline=None, max_examples=100)
@given(VELOCITIES, VELOCITIES, POINTS)
def test_steering_stays_on_the_commanded_side(wanted, current, points):
    sent = shape(wanted, current, points, "steer").velocity
    help_ = helping_turn(wanted, STEERING)
    assert (
        min(0.0, wanted.angular) - help_ - 1e-9
        <= sent.angular
        <= max(0.0, wanted.angular) + help_ + 1e-9
    )
    if abs(wanted.angular) >= STEERING.firm * help_:
        assert sent.angular * wanted.angular >= 0.0
    if wanted.linear <= 0.0:
        assert min(0.0, wanted.angular) <= sent.angular <= max(0.0, wanted.angular)


@settings(deadline=None, max_examples=100)
@given(VELOCITIES, POINTS)
def test_firm_turn_is_at_most_halved_while_the_robot_is_not_slowed(wanted, points):
    answer = shape(wanted, ZERO, points, "steer")
    if answer.why in {"free", "steer"}:
        assert (
            abs(answer.velocity.angular)
            >= STEERING.kept
            * (abs(wanted.angular) - STEERING.firm * helping_turn(wanted, STEERING))
            - 1e-9
        )


@settings(deadline=None, max_examples=100)
@given(VELOCITIES)
def test_steering_bounds_contain_the_drivers_turn_and_are_continuous(wanted):
    low, high = bounds(wanted, STEERING)
    assert low <= wanted.angular <= high
    firmer = bounds(Velocity(linear=wanted.linear, angular=wanted.angular + 1e-6), STEERING)
    assert np.allclose(firmer, (low, high), atol=1e-5)
    mirrored = bounds(Velocity(linear=wanted.linear, angular=-wanted.angular), STEERING)
    assert mirrored == pytest.approx((-high, -low))


@pytest.mark.parametrize("level", ["off", *LEVELS])
@settings(deadline=None, max_examples=50)
@given(VELOCITIES, VELOCITIES)
def test_velocity_is_unchanged_without_obstacles(level, wanted, current):
    far = np.array([[30.0, 0.0], [math.nan, 0.1]])
    for points in (NOTHING, far):
        assert shape(wanted, current, points, level).velocity == wanted


@pytest.mark.parametrize("level", LEVELS)
@settings(deadline=None, max_examples=50)
@given(VELOCITIES, POINTS)
def test_zero_velocity_stays_zero(level, current, points):
    assert shape(ZERO, current, points, level).velocity == ZERO


@settings(deadline=None, max_examples=50)
@given(VELOCITIES, POINTS)
def test_level_off_changes_nothing(wanted, points):
    answer = shape(wanted, ZERO, points, "off", silence=math.inf)
    assert (answer.velocity, answer.why) == (wanted, "off")


@pytest.mark.parametrize("series", sorted(MODELS))
@pytest.mark.parametrize("level", LEVELS)
@settings(deadline=None, max_examples=5)
@given(st.integers(0, 10_000))
def test_random_driver_touches_nothing(series, level, seed):
    rng, model = np.random.default_rng(seed), MODELS[series]
    sides = ((1.2, -1.2, 1.2, 1.2), (-1.2, -1.2, -1.2, 1.2), (-1.2, 1.2, 1.2, 1.2))
    walls = [line(*ends) for ends in (*sides, (-1.2, -1.2, 1.2, -1.2))]
    points = np.vstack([*walls, rng.uniform(-1.2, 1.2, (6, 2))])
    points = points[np.hypot(points[:, 0], points[:, 1]) > 0.5]
    pose = Pose2D(0.0, 0.0, float(rng.uniform(-3, 3)))
    for _ in range(8):
        stick = (
            float(rng.uniform(-model.limits.reverse, model.limits.linear)),
            float(rng.uniform(-1, 1)) * model.limits.angular,
        )
        poses, _ = go(model, level, stick, points, pose, seconds=float(rng.uniform(0.2, 2.0)))
        pose = poses[-1]
        # Each stick begins from a stand here, which cuts the braking of the one before short; so
        # look at every pose.
        assert min(gap(model, here, points) for here in poses[::3]) > 0.0


@pytest.mark.parametrize("series", sorted(MODELS))
@pytest.mark.parametrize("level", LEVELS)
def test_robot_driven_at_a_wall_stops_before_it_and_can_turn_away(series, level):
    model = MODELS[series]
    poses, answer = go(model, level, (model.limits.linear, 0.0), WALL)
    assert 0.02 < gap(model, poses[-1], WALL) < 0.12
    assert answer.velocity.linear < 0.02
    assert answer.side == "ahead"
    assert answer.why in {"slow", "stop"}
    assert answer.clearance == pytest.approx(gap(model, poses[-2], WALL), abs=0.01)
    away, _ = go(model, level, (0.0, model.limits.angular), WALL, poses[-1], seconds=6.0)
    assert turned(away) > 2.0
    assert min(gap(model, pose, WALL) for pose in away) > 0.0


def test_stop_reports_the_obstacle():
    points = np.array([[0.36, 0.1], [-1.0, 0.0]])
    answer = shape(Velocity(linear=0.1, angular=0.0), ZERO, points, "slow")
    assert (answer.why, answer.side, answer.point) == ("stop", "ahead", (0.36, 0.1))
    assert answer.clearance == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("x", "y", "side"),
    [(0.6, 0.1, "ahead"), (0.1, 0.6, "left"), (-0.6, -0.1, "behind"), (0.1, -0.6, "right")],
)
def test_nearest_obstacle_is_reported_even_if_it_changes_nothing(x, y, side):
    answer = shape(ZERO, ZERO, np.array([[x, y], [1.9, 0.0]]), "slow")
    assert (answer.why, answer.side, answer.point) == ("free", side, (x, y))


@pytest.mark.parametrize("model", [GIRAFF, RHODON], ids=lambda model: model.series)
@pytest.mark.parametrize("level", LEVELS)
def test_door_of_one_metre_is_passed_at_nearly_full_speed(model, level):
    points = doorway(2.0)
    speed, through = model.limits.linear, lambda pose: pose.x > 3.0
    poses, _ = go(model, level, (speed, 0.0), points, seconds=12.0, until=through)
    assert poses[-1].x > 3.0
    at_full = 3.0 / speed + speed / model.limits.linear_acceleration / 2.0
    assert len(poses) * TICK < 1.2 * at_full


@pytest.mark.parametrize("aside", [-0.35, -0.2, 0.2, 0.35])
def test_steering_centres_the_robot_in_a_door(aside):
    points = doorway(2.0)
    start, through = Pose2D(0.0, aside, 0.0), lambda pose: pose.x > 2.6
    slowed, _ = go(GIRAFF, "slow", (0.7, 0.0), points, start, until=through)
    steered, _ = go(GIRAFF, "steer", (0.7, 0.0), points, start, until=through)
    assert steered[-1].x > 2.6
    between = [abs(pose.y) for pose in steered if 1.8 < pose.x < 2.3]
    assert max(between) < abs(aside)
    assert len(steered) < len(slowed) or abs(aside) < 0.22


@pytest.mark.parametrize("aside", [0.1, -0.1, 0.25])
def test_steering_avoids_an_obstacle(aside):
    post = np.array([1.6, aside]) + 0.12 * np.column_stack(
        [np.cos(np.linspace(0, 6.2, 40)), np.sin(np.linspace(0, 6.2, 40))]
    )
    slowed, _ = go(GIRAFF, "slow", (0.5, 0.0), post)
    steered, _ = go(GIRAFF, "steer", (0.5, 0.0), post)
    assert slowed[-1].x < 1.5
    assert steered[-1].x > 2.2
    assert min(gap(GIRAFF, pose, post) for pose in steered) > 0.02


def test_stopped_robot_keeps_reporting_the_reason():
    poses, _ = go(GIRAFF, "slow", (0.7, 0.0), WALL)
    near = points_in_frame(poses[-1], WALL)
    for speed in (0.001, 0.004, 0.02):
        answer = shape(Velocity(linear=speed, angular=0.0), ZERO, near, "slow")
        assert answer.why in {"slow", "stop"}
        assert answer.side == "ahead"


def test_steering_keeps_a_drive_along_a_wide_corridor_straight():
    walls = np.vstack([line(-1.0, 1.0, 6.0, 1.0), line(-1.0, -1.0, 6.0, -1.0)])
    poses, answer = go(GIRAFF, "steer", (0.5, 0.0), walls, seconds=6.0)
    assert max(abs(pose.y) for pose in poses) < 0.02
    assert answer.why == "free"


def test_steering_does_not_oppose_a_firm_turn_towards_a_wall():
    wall = line(-1.0, 0.8, 6.0, 0.8)
    poses, _ = go(GIRAFF, "steer", (0.4, 0.7), wall, seconds=4.0)
    assert all(later.theta >= earlier.theta - 1e-9 for earlier, later in pairwise(poses))


@pytest.mark.parametrize("level", LEVELS)
def test_robot_keeps_more_distance_from_remembered_obstacles(level):
    behind = line(-0.8, -1.0, -0.8, 1.0)
    exact, _ = go(GIRAFF, level, (-0.3, 0.0), behind, seconds=6.0)
    vague, _ = go(GIRAFF, level, (-0.3, 0.0), behind, seconds=6.0, error=0.025)
    assert gap(GIRAFF, vague[-1], behind) == pytest.approx(
        gap(GIRAFF, exact[-1], behind) + 0.025, abs=0.005
    )


@pytest.mark.parametrize("level", LEVELS)
def test_robot_does_not_turn_towards_a_remembered_obstacle_beside_it(level):
    # 35 mm beside it, where a corner could not be seen
    chair = line(-0.12, 0.315, 0.1, 0.315)
    turning, _ = go(GIRAFF, level, (0.0, -0.7), chair, seconds=3.0, error=0.025)
    assert min(gap(GIRAFF, pose, chair) for pose in turning) > 0.03
    left, _ = go(GIRAFF, level, (0.3, 0.0), chair, seconds=3.0, error=0.025)
    assert left[-1].x > 0.3


@pytest.mark.parametrize("level", LEVELS)
def test_robot_in_contact_can_only_move_away(level):
    touching = line(0.319, -0.14, 0.319, 0.14)  # the nose is a millimetre inside
    back, _ = go(GIRAFF, level, (-0.3, 0.0), touching, seconds=2.0)
    assert back[-1].x < -0.2
    on, answer = go(GIRAFF, level, (0.5, 0.0), touching, seconds=1.0)
    assert on[-1].x == 0.0
    assert answer.why == "stop"


def test_robot_turns_between_two_walls_with_room_for_its_corners():
    walls = np.vstack([line(-2.0, 0.38, 2.0, 0.38), line(-2.0, -0.38, 2.0, -0.38)])
    poses, _ = go(GIRAFF, "slow", (0.0, 0.7), walls, seconds=12.0)
    assert turned(poses) > math.pi
    assert min(gap(GIRAFF, pose, walls) for pose in poses) > 0.0


def test_robot_whose_corner_would_touch_the_wall_can_only_drive_straight():
    wall = line(-2.0, 0.31, 4.0, 0.31)
    turning, answer = go(GIRAFF, "slow", (0.0, -0.7), wall, seconds=2.0)
    assert min(gap(GIRAFF, pose, wall) for pose in turning) > 0.0
    assert (answer.why, answer.side) == ("stop", "left")
    straight, _ = go(GIRAFF, "slow", (0.5, 0.0), wall, seconds=4.0)
    assert straight[-1].x > 0.3


@pytest.mark.parametrize("aside", [0.0, 0.06])
@pytest.mark.parametrize("level", LEVELS)
def test_robot_creeps_into_contact_with_its_own_station(level, aside):
    dock = Pose2D(1.0, 0.0, 0.0)
    station = line(1.32, -0.28, 1.32, 0.28)  # the docked robot's nose touches it
    alone, _ = go(GIRAFF, level, (0.5, 0.0), station, Pose2D(0.0, aside, 0.0))
    assert gap(GIRAFF, alone[-1], station) > 0.02
    start = Pose2D(0.0, aside, 0.0)
    poses, _ = go(GIRAFF, level, (0.5, 0.0), station, start, dock=dock, seconds=9.0)
    assert gap(GIRAFF, poses[-1], station) < 0.01
    near = [pair for pair in pairwise(poses) if gap(GIRAFF, pair[0], station) < 0.02]
    last = [later.x - earlier.x for earlier, later in near]
    assert max(last) <= 0.06 * TICK + 1e-9


def test_robot_in_its_dock_does_not_push_further():
    station = line(0.30, -0.28, 0.30, 0.28)  # a laser that sees it two centimetres too near
    start = Pose2D(-0.01, 0.0, 0.0)
    poses, _ = go(GIRAFF, "slow", (0.5, 0.0), station, start, dock=START, seconds=3.0)
    assert poses[-1].x < 0.01


@pytest.mark.parametrize(
    "dock",
    [Pose2D(1.0, 0.0, 2.0), Pose2D(1.0, 0.6, 0.0), Pose2D(-0.4, 0.0, 0.0), Pose2D(3.0, 0.0, 0.0)],
)
def test_dock_elsewhere_does_not_allow_contact(dock):
    poses, _ = go(GIRAFF, "slow", (0.5, 0.0), line(1.0, -0.5, 1.0, 0.5), dock=dock)
    assert gap(GIRAFF, poses[-1], line(1.0, -0.5, 1.0, 0.5)) > 0.02


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("silence", [0.51, math.inf, math.nan])
def test_silent_laser_stops_the_robot_as_blind(level, silence):
    answer = shape(Velocity(linear=0.3, angular=0.2), ZERO, NOTHING, level, silence=silence)
    assert (answer.velocity, answer.why) == (ZERO, "blind")


def test_slightly_late_scan_does_not_count_as_silent():
    answer = DriverAssistance(GIRAFF.footprint, GIRAFF.limits, AssistSettings(silence=0.5)).shape(
        Velocity(linear=0.3, angular=0.2), ZERO, NOTHING, "slow", silence=0.4
    )
    assert answer.why == "free"
