"""The end of taking part."""

from collections.abc import Iterator, Sequence
from typing import ClassVar

from experiments.definition.step import Step
from surveys.documents import Problem, Text, gettext_noop as _


class Debrief(Step, frozen=True, kw_only=True, tag="debrief"):
    """Thanks, and what the study was about; `operator` tells of a hidden operator who drove."""

    may_repeat: ClassVar[bool] = False
    is_end: ClassVar[bool] = True

    text: Text
    operator: Text = {}

    @property
    def end_text(self) -> Text:
        return self.text

    @classmethod
    def problems_among(cls, steps: Sequence[Step]) -> Iterator[Problem]:
        if any(isinstance(step, cls) for step in steps[:-1]):
            yield Problem(_("The debriefing must be the last step."))
