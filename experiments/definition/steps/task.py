"""The drive that a study measures."""

from collections.abc import Iterator, Sequence
from typing import Annotated

from msgspec import Meta

from experiments.definition.step import DriveStep, Minutes, Step
from robots.api.docked import DOCKED
from surveys.documents import Problem
from surveys.documents import gettext_noop as _


class TaskStep(DriveStep, frozen=True, kw_only=True, tag="task"):
    """The course of the condition's robot, within a time limit from the first picture shown; what
    is left is shown in the last minutes.

    `docked_seconds` is for how long the robot must rest on its charging contacts, released, for its
    docking to count: robots/api/docked.py.
    """

    minutes: Minutes = 15.0
    last_minutes: Annotated[float, Meta(ge=0.0, le=60.0)] = 2.0
    docked_seconds: Annotated[float, Meta(ge=1.0, le=60.0)] = DOCKED.seconds

    @classmethod
    def problems_among(cls, steps: Sequence[Step]) -> Iterator[Problem]:
        """Yield that there is not one."""
        count = sum(isinstance(step, cls) for step in steps)
        if count != 1:
            words = _(
                "There are %(n)d task steps; a study needs exactly one, which is repeated for each "
                "condition."
            )
            yield Problem(words, {"n": count})
