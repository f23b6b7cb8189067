"""A VideoSource that sees the scene of a simulation in the same process, some pictures a second."""

import time

import numpy as np

from robots.agent.robot_interface import Frame
from robots.api.floorplan import FloorPlan
from robots.simulator.physics.simulation import Simulation
from robots.simulator.render.camera import SceneCamera


class SceneSource:
    """Draws what the robot of `simulation` sees; set it before the first `read`."""

    def __init__(self, plan: FloorPlan, fps: float = 10.0) -> None:
        self.plan, self.period = plan, 1 / fps
        self.simulation: Simulation | None = None
        self._camera: SceneCamera | None = None
        self._due = 0.0

    def start(self) -> None:
        self._due = time.monotonic()

    def stop(self) -> None:
        """Nothing to release."""

    def read(self, timeout: float) -> Frame | None:
        assert self.simulation is not None
        self._due = max(self._due + self.period, time.monotonic() - self.period)
        time.sleep(max(0.0, self._due - time.monotonic()))
        sim = self.simulation
        self._camera = self._camera or SceneCamera(sim.model, self.plan, seed=1)
        image = np.zeros((sim.model.camera.height * 3 // 2, sim.model.camera.width), dtype=np.uint8)
        stamp = time.time()
        self._camera.render(sim.pose, sim.tilt, sim.openings, sim.people, image)
        return Frame(image=image, stamp=stamp, format="yuv420p")
