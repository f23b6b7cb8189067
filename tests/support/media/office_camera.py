"""The simulated camera of a giraff in the office, and where a pinhole camera puts a point."""

import functools
import math

import numpy as np

from robots.agent.media.pixels import video_frame
from robots.agent.robot_interface import Frame
from robots.api.floorplan import DoorState
from robots.api.geometry import Pose2D
from robots.simulator.physics.people import Person
from robots.simulator.render.camera import SceneCamera
from robots.world.robot_models import GIRAFF
from robots.world.sites import load_plan

PLAN, _ = load_plan("office")
OPEN: dict[str, DoorState] = {door.name: "open" for door in PLAN.doors}
assert GIRAFF.tilt is not None
HOME = GIRAFF.tilt.home
Triple = tuple[float, float, float]


@functools.cache
def office_camera() -> SceneCamera:
    return SceneCamera(GIRAFF, PLAN, seed=1)


def picture(
    camera: SceneCamera,
    pose: Triple,
    tilt: float = HOME,
    doors: dict[str, DoorState] = OPEN,
    people: tuple[Person, ...] = (),
) -> np.ndarray:
    """Return the frame from a pose as RGB (480, 640, 3) integers, which can be subtracted."""
    out = np.zeros((720, 640), dtype=np.uint8)
    camera.render(Pose2D(*pose), tilt, doors, people, out)
    return video_frame(Frame(out, 0.0, "yuv420p")).to_ndarray(format="rgb24").astype(int)


def pixel_of(pose: Triple, point: Triple, tilt: float = HOME) -> tuple[float, float]:
    """Project a world point with a rotation matrix and K, as a page that draws an overlay does;
    independent of lens.py.
    """
    model, (x, y, yaw) = GIRAFF.camera, pose
    focal, pitch = model.width / 2 / math.tan(model.hfov / 2), model.pitch + tilt
    centre = np.array([x + model.x * math.cos(yaw), y + model.x * math.sin(yaw), model.z])
    forward = np.array(
        [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)]
    )
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    down = np.cross(forward, right)
    seen = np.array([right, down, forward]) @ (np.array(point) - centre)
    return model.width / 2 + focal * seen[0] / seen[2], model.height / 2 + focal * seen[1] / seen[2]
