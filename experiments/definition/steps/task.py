"""The drive that a study measures."""

from collections.abc import Iterator, Sequence
from typing import Annotated

from msgspec import Meta

from experiments.definition.step import DriveStep, Minutes, Step
from robots.api.docked import DOCKED
from surveys.documents import Problem, gettext_noop as _


class TaskStep(DriveStep, frozen=True, kw_only=True, tag="task"):
    """The course of the condition's robot, within `minutes` from the first video frame;
    the page shows the time left in the `last_minutes`. Docking counts after `docked_seconds` at
    rest on the charging contacts with released controls (robots/api/docked.py).
    """

    minutes: Minutes = 15.0
    last_minutes: Annotated[float, Meta(ge=0.0, le=60.0)] = 2.0
    docked_seconds: Annotated[float, Meta(ge=1.0, le=60.0)] = DOCKED.seconds

    @classmethod
    def problems_among(cls, steps: Sequence[Step]) -> Iterator[Problem]:
        count = sum(isinstance(step, cls) for step in steps)
        if count != 1:
            words = _(
                "There are %(n)d task steps; a study needs exactly one, which is repeated for each "
                "condition."
            )
            yield Problem(words, {"n": count})
