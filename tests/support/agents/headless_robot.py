"""A simulated robot with its own autonomy, without process and clock."""

import math

import numpy as np

from robots.agent.autonomy.area import Area, area_of, update_of
from robots.agent.autonomy.sensor_snapshot import Body, SensorSnapshot
from robots.api.messages import Velocity
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import model_of
from robots.world.sites import load_site
from tests.support.agents.headless import Headless

DT = 0.02
ENDED = {"FINISHED", "FAILED", "CANCELLED"}


def office() -> Area:
    return area_of(update_of(load_site("office")))


class HeadlessRobot:
    """`sim` is the truth, `autonomy` drives; `placed` gives it its pose at the start."""

    def __init__(self, series="giraff", *, start="dock", seed=1, area=None, placed=True, people=0):
        self.area = area or office()
        model = model_of(series)
        self.sim = Simulation(
            model, load_site("office").plan, seed=seed, start=start, people=people
        )
        self.autonomy = Headless(
            Body(series, model.footprint, model.limits), self.area, np.random.default_rng(seed)
        )
        if placed:
            self.autonomy.place(self.sim.pose)
        self.look_at = 0.0
        self.beams = None
        self.fastest = 0.0

    def step(self, driver=None, level="off"):
        """One tick; a `driver`'s velocity passes the assistance and replaces an action's."""
        if self.sim.time + 1e-9 >= self.look_at:
            self.look_at += 1.0 / self.sim.model.laser.rate
            self.beams = self.sim.beams() or self.beams
        motion = self.sim.motion
        velocity = Velocity(linear=motion.linear, angular=motion.angular)
        wanted = self.autonomy.step(
            SensorSnapshot(self.sim.time, self.sim.odometry, velocity, self.sim.docked, self.beams)
        )
        if driver is not None:
            wanted = self.autonomy.assist(driver, level)
        self.sim.command(wanted.linear, wanted.angular)
        self.sim.step(DT)
        return wanted

    def run(self, seconds, until=lambda: False):
        """Step until something holds or the time is over; tell whether it held."""
        for _ in range(round(seconds / DT)):
            self.step()
            if until():
                return True
        return False

    def do(self, action, seconds=180.0):
        """Begin an action and return its last news."""
        self.autonomy.begin(action)
        assert self.run(seconds, lambda: self.last(action.action_id) is not None), (
            f"{self.last_words(action.action_id)}"
        )
        return self.last(action.action_id)

    def last(self, action_id):
        return next(
            (
                n
                for n in reversed(self.autonomy.news)
                if n.action_id == action_id and n.status in ENDED
            ),
            None,
        )

    def last_words(self, action_id):
        return [n for n in self.autonomy.news if n.action_id == action_id][-3:]

    def error(self):
        """How far the believed pose is from the truth, metres."""
        return math.hypot(
            self.autonomy.pose.x - self.sim.pose.x, self.autonomy.pose.y - self.sim.pose.y
        )

    def stands(self):
        return abs(self.sim.motion.linear) < 1e-6 and abs(self.sim.motion.angular) < 1e-6
