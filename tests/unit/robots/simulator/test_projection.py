"""The golden file of pixels with the points of the floor that they show, and of drives with their
ends. tests/js/view/overlay.test.js compares the drive page's projection and prediction with it.
"""

import json
import math

import numpy as np

from robots.api.geometry import Pose2D
from robots.simulator.physics.drive import WheelMotion, advance, follow, slip
from robots.simulator.render.lens import grind
from robots.world.robot_models import RobotModel, model_of
from tests.support.paths import GOLDEN

PROJECTION = GOLDEN / "projection.json"
SEED = 20
CASES = 300  # of each robot
FARTHEST = 12.0  # m
DRIVES = 40
SECONDS, TICK = 2.5, 0.02
CAMERA = ("width", "height", "hfov", "x", "z", "pitch")
LIMITS = ("linear", "reverse", "angular")
LIMITS += tuple(
    f"{kind}_{by}" for by in ("acceleration", "braking") for kind in ("linear", "angular")
)


def cases(model: RobotModel, rng: np.random.Generator) -> list[dict]:
    """Return poses, tilts, pixels, and the points of the floor that the simulator draws there, by
    the tables that it draws with.
    """
    found: list[dict] = []
    while len(found) < CASES:
        tilt = 0.0
        if model.tilt:
            tilt = round(float(rng.uniform(model.tilt.minimum, model.tilt.maximum)), 4)
        place = rng.uniform((-5.0, -5.0, -math.pi), (20.0, 10.0, math.pi))
        pose = Pose2D(*(round(float(value), 4) for value in place))
        lens = grind(model.camera, model.camera.pitch + tilt)
        for _ in range(10):
            column, row = int(rng.integers(0, lens.width)), int(rng.integers(0, lens.height))
            distance = model.camera.z / -float(lens.up[row]) if lens.up[row] < 0.0 else math.inf
            forward, left = distance * float(lens.ahead[row]), -distance * float(lens.right[column])
            if math.hypot(forward, left) < FARTHEST:
                x, y, _ = pose.compose(Pose2D(model.camera.x + forward, left, 0.0))
                pixel, floor = [column + 0.5, row + 0.5], [round(x, 5), round(y, 5)]
                found.append({"pose": list(pose), "tilt": tilt, "pixel": pixel, "floor": floor})
    return found[:CASES]


def drives(model: RobotModel, rng: np.random.Generator) -> list[dict]:
    """Return initial and commanded speeds, and the end of the drive from the origin, with slip."""
    found = []
    for _ in range(DRIVES):
        limits = model.limits
        low, high = (-limits.reverse, -limits.angular), (limits.linear, limits.angular)
        begin, command = (
            [round(float(speed), 3) for speed in rng.uniform(low, high)] for _ in range(2)
        )
        motion, pose = WheelMotion(*begin), Pose2D(0.0, 0.0, 0.0)
        for _ in range(round(SECONDS / TICK)):
            motion = follow(motion, WheelMotion(*command), limits, TICK)
            real = slip(motion, model.wheel_separation, model.wheel_noise, TICK, rng)
            pose = advance(pose, real, TICK)
        found.append({"begin": begin, "told": command, "end": [round(pose.x, 4), round(pose.y, 4)]})
    return found


def golden() -> dict:
    rng = np.random.default_rng(SEED)
    models = [model_of("giraff"), model_of("rhodon")]
    return {
        model.series: {
            "camera": {name: getattr(model.camera, name) for name in CAMERA},
            "footprint": [list(point) for point in model.footprint],
            "limits": {name: getattr(model.limits, name) for name in LIMITS},
            "cases": cases(model, rng),
            "drives": drives(model, rng),
        }
        for model in models
    }


def test_the_golden_file_has_the_floor_of_the_simulators_camera():
    assert json.loads(PROJECTION.read_text()) == json.loads(json.dumps(golden()))


if __name__ == "__main__":
    PROJECTION.write_text(json.dumps(golden(), indent=None, separators=(",", ":")) + "\n")
