"""Any of several options, within a count, stored as a list of values in written order."""

import datetime
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

from django.utils.translation import gettext as _, gettext_lazy

from surveys.documents import Problem, gettext_noop
from surveys.item import OptionsItem, Question, RefusedError, Scales, one_of


class Multiple(OptionsItem, frozen=True, kw_only=True, tag="multiple"):
    plain_name: ClassVar[Any] = gettext_lazy("Multiple choice")
    labels: ClassVar[Mapping[str, Any]] = {
        "at_least": gettext_lazy("Choices at least"),
        "at_most": gettext_lazy("Choices at most"),
    }
    takes_several: ClassVar[bool] = True

    at_least: int = 0
    at_most: int | None = None

    def problems(self, scales: Scales) -> Iterator[Problem]:
        yield from super().problems(scales)
        most = len(self.options) if self.at_most is None else self.at_most
        if not 0 <= self.at_least <= most or not 1 <= most <= len(self.options):
            words = gettext_noop("There are too few options for these limits.")
            yield Problem(words, names=(("at_least, at_most",),))

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> list[str]:
        known = {option.value: option for option in self.options}
        ticked = {one_of(known, value).value for value in values}
        chosen = [option for option in self.options if option.value in ticked]
        is_alone = any(option.alone for option in chosen)
        if len(chosen) > 1 and is_alone:
            words = _("One of your choices excludes the others. Choose it alone, or remove it.")
            raise RefusedError(words)
        if len(chosen) < self.at_least and not is_alone:
            raise RefusedError(_("Choose at least %(n)d.") % {"n": self.at_least})
        if self.at_most is not None and len(chosen) > self.at_most:
            raise RefusedError(_("Choose at most %(n)d.") % {"n": self.at_most})
        return [option.value for option in chosen]
