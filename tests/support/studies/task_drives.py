"""Drives through the cabin of tests/support/studies/studies.py, as the records that a robot at 4 Hz
and a page would give.
"""

import math
from dataclasses import replace

from experiments.definition.course import CourseTrack, lay_out
from experiments.tasks.engine import TaskEngine
from experiments.tasks.records import FirstFrame, Record, Seen
from robots.api.docked import DOCKED
from tests.support.studies.studies import cabin, small_study

RATE = 4.0
HOME = (0.5, 2.0)
FIRST = (3.0, 1.0)
SECOND = (7.0, 2.0)
BY_DOOR = ((3.4, 0.9), (5.0, 0.9))
BY_ARCHWAY = ((3.4, 3.1), (5.0, 3.1))
THERE = (FIRST, *BY_DOOR, SECOND)
BACK = (*BY_ARCHWAY[::-1], (1.5, 2.0), HOME)
START = 1000.0


def track(condition: str = "all_open", **changes: object) -> CourseTrack:
    """The cabin's course under a condition; fields of the track replaced."""
    study = small_study()
    return replace(lay_out(study, study.condition(condition), cabin()), **changes)


class Drive:
    """Writes the record of a drive: `go` along points at `speed` m/s, `touch` the station's
    contacts, `dock`.
    """

    def __init__(self, at: float = START, *, frame: bool = True) -> None:
        self.at, self.seq, self.speed = at, 0, 0.5
        self.x, self.y = HOME
        self.theta = math.pi
        self.records: list[Record] = []
        self.see(docked=True)
        if frame:
            self.say(FirstFrame(self.at, "frame"))

    def see(
        self, *, docked: bool = False, contact: bool | None = None, **more: bool | float
    ) -> "Drive":
        """A state where the robot is; docked robots have contact."""
        usual = {"localized": True, "linear": 0.0, "released": True}
        usual |= {"docked": docked, "contact": docked if contact is None else contact}
        pose = (self.x, self.y, self.theta)
        self.records.append(Seen(self.at, "boot", self.seq, *pose, **usual | more))
        self.seq += 1
        self.at += 1.0 / RATE
        return self

    def say(self, record: Record) -> "Drive":
        """An input."""
        self.records.append(record)
        return self

    def go(self, *points: tuple[float, float]) -> "Drive":
        """Drive straight from point to point."""
        for x, y in points:
            metres = math.dist((self.x, self.y), (x, y))
            count = max(1, math.ceil(metres / self.speed * RATE))
            from_x, from_y = self.x, self.y
            self.theta = math.atan2(y - from_y, x - from_x)
            for n in range(1, count + 1):
                share = n / count
                self.x, self.y = from_x + share * (x - from_x), from_y + share * (y - from_y)
                self.see(linear=self.speed, released=False)
        return self

    def turn(self, theta: float) -> "Drive":
        """Look elsewhere."""
        self.theta = theta
        return self.see()

    def touch(self, seconds: float, *, released: bool = True, linear: float = 0.0) -> "Drive":
        """Have contact for so long; a robot that rests says that it is docked when the rule of all
        robots says so.
        """
        self.x, self.y, self.theta = *HOME, math.pi
        began = self.at
        while self.at < began + seconds - 1e-9:
            rested = self.at - began >= DOCKED.seconds and released and abs(linear) <= DOCKED.linear
            self.see(docked=rested, contact=True, linear=linear, released=released)
        return self

    def dock(self) -> "Drive":
        """Rest in the station with the controls released, until the robot counts as docked."""
        return self.touch(DOCKED.seconds + 1.0 / RATE)


def whole_drive() -> Drive:
    """The whole task, without the photo."""
    return Drive().go(*THERE, *BACK).dock()


def run(
    records: list[Record], on: CourseTrack | None = None, until: float | None = None
) -> TaskEngine:
    """An engine that was fed with records."""
    engine = TaskEngine(on or track())
    for record in records:
        engine.feed(record)
    if until is not None:
        engine.advance(until)
    return engine


def milestones(engine: TaskEngine) -> list[tuple]:
    """The events but the cues, as (type, number or name)."""
    return [
        (event.type, event.name or event.number) for event in engine.events if event.type != "cue"
    ]


def cues(engine: TaskEngine) -> list[str]:
    """The cues in the order in which they were shown."""
    return [event.name for event in engine.events if event.type == "cue"]
