"""Frames are those of a pinhole camera: each point of the world is at its pixel."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from robots.api.floorplan import DoorState
from robots.api.geometry import Pose2D
from robots.simulator.physics.people import Person
from robots.simulator.render import camera as camera_module
from robots.simulator.render.camera import SceneCamera
from robots.simulator.render.items import before
from robots.simulator.render.lens import grind
from robots.simulator.render.scene import Glass
from robots.world.robot_models import GIRAFF, RHODON
from tests.support.media.office_camera import HOME, OPEN, PLAN, office_camera, picture, pixel_of


@pytest.mark.nightly
@settings(max_examples=60, deadline=None)
@given(st.floats(0.6, 5.0), st.floats(-0.6, 0.6), st.sampled_from([-0.3, 0.0, HOME, 0.6, 0.9]))
def test_floor_point_of_a_pixel_is_that_of_the_pinhole_model(ahead, bearing, tilt):
    lens = grind(GIRAFF.camera, tilt)
    pose = Pose2D(0.0, 0.0, 0.0)
    point = (GIRAFF.camera.x + ahead * math.cos(bearing), ahead * math.sin(bearing), 0.0)
    u, v = pixel_of(pose, point, tilt)
    if not (0 <= u < 640 and 0 <= v < 480):
        return
    row, column = int(v), int(u)
    height = GIRAFF.camera.z
    away = -height / lens.up[row]
    found = (away * lens.ahead[row] + GIRAFF.camera.x, -away * lens.right[column])
    corners = [(c, r) for c in (column, column + 1) for r in (row, row + 1)]
    assert lens.slope[row % 2, row // 2, column] < 0
    pixel = max(
        math.dist(back_to_floor(tilt, *corner), back_to_floor(tilt, column + 0.5, row + 0.5))
        for corner in corners
    )
    assert math.dist(found, point[:2]) <= pixel * 1.01 + 1e-3


def back_to_floor(tilt, u, v):
    model = GIRAFF.camera
    focal = model.width / 2 / math.tan(model.hfov / 2)
    x, y = (u - model.width / 2) / focal, (v - model.height / 2) / focal
    down = math.sin(tilt) + y * math.cos(tilt)
    scale = model.z / max(down, 1e-3)
    return model.x + scale * (math.cos(tilt) - y * math.sin(tilt)), -scale * x


@pytest.mark.parametrize("tilt", [0.2, HOME, 0.5])
@pytest.mark.parametrize("pose", [(2.9, 6.1, math.pi), (2.5, 6.0, 2.9), (2.7, 5.6, 2.75)])
def test_yellow_lines_of_the_dock_are_at_their_pixels(camera, pose, tilt):
    """Within 2 cm + 2 % on the floor: probed points of the line are yellow, those 7 cm beside it
    are not.
    """
    dock = PLAN.dock_of("giraff")
    assert dock is not None
    image = picture(camera, pose, tilt)
    lane = Pose2D(dock.x, dock.y, dock.theta).compose(Pose2D(-0.25, 0.0, 0.0))
    aside = dock.station.width / 2 + 0.04

    def yellow(x, y):
        u, v = pixel_of(pose, (*lane.apply(x, y), 0.0), tilt)
        if not (2 <= u < 638 and 2 <= v < 478):
            return None
        red, _, blue = image[int(v), int(u)]
        return bool(red - blue > 60)

    probes = [
        (yellow(x, s * aside), yellow(x, s * (aside + 0.07)), yellow(x, s * (aside - 0.07)))
        for s in (-1, 1)
        for x in np.linspace(-0.6, 0.5, 12)
    ]
    seen = [probe for probe in probes if None not in probe]
    assert len(seen) >= 6
    assert sum(on for on, _, _ in seen) >= 0.9 * len(seen)
    assert sum(outer or inner for _, outer, inner in seen) <= 0.1 * len(seen)


def test_edge_of_furniture_is_at_its_pixel(camera):
    """The upper front edge of the corridor's cabinet: white below, darker wood above."""
    cabinet = next(piece for piece in PLAN.furniture if piece.name == "cabinet-1")
    pose, image = (4.9, 1.0, 0.2), picture(camera, (4.9, 1.0, 0.2))
    left, front, top = cabinet.x - cabinet.width / 2, cabinet.y - cabinet.depth / 2, cabinet.height
    for share in (0.2, 0.4, 0.6):
        u, v = pixel_of(pose, (left + share * cabinet.width, front, top - 0.03))
        below, above = image[int(v) + 3, int(u)], image[int(v) - 4, int(u)]
        assert below[2] > 120
        assert above[2] < below[2] - 30


@pytest.mark.nightly
def test_frames_of_all_starts_are_detailed_and_different(camera):
    means = []
    for start in PLAN.starts:
        image = picture(camera, (start.x, start.y, start.theta))
        assert image.std() > 25
        assert len(np.unique(image.reshape(-1, 3), axis=0)) > 2000
        means.append(image)
    for number, one in enumerate(means):
        assert all(np.abs(one - other).mean() > 5 for other in means[number + 1 :])


def test_closed_door_is_drawn(camera):
    before = (2.02, 3.7, -math.pi / 2)
    opened = picture(camera, before)
    closed = picture(camera, before, doors={**OPEN, "lab-door": "closed"})
    u, v = pixel_of(before, (2.0, 2.1, 1.0))
    patch = (slice(int(v) - 20, int(v) + 20), slice(int(u) - 20, int(u) + 20))
    assert np.abs(opened[patch] - closed[patch]).mean() > 40
    red, _, blue = closed[patch].reshape(-1, 3).mean(axis=0)
    assert red - blue > 30  # brown wood


