"""A simulated robot whose pose is always wrong by some centimetres."""

from dataclasses import dataclass, field

import numpy as np

from robots.api.geometry import Pose2D
from robots.simulator.physics.simulation import Simulation
from robots.world.render_plan import rasterise
from robots.world.robot_models import GIRAFF
from tests.support.agents.mapped_building import THICK, building
from tests.support.agents.navigation_rig import Rig, Wander


@dataclass
class Beside(Wander):
    """A pose that is wrong by the same few centimetres all the time."""

    rng: np.random.Generator = field(default_factory=np.random.default_rng)
    x: float = 0.0
    y: float = 0.0

    def of(self, truth, dt):
        return Pose2D(truth.x + self.x, truth.y + self.y, truth.theta)


def rig(start, wrong):
    plan = building()
    made = Rig(Simulation(GIRAFF, plan, seed=1, start=start), rasterise(plan), 1)
    made.wander = wrong
    return made


def test_goal_is_reached_although_a_wall_blocks_the_last_centimetres():
    made = rig("3.0,1.0,1.57", Beside(y=-0.06))
    beside_wall = 2.0 - THICK / 2.0 - 0.32
    made.navigator.goto(3.0, beside_wall)
    done = made.run(60.0)
    assert (done.status, done.reason, made.sim.contacts) == ("FINISHED", "", 0)
    assert abs(made.sim.pose.y - beside_wall) < 0.1
