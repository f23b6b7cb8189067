"""People in frames: place, size and walk, and how walls, doors and mirrors hide and show them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from robots.simulator.physics.people import Person
from robots.simulator.render.body import limbs, look_of
from robots.simulator.render.people import PHASES, STANDING, VIEWS, chosen
from robots.simulator.render.sprite import draw
from tests.support.media.office_camera import OPEN, PLAN, office_camera, picture, pixel_of


def changed(camera, pose, people, doors=OPEN):
    """Return which pixels people change, without their soft shadows; (height, width) bool."""
    with_people = picture(camera, pose, doors=doors, people=people)
    return np.abs(with_people - picture(camera, pose, doors=doors)).max(axis=2) > 60


def box(mask):
    """Return top, bottom, left, right of the pixels that are set."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(rows[0]), int(rows[-1]), int(columns[0]), int(columns[-1])


@pytest.mark.parametrize("place", [(8.0, 1.1), (9.0, 0.9), (10.0, 1.2)])
def test_person_has_the_right_height_and_position(camera, place):
    pose = (5.0, 1.0, 0.0)
    top, _, left, right = box(changed(camera, pose, (Person(*place, math.pi, 0.0, 1, 0.0),)))
    height = look_of(1).height
    u, v = pixel_of(pose, (*place, height))
    metre = pixel_of(pose, (*place, height - 1.0))[1] - v
    assert abs(top - v) < 0.06 * metre + 3
    assert abs((left + right) / 2 - u) < 0.1 * metre + 3
    assert 0.3 * metre < right - left < 0.75 * metre


def test_only_a_closed_door_hides_a_person_behind_it(camera):
    before, behind = (2.02, 3.7, -math.pi / 2), (Person(2.0, 0.9, 0.0, 0.0, 4, 0.0),)
    assert changed(camera, before, behind).sum() > 500
    assert changed(camera, before, behind, {**OPEN, "lab-door": "closed"}).sum() == 0


def test_wall_hides_a_person_in_the_next_room(camera):
    assert changed(camera, (5.0, 1.0, 0.0), (Person(9.5, 5.0, 0.0, 0.0, 1, 1.0),)).sum() == 0


def test_nearer_of_two_people_hides_the_other(camera):
    pose, near, far = (
        (5.0, 1.0, 0.0),
        Person(7.4, 1.0, math.pi, 0.0, 1, 0.0),
        Person(9.4, 1.0, math.pi, 0.0, 2, 0.0),
    )
    alone, both = picture(camera, pose, people=(near,)), picture(camera, pose, people=(near, far))
    u, v = pixel_of(pose, (near.x, near.y, 1.2))
    chest = (slice(int(v) - 10, int(v) + 10), slice(int(u) - 10, int(u) + 10))
    assert np.array_equal(alone[chest], both[chest])
    assert np.array_equal(both, picture(camera, pose, people=(far, near)))


def test_mirror_shows_a_person_from_the_other_side(camera):
    """The back is turned to the robot; the mirror shows the face."""
    mirror = PLAN.mirrors[0]
    middle = (mirror.start[1] + mirror.end[1]) / 2
    pose, x, y = (9.4, middle, math.pi), 8.3, middle + 0.35
    image = picture(camera, pose, people=(Person(x, y, math.pi, 0.0, 1, 0.0),))
    height = look_of(1).height
    skins = []
    for place in ((x, y), (2 * mirror.start[0] - x, y)):
        u, v = pixel_of(pose, (*place, height - 0.14))
        metre = pixel_of(pose, (*place, height - 1.14))[1] - v
        head = image[
            int(v - 0.05 * metre) : int(v + 0.05 * metre),
            int(u - 0.04 * metre) : int(u + 0.04 * metre),
        ].reshape(-1, 3)
        distance = np.abs(head - look_of(1).skin * 255).max(axis=1)
        skins.append(float((distance < 70).mean()))
    back, face = skins
    assert face > 0.3
    assert back < 0.5 * face


def test_shadow_is_on_the_floor_at_the_feet(camera):
    pose, person = (5.0, 1.0, 0.0), Person(8.0, 1.0, math.pi, 0.0, 1, 0.0)
    u, v = pixel_of(pose, (person.x - 0.08, person.y - 0.3, 0.0))
    spot = (slice(int(v) - 1, int(v) + 2), slice(int(u) - 2, int(u) + 3))
    assert (
        picture(camera, pose, people=(person,))[spot].mean()
        < picture(camera, pose)[spot].mean() - 5
    )


def test_person_behind_the_mirrors_wall_has_no_shadow_in_it(camera):
    mirror = PLAN.mirrors[0]
    pose = (mirror.start[0] + 1.5, (mirror.start[1] + mirror.end[1]) / 2, math.pi)
    behind = Person(mirror.start[0] - 1.0, pose[1], 0.0, 0.0, 1, 0.0)
    assert np.array_equal(picture(camera, pose, people=(behind,)), picture(camera, pose))


def test_only_walking_people_move_their_legs(camera):
    pose = (5.0, 1.0, 0.0)
    walking, still = (
        [
            picture(camera, pose, people=(Person(8.0, 1.0, 1.5, stride, 1, speed),))
            for stride in (0.0, math.pi / 2)
        ]
        for speed in (1.0, 0.0)
    )
    assert (np.abs(walking[0] - walking[1]).max(axis=2) > 40).sum() > 200
    assert np.array_equal(*still)


def test_left_foot_is_ahead_at_a_quarter_of_the_stride():
    left, right = (limbs(look_of(1), math.pi / 2)[number].end for number in (2, 5))  # the shoes
    assert left[1] > 0.0 > right[1]
    assert left[0] > right[0] + 0.4


@pytest.mark.parametrize("stride", [0.0, 1.1, 2.9, 4.4, None])
@pytest.mark.parametrize("bearing", [0.0, 0.7, math.pi / 2, 2.2])
def test_view_from_the_right_is_the_mirror_image_half_a_stride_later(stride, bearing):
    """For this reason half of all sprites are enough."""
    other = None if stride is None else stride + math.pi
    one, two = (
        draw(limbs(look_of(3), stride), bearing, 1.95),
        draw(limbs(look_of(3), other), -bearing, 1.95),
    )
    assert one.left == pytest.approx(-two.right, abs=0.021)
    columns = min(len(one.picture), len(two.picture))
    a, b = ~np.isnan(one.picture[:columns, :, 0]), ~np.isnan(two.picture[::-1][:columns, :, 0])
    assert (a == b).mean() > 0.97


@given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.integers(-3, 10**6), st.floats(0.0, 2.0))
def test_every_stride_and_bearing_has_a_sprite(bearing, stride, look, speed):
    (number, phase, view), _ = chosen(Person(0.0, 0.0, 0.0, stride, look, speed), bearing)
    assert number == look
    assert phase == STANDING or 0 <= phase < PHASES
    assert 0 <= view < VIEWS


@settings(max_examples=25, deadline=None)
@given(
    st.floats(0.4, 11.6),
    st.floats(0.4, 7.2),
    st.floats(-3.1, 3.1),
    st.floats(0.0, 0.6),
    st.floats(-3.1, 3.1),
)
def test_every_position_of_a_person_has_a_frame(x, y, theta, distance, bearing):
    """Even inside the robot's head."""
    person = Person(
        x + distance * math.cos(bearing), y + distance * math.sin(bearing), bearing, theta, 1, 1.0
    )
    assert picture(office_camera(), (x, y, theta), people=(person, person)).max() > 0
