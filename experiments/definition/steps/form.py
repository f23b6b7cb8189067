"""Questions about the person."""

from typing import ClassVar

from experiments.definition.step import AskingStep


class FormStep(AskingStep, frozen=True, kw_only=True, tag="form"):
    """Asked once: participants who answered it on an earlier visit skip it."""

    may_repeat: ClassVar[bool] = False
    is_for_good: ClassVar[bool] = True
    is_about_person: ClassVar[bool] = True
