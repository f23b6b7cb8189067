"""The base classes of study steps. A kind is one file in experiments/definition/steps/ and one of
the same name, with its page, in experiments/participation/steps/; both are found by name.
"""

from collections.abc import Iterator, Sequence
from typing import Annotated, ClassVar

from msgspec import Meta

from experiments.definition.design import TitledPart
from surveys.documents import Problem, Slug, Text, gettext_noop as _

Version = Annotated[int, Meta(ge=1, le=9999)]
Minutes = Annotated[float, Meta(gt=0.0, le=600.0)]


class Step(TitledPart, frozen=True, kw_only=True, tag_field="kind"):
    """A step. With `repeat` it is done once for each condition of a participant, else once."""

    may_repeat: ClassVar[bool] = True
    # Done on one visit, it is skipped on later ones (StepPage.is_done_for_good).
    is_for_good: ClassVar[bool] = False
    # A participant who reaches it is done.
    is_end: ClassVar[bool] = False

    repeat: bool = False

    @property
    def kind(self) -> str:
        return str(self.__struct_config__.tag)

    @property
    def end_text(self) -> Text:
        """The text on the last page; empty for other steps."""
        return {}

    @property
    def named_conditions(self) -> frozenset[str]:
        """The conditions that have pages of their own in it."""
        return frozenset()

    def own_pages(self, _condition: str) -> tuple[int, ...]:
        """Return the numbers, from 1, of the pages that only some conditions have, this one too."""
        return ()

    def problems(self) -> Iterator[Problem]:
        """Yield problems beside those of types and texts."""
        if self.repeat and not self.may_repeat:
            yield Problem(_("a step of this kind cannot be repeated."))

    @classmethod
    def problems_among(cls, _steps: Sequence["Step"]) -> Iterator[Problem]:
        """Yield problems of the number and order of the steps of this kind."""
        yield from ()


class AskingStep(Step, frozen=True, kw_only=True):
    # Asked once; other questionnaires are asked once in each visit and round.
    is_about_person: ClassVar[bool] = False

    questionnaire: Slug
    version: Version = 1


class DriveStep(Step, frozen=True, kw_only=True):
    """A step in which the participant drives the condition's robot, for `minutes` at most."""

    # A free drive: without measurements and outcome.
    is_practice: ClassVar[bool] = False

    minutes: Minutes
