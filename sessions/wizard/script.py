"""The script of a hidden operator, and its progress: pure.

An app above this one makes it from a study. Every step is one button: a text for the robot to say,
an action of the Robot API, or a velocity for some seconds, which the page sends.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from msgspec import Meta

from robots.api.messages import (
    Action,
    AngularSpeed,
    Dock,
    Goto,
    Id,
    LinearSpeed,
    Message,
    Name,
    Say,
    Seconds,
    Tilt,
    Undock,
)

Deviation = Literal["", "out_of_order", "repeated", "late"]


class TimedDrive(Message, frozen=True, kw_only=True):
    """A velocity for `seconds`."""

    linear: LinearSpeed = 0.0
    angular: AngularSpeed = 0.0
    seconds: Seconds


class ScriptStep(Message, frozen=True, kw_only=True):
    """One button. `turn` is an angle in radians to turn by, counter-clockwise."""

    key: Id
    title: Name
    shortcut: Name = ""
    text: Annotated[str, Meta(max_length=500)] = ""
    aloud: bool = True
    action: Literal["", "goto", "dock", "undock", "tilt"] = ""
    place: Name = ""
    angle: float = 0.0
    drive: TimedDrive | None = None
    turn: float | None = None
    within: Seconds | None = None

    @property
    def sends_velocities(self) -> bool:
        """Whether the operator's page performs it by sending velocities."""
        return self.drive is not None or self.turn is not None


class ScriptStage(Message, frozen=True, kw_only=True):
    """Buttons under a title."""

    key: Id
    title: Name
    steps: tuple[ScriptStep, ...] = ()


class Script(Message, frozen=True, kw_only=True):
    """All buttons of an operator in one session. `language` is that of the texts."""

    language: Name
    stages: tuple[ScriptStage, ...] = ()
    is_ordered: bool = True
    by_hand: bool = True
    participant_view: bool = False

    @property
    def steps(self) -> tuple[ScriptStep, ...]:
        """All steps in their order."""
        return tuple(step for stage in self.stages for step in stage.steps)


def action_of(step: ScriptStep, language: str, *, action_id: str, stamp: float) -> Action | None:
    """Return the action of a step; None for one that the page drives."""
    if step.text:
        return Say(
            action_id=action_id, stamp=stamp, text=step.text, language=language, aloud=step.aloud
        )
    match step.action:
        case "goto":
            return Goto(action_id=action_id, stamp=stamp, place=step.place)
        case "dock":
            return Dock(action_id=action_id, stamp=stamp)
        case "undock":
            return Undock(action_id=action_id, stamp=stamp)
        case "tilt":
            return Tilt(action_id=action_id, stamp=stamp, angle=step.angle)
    return None


@dataclass(frozen=True)
class Press:
    """A step that was begun, its deviation from the script, and how many steps it skipped."""

    step: ScriptStep
    deviation: Deviation
    skipped: int


@dataclass
class ScriptProgress:
    """The progress of a script. `began_at` and `now` are in seconds of the same clock."""

    script: Script
    began_at: float
    done: list[str] = field(default_factory=list)
    pressed_at: float | None = None

    def press(self, key: str, now: float) -> Press | None:
        """Take a step that the operator has begun; None when the script has none of that key."""
        press = self.judge(key, now)
        if press is not None:
            self.done.append(key)
            self.pressed_at = now
        return press

    def judge(self, key: str, now: float) -> Press | None:
        """Return the Press that beginning a step now would be; None when the script has none of
        that key.

        A step counts as skipped when the next one of the script is begun before it; if it is begun
        later, it is out of order.
        """
        steps = self.script.steps
        index = next((i for i, step in enumerate(steps) if step.key == key), None)
        if index is None:
            return None
        return Press(steps[index], *self._deviation(index, now))

    def _deviation(self, index: int, now: float) -> tuple[Deviation, int]:
        steps, step = self.script.steps, self.script.steps[index]
        skipped, repeated = 0, step.key in self.done
        if self.script.is_ordered:
            if repeated:
                return "repeated", 0
            if any(later.key in self.done for later in steps[index + 1 :]):
                return "out_of_order", 0
            skipped = self._passed_over(index)
        since = self.began_at if self.pressed_at is None else self.pressed_at
        late = step.within is not None and now - since > step.within
        return ("out_of_order" if skipped else "late" if late else ""), skipped

    def _passed_over(self, index: int) -> int:
        """Return how many steps just before one were not done, back to the last that was."""
        count = 0
        for step in reversed(self.script.steps[:index]):
            if step.key in self.done:
                break
            count += 1
        return count
