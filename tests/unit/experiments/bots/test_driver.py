"""Bots drive whole courses in a simulated building and against the task engine, with no servers."""

import dataclasses

import pytest

from experiments.bots.driver import Driver, Guide, SpeedSetting
from experiments.bots.view import View
from experiments.definition.course import lay_out
from experiments.definition.shipped import shipped
from experiments.tasks.engine import TaskEngine
from experiments.tasks.records import FirstFrame, PhotoAnswer, PhotoTaken, Seen
from robots.api.docked import DOCKED, DockReading, DockState, follow
from robots.api.geometry import Pose2D
from robots.api.messages import Scan
from robots.simulator.physics.drive import STILL
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import model_of
from robots.world.sites import load_site
from sessions.protocol import Task

STUDY = shipped()["exploration"]
DT, THINK, STATE, LOOK = 0.05, 2, 5, 10  # s a step; steps between decisions, states and sweeps


class Rig:
    """A bot on a course. The true pose replaces the robot's own localization."""

    def __init__(self, condition, *, skips=False, early=False):
        self.plan = load_site(condition.site).plan
        self.model = model_of(condition.robot)
        self.sim = Simulation(self.model, self.plan, seed=1)
        self.sim.set_doors(dict.fromkeys(condition.doors_closed, "closed"))
        self.engine = TaskEngine(lay_out(STUDY, condition, self.plan))
        track = self.engine.track
        stops = {stop.number: (stop.x, stop.y) for stop in track.stops}
        photo = track.photo.stop.number if track.photo is not None else None
        guide = Guide(track.dock, stops, photo)
        fastest = SpeedSetting(0.9 * self.model.limits.linear, 0.9 * self.model.limits.angular)
        self.driver = Driver(self.plan, guide, fastest, skips_photo=skips, docks_early=early)
        self.view = View(localized=True, laser=Pose2D(self.model.laser.x, 0.0, 0.0))
        self.now, self.steps, self.photos, self.answers = 0.0, 0, 0, []
        self.dock = DockState()
        self.engine.feed(FirstFrame(0.0, "first"))

    def run(self, seconds):
        while self.now < seconds and self.engine.progress.outcome is None:
            self.step()
        return self.engine.result

    def step(self):
        if self.steps % STATE == 0:
            self.feed_state()
        if self.steps % LOOK == 0:
            self.look()
        if self.steps % THINK == 0:
            self.think()
        self.sim.step(DT)
        self.now, self.steps = self.now + DT, self.steps + 1

    def feed_state(self):
        pose, motion, contact = self.sim.pose, self.sim.motion, self.sim.docked
        released = self.sim.commanded == STILL
        rest = {"contact": contact, "linear": motion.linear, "released": released}
        self.dock = follow(DOCKED, self.dock, DockReading(at=self.now, **rest))
        place = (pose.x, pose.y, pose.theta)
        more = {"docked": self.dock.docked, "angular": motion.angular}
        self.engine.feed(Seen(self.now, "boot", self.steps, *place, **more, **rest))

    def look(self):
        laser = self.model.laser
        ranges = tuple(float(r) if r < laser.range_max else None for r in self.sim.scan())
        self.view.scan_pose = self.sim.pose
        self.view.scan = Scan(
            stamp=self.now,
            angle_min=laser.angle_min,
            angle_increment=laser.angle_increment,
            range_max=laser.range_max,
            ranges=ranges,
        )

    def think(self):
        cue = self.engine.progress.cue
        x, y = cue.target or (None, None)
        self.view.task = Task(session="s", stamp=self.now, cue=cue.key, number=cue.number, x=x, y=y)
        self.view.pose = self.sim.pose
        self.view.docked, self.view.contact = self.dock.docked, self.sim.docked
        intent = self.driver.decide(self.view, self.now)
        self.sim.command(intent.speed.linear, intent.speed.angular)
        if intent.take:
            self.photos += 1
            self.engine.feed(PhotoTaken(self.now, f"photo{self.photos}"))
        if intent.answer and not self.answers:
            self.answers.append(intent.answer)
            self.engine.feed(PhotoAnswer(self.now, "answer", intent.answer))


@pytest.mark.slow
@pytest.mark.parametrize("key", [condition.key for condition in STUDY.conditions])
def test_bot_completes_each_condition_of_the_papers_study_without_a_collision(key):
    condition = STUDY.condition(key)
    rig = Rig(condition)
    result = rig.run(600.0)
    stuck = (
        rig.now,
        rig.view.pose,
        rig.engine.progress.cue,
        rig.driver.closed,
        rig.driver.no_route,
    )
    assert result.outcome == "completed", stuck
    assert len(result.checkpoints) == 4
    assert not result.doors_missed
    assert rig.sim.contacts == 0
    assert rig.driver.closed <= set(condition.doors_closed)
    if rig.engine.track.photo is not None:
        assert result.photo == "kept"
        assert rig.photos == 1


def test_bot_skips_the_photo_and_docks():
    rig = Rig(STUDY.condition("giraff_open"), skips=True)
    result = rig.run(600.0)
    assert (result.outcome, result.photo, rig.photos) == ("completed", "skipped", 0)


def test_bot_that_docks_too_early_then_drives_the_course():
    rig = Rig(STUDY.condition("giraff_open"), early=True)
    result = rig.run(600.0)
    assert (result.outcome, len(result.checkpoints)) == ("completed", 4)
    assert "docked_early" in {event.type for event in rig.engine.events}


def test_bot_does_not_move_without_a_cue_or_a_localized_pose():
    rig = Rig(STUDY.condition("giraff_open"))
    rig.view.pose = rig.sim.pose
    leave = Task(session="s", stamp=0.0, cue="leave_station", number=1, x=2.0, y=1.0)
    wait = Task(session="s", stamp=0.0, cue="wait_for_picture")
    for changes in ({"localized": False, "task": leave}, {"task": wait}):
        view = dataclasses.replace(rig.view, **changes)
        assert rig.driver.decide(view, 0.0).speed.is_zero
