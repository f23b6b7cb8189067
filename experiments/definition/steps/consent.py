"""Informed consent."""

from collections.abc import Iterator, Sequence
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from experiments.definition.step import Step, Version
from surveys.documents import Text


class Consent(Step, frozen=True, kw_only=True, tag="consent"):
    """The participant agrees to `text`, or leaves. Who is younger than `minimum_age` is turned
    away, or needs a guardian's word.
    """

    may_repeat: ClassVar[bool] = False

    version: Version = 1
    text: Text
    minimum_age: Annotated[int, Meta(ge=0, le=99)] = 18
    minors: Literal["refused", "guardian"] = "refused"

    @classmethod
    def problems_among(cls, steps: Sequence[Step]) -> Iterator[str]:
        """Yield that there are several, or that something comes before it."""
        count = sum(isinstance(step, cls) for step in steps)
        if count > 1:
            yield f"There are {count} consent steps; one is enough."
        if count and not isinstance(steps[0], cls):
            yield "The consent is not the first step."
