"""A whole number between two labelled ends."""

import datetime
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar

import msgspec
from django.utils.translation import gettext as _, gettext_lazy

from surveys import item
from surveys.documents import Problem, Text, gettext_noop, spoken
from surveys.item import Item, Question, RefusedError, ScalePoint, Viewing, Whole, Widget


class Slider(Item, frozen=True, kw_only=True, tag="slider"):
    plain_name: ClassVar[Any] = gettext_lazy("Slider")
    labels: ClassVar[Mapping[str, Any]] = {
        "minimum": gettext_lazy("Minimum"),
        "maximum": gettext_lazy("Maximum"),
        "step": gettext_lazy("Step"),
        "low": gettext_lazy("Left end"),
        "high": gettext_lazy("Right end"),
    }
    is_number: ClassVar[bool] = True
    scored_by: ClassVar[Collection[item.ScoringRule]] = frozenset({"tlx_raw", "topics"})

    minimum: Whole = 0
    maximum: Whole = 100
    step: Annotated[int, msgspec.Meta(ge=1)] = 1
    low: Text
    high: Text
    reverse: bool = False  # scores count it from the other end

    def problems(self, scales: item.Scales) -> Iterator[Problem]:
        if self.minimum >= self.maximum or (self.maximum - self.minimum) % self.step:
            words = gettext_noop("The maximum must be above the minimum by a multiple of the step.")
            yield Problem(words)

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> int:
        number = item.parsed_number(values[0])
        if number not in self.score_values(()):
            bounds = {"least": self.minimum, "greatest": self.maximum, "step": self.step}
            words = _("Enter a number from %(least)d to %(greatest)d in steps of %(step)d.")
            raise RefusedError(words % bounds)
        return int(number)

    def score_values(self, points: Sequence[ScalePoint]) -> Sequence[int]:
        return range(self.minimum, self.maximum + 1, self.step)

    def ends(self, points: Sequence[ScalePoint]) -> tuple[Text, Text]:
        return self.low, self.high

    def widget(self, question: Question, chosen: Sequence[str], viewing: Viewing) -> Widget:
        """Return an input for a number, to which static/js/pages/survey/slider.js adds a slider."""
        low, high = (spoken(end, viewing.language) for end in (self.low, self.high))
        bounds = {"min": self.minimum, "max": self.maximum, "step": self.step}
        attributes = bounds | {"inputmode": "numeric"}
        return self.entry(chosen, attributes, "surveys/_slider.html", low=low, high=high)
