"""Pages to be read before driving."""

from collections.abc import Iterator
from typing import Annotated

from msgspec import Meta

from experiments.definition.step import Step
from robots.api.floorplan import Key as PlanKey
from surveys.documents import DocumentPart, Key, Problem, Text, gettext_noop as _

OWN_MEDIA = "own-"  # how names of uploaded pictures and videos begin


class InstructionPage(DocumentPart, frozen=True, kw_only=True):
    """A page; `picture` is the name of a built-in or an uploaded picture or video. Only drivers
    of a `robot` and participants in `conditions` see it; empty: all.
    """

    text: Text
    picture: Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")] | None = None
    robot: tuple[PlanKey, ...] = ()
    conditions: tuple[Key, ...] = ()


class Instructions(Step, frozen=True, kw_only=True, tag="instructions"):
    """A participant is assigned on reaching a step with pages for some conditions."""

    leaves: tuple[InstructionPage, ...]

    @property
    def named_conditions(self) -> frozenset[str]:
        return frozenset(key for page in self.leaves for key in page.conditions)

    def own_pages(self, condition: str) -> tuple[int, ...]:
        numbered = enumerate(self.leaves, start=1)
        return tuple(number for number, page in numbered if condition in page.conditions)

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        if not self.leaves:
            yield Problem(_("there is no page to read; add at least one."))
