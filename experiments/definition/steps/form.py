"""Questions about the person."""

from typing import ClassVar

from experiments.definition.step import AskingStep


class FormStep(AskingStep, frozen=True, kw_only=True, tag="form"):
    """A questionnaire about the person; who has answered it on an earlier visit skips it."""

    may_repeat: ClassVar[bool] = False
    is_for_good: ClassVar[bool] = True
    is_about_person: ClassVar[bool] = True
