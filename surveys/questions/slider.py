"""A whole number between two named ends."""

import datetime
from collections.abc import Collection, Iterator, Sequence
from typing import Annotated, Any, ClassVar

import msgspec
from django.utils.translation import gettext as _
from django.utils.translation import gettext_lazy

from surveys.documents import Problem, Text, gettext_noop, spoken
from surveys.item import (
    Item,
    Question,
    RefusedError,
    Row,
    ScalePoint,
    Scales,
    ScoringRule,
    Viewing,
    Whole,
    Widget,
    first_choice,
    parsed_number,
)


class Slider(Item, frozen=True, kw_only=True, tag="slider"):
    """A whole number between two named ends; 0 to 100 unless it says otherwise. `reverse`: scores
    count it from the other end.
    """

    plain_name: ClassVar[Any] = gettext_lazy("Slider")
    is_number: ClassVar[bool] = True
    scored_by: ClassVar[Collection[ScoringRule]] = frozenset({"tlx_raw", "topics"})

    minimum: Whole = 0
    maximum: Whole = 100
    step: Annotated[int, msgspec.Meta(ge=1)] = 1
    low: Text
    high: Text
    reverse: bool = False

    def is_reversed(self, row: Row | None) -> bool:
        """Tell what its definition says."""
        return self.reverse

    def own_texts(self) -> Iterator[Text]:
        """Yield the names of the ends."""
        yield self.low
        yield self.high

    def problems(self, scales: Scales) -> Iterator[Problem]:
        """Yield that its ends do not fit its step."""
        if self.minimum >= self.maximum or (self.maximum - self.minimum) % self.step:
            yield Problem(
                gettext_noop("The maximum must be above the minimum by a multiple of the step.")
            )

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> int:
        """Return the number."""
        number = parsed_number(values[0])
        if (
            number != int(number)
            or not self.minimum <= number <= self.maximum
            or (number - self.minimum) % self.step
        ):
            words = {"least": self.minimum, "greatest": self.maximum, "step": self.step}
            raise RefusedError(
                _("Enter a number from %(least)d to %(greatest)d in steps of %(step)d.") % words
            )
        return int(number)

    def score_values(self, points: Sequence[ScalePoint]) -> Sequence[int]:
        """Return the numbers between its ends."""
        return range(self.minimum, self.maximum + 1, self.step)

    def ends(self, points: Sequence[ScalePoint]) -> tuple[Text, Text]:
        """Return the names of its ends."""
        return self.low, self.high

    def widget(self, question: Question, chosen: Sequence[str], viewing: Viewing) -> Widget:
        """Return an input for a number between its ends; a script puts a slider beside it
        (static/js/pages/survey/slider.js).
        """
        return Widget(
            "surveys/_slider.html",
            self.kind,
            value=first_choice(chosen),
            attributes={
                "min": str(self.minimum),
                "max": str(self.maximum),
                "step": str(self.step),
                "inputmode": "numeric",
            },
            more={
                "low": spoken(self.low, viewing.language),
                "high": spoken(self.high, viewing.language),
            },
            has_one_input=True,
        )
