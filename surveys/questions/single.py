"""One of several options, stored as its value."""

import datetime
from collections.abc import Sequence
from typing import Any, ClassVar

from django.utils.translation import gettext_lazy

from surveys.item import OptionsItem, Question, one_of


class Single(OptionsItem, frozen=True, kw_only=True, tag="single"):
    plain_name: ClassVar[Any] = gettext_lazy("Single choice")
    has_reason_choices: ClassVar[bool] = True

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> str:
        return one_of({option.value: option.value for option in self.options}, values[0])
