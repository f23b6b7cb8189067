"""What every kind of study step is made of. A kind is one file in experiments/definition/steps/,
with one subclass of `Step`, and one of the same name in experiments/participation/steps/, with its
page; both are found by name.

What a step is for is told by what it is asked here, never by its class.
"""

from collections.abc import Iterator, Sequence
from typing import Annotated, ClassVar

from msgspec import Meta

from surveys.documents import DocumentPart, Key, Problem, Slug, Text
from surveys.documents import gettext_noop as _

Version = Annotated[int, Meta(ge=1, le=9999)]
Minutes = Annotated[float, Meta(gt=0.0, le=600.0)]


class Step(DocumentPart, frozen=True, kw_only=True, tag_field="kind"):
    """What every step says. With `repeat` it is gone through once for each condition of a
    participant, else once.
    """

    may_repeat: ClassVar[bool] = True
    # Done on one visit, it is skipped on later ones (StepPage.is_done_for_good).
    is_for_good: ClassVar[bool] = False
    # Whoever arrives at it has taken part to the end.
    is_end: ClassVar[bool] = False

    key: Key
    title: Text
    repeat: bool = False

    @property
    def kind(self) -> str:
        """The name of its kind in a definition."""
        return str(self.__struct_config__.tag)

    @property
    def end_text(self) -> Text:
        """What is said at the end; nothing by a step that is none."""
        return {}

    @property
    def named_conditions(self) -> frozenset[str]:
        """The conditions for which it has something of their own; none for most."""
        return frozenset()

    def own_pages(self, _condition: str) -> tuple[int, ...]:
        """Return the numbers, from 1, of its pages that only some conditions have, this among
        them.
        """
        return ()

    def problems(self) -> Iterator[Problem]:
        """Yield what is wrong with it, beside what types and texts tell."""
        if self.repeat and not self.may_repeat:
            yield Problem(_("a step of this kind cannot be repeated."))

    @classmethod
    def problems_among(cls, _steps: Sequence["Step"]) -> Iterator[Problem]:
        """Yield what is wrong with how many of its kind there are, and where they stand."""
        yield from ()


class AskingStep(Step, frozen=True, kw_only=True):
    """A step that asks a questionnaire."""

    # Who has answered it on an earlier visit skips it; else it is asked once a visit and round.
    is_about_person: ClassVar[bool] = False

    questionnaire: Slug
    version: Version = 1


class DriveStep(Step, frozen=True, kw_only=True):
    """A step in which the condition's robot is driven for so many minutes at most."""

    # A free drive: nothing is measured in it, and it ends without an outcome of its own.
    is_practice: ClassVar[bool] = False

    minutes: Minutes
