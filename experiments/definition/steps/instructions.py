"""Pages to be read before driving."""

from collections.abc import Iterator
from typing import Annotated

from msgspec import Meta

from experiments.definition.step import Step
from robots.api.floorplan import Key as PlanKey
from surveys.documents import DocumentPart, Text


class InstructionPage(DocumentPart, frozen=True, kw_only=True):
    """One page of the instructions; `picture` is the name of a picture of the site's own."""

    text: Text
    picture: Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")] | None = None
    robot: tuple[PlanKey, ...] = ()


class Instructions(Step, frozen=True, kw_only=True, tag="instructions"):
    """What is read before driving. A page that names robots is shown to those who will drive one of
    them.
    """

    leaves: tuple[InstructionPage, ...]

    def problems(self) -> Iterator[str]:
        """Yield that it has no pages."""
        yield from super().problems()
        if not self.leaves:
            yield "there is no page to read; add at least one."
