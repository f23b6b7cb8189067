"""Pages to be read before driving."""

from collections.abc import Iterator
from typing import Annotated

from msgspec import Meta

from experiments.definition.step import Step
from robots.api.floorplan import Key as PlanKey
from surveys.documents import DocumentPart, Key, Problem, Text
from surveys.documents import gettext_noop as _

OWN_MEDIA = "own-"  # how names of uploaded pictures and videos begin


class InstructionPage(DocumentPart, frozen=True, kw_only=True):
    """One page of the instructions; `picture` is the name of a picture of the site's own, or
    of an uploaded picture or video. `robot` and `conditions` say for whom it is; none is everybody.
    """

    text: Text
    picture: Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")] | None = None
    robot: tuple[PlanKey, ...] = ()
    conditions: tuple[Key, ...] = ()


class Instructions(Step, frozen=True, kw_only=True, tag="instructions"):
    """What is read before driving. A page that names robots is shown to those who will drive one of
    them; whoever comes to a step with a page for some conditions is assigned to theirs then.
    """

    leaves: tuple[InstructionPage, ...]

    @property
    def named_conditions(self) -> frozenset[str]:
        """The conditions that have pages of their own."""
        return frozenset(key for page in self.leaves for key in page.conditions)

    def own_pages(self, condition: str) -> tuple[int, ...]:
        """Return the numbers, from 1, of the pages that only some conditions have, this among
        them.
        """
        numbered = enumerate(self.leaves, start=1)
        return tuple(number for number, page in numbered if condition in page.conditions)

    def problems(self) -> Iterator[Problem]:
        """Yield that it has no pages."""
        yield from super().problems()
        if not self.leaves:
            yield Problem(_("there is no page to read; add at least one."))