@pytest.mark.parametrize("tilt", [-0.2, 0.0, HOME, 0.5])
def test_marker_of_the_dock_is_at_its_pixel_for_every_tilt(camera, tilt):
    pose = Pose2D(10.2, 1.0, 0.0)
    image = picture(camera, tuple(pose), tilt)
    station = PLAN.docks[1].station
    middle, half = station.height + 0.35, 0.2
    for side in (-1, 1):
        for offset, bright in ((half + 0.027, True), (half - 0.033, False)):
            u, v = pixel_of(pose, (11.95, 1.0 + side * offset, middle), tilt)
            if 2 <= v < 478:
                assert (image[int(v), int(u)].mean() > 140) == bright


def test_robot_sees_itself_only_in_the_mirror(camera):
    mirror = PLAN.mirrors[0]
    middle = (mirror.start[1] + mirror.end[1]) / 2
    pose = Pose2D(7.9, middle, math.pi)
    image = picture(camera, tuple(pose))
    # its display, mirrored behind the glass
    u, v = pixel_of(pose, (2 * mirror.start[0] - (7.9 - 0.07), middle, 1.26))
    face = image[int(v) - 14 : int(v) + 14, int(u) - 14 : int(u) + 14].reshape(-1, 3)
    skin = (face[:, 0] > 200) & (face[:, 2] < 200) & (face[:, 0] - face[:, 2] > 40)
    assert skin.mean() > 0.3
    away = picture(camera, (7.9, middle, 0.0)).reshape(-1, 3)
    blue_display = (np.abs(away - (43, 108, 176)).max(axis=1) < 12).mean()
    assert blue_display < 0.001


def test_mirrors_with_equal_hashes_are_drawn_separately(monkeypatch):
    """Python's hashes of -1.0 and -2.0 are the same."""
    camera, asked = SceneCamera(GIRAFF, PLAN, seed=1), []
    glasses = tuple(Glass(np.array([x, 8.0, x, 6.0]), 0.3, 2.0) for x in (-1.0, -2.0))
    camera.scene = dataclasses.replace(camera.scene, mirrors=glasses)
    monkeypatch.setattr(
        camera_module,
        "before",
        lambda things, start, normal: asked.append(start[0]) or before(things, start, normal),
    )
    for _ in range(2):
        picture(camera, (0.0, 7.0, math.pi))
    assert asked == [-1.0, -2.0]


def test_mirror_shows_the_left_at_the_left(camera):
    """A mirror does not swap sides: furniture at the robot's left appears at the left."""
    mirror = PLAN.mirrors[0]
    pose = Pose2D(8.4, 3.4, math.pi)
    image = picture(camera, tuple(pose), 0.15)
    # in the south, at the left of a robot that faces west
    sideboard = next(piece for piece in PLAN.furniture if piece.name == "sideboard")
    u, v = pixel_of(pose, (2 * mirror.start[0] - sideboard.x - 0.5, sideboard.y + 0.2, 0.3), 0.15)
    assert u < 320
    assert image[int(v) - 3 : int(v) + 3, int(u) - 3 : int(u) + 3].mean() < 110  # dark wood


def test_nearer_furniture_hides_what_is_behind_it(camera):
    """Behind the near edge of the coffee table, its board hides the rug."""
    table = next(piece for piece in PLAN.furniture if piece.name == "coffee-table")
    pose = Pose2D(9.4, 4.2, math.pi / 2)
    image = picture(camera, tuple(pose))
    u, v = pixel_of(pose, (table.x, table.y, table.height))
    red, green, blue = image[int(v), int(u)]
    assert red > green > blue
    assert green > 60  # wood, not the rug's dark red


@pytest.mark.nightly
def test_scene_depends_only_on_its_seed():
    one, same, other = (
        picture(SceneCamera(RHODON, PLAN, seed=seed), (5.0, 1.0, 0.0), 0.0) for seed in (3, 3, 4)
    )
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


@settings(max_examples=25, deadline=None)
@given(
    st.floats(0.4, 11.6),
    st.floats(0.4, 7.2),
    st.floats(-3.1, 3.1),
    st.floats(-0.5, 0.9),
    st.booleans(),
)
def test_every_pose_has_a_frame(x, y, theta, tilt, closed):
    state: DoorState = "closed" if closed else "open"
    with np.errstate(all="ignore"):
        image = picture(office_camera(), (x, y, theta), tilt, dict.fromkeys(OPEN, state))
    assert image.shape == (480, 640, 3)
    assert image.max() > 0


def test_caches_of_lenses_and_doors_are_bounded(camera):
    for number in range(12):
        picture(camera, (5.0, 1.0, 0.0), 0.01 * number, {"lab-door": "open", f"x{number}": "open"})
    assert camera._lens.cache_info().currsize <= 2
    assert camera._at_rest.cache_info().currsize <= 8


def test_unchanged_frame_is_not_drawn_again(camera, monkeypatch):
    first = picture(camera, (5.0, 1.0, 0.0))
    monkeypatch.setattr(camera, "_draw_all", lambda *_: pytest.fail("drawn again"))
    assert np.array_equal(picture(camera, (5.0, 1.0, 0.0)), first)


def test_person_who_leaves_disappears_from_the_frame(camera):
    empty = picture(camera, (5.0, 1.0, 0.0))
    picture(camera, (5.0, 1.0, 0.0), people=(Person(8.0, 1.0, 0.0, 0.0, 1, 1.0),))
    assert np.array_equal(picture(camera, (5.0, 1.0, 0.0)), empty)
