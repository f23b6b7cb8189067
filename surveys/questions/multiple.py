"""Any of several options, within a count."""

import datetime
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

from django.utils.translation import gettext as _
from django.utils.translation import gettext_lazy

from surveys.documents import Problem, gettext_noop
from surveys.item import OptionsItem, Question, RefusedError, Scales, one_of


class Multiple(OptionsItem, frozen=True, kw_only=True, tag="multiple"):
    """Any of several options, stored as a list of values in written order."""

    plain_name: ClassVar[Any] = gettext_lazy("Multiple choice")
    takes_several: ClassVar[bool] = True

    at_least: int = 0
    at_most: int | None = None

    def problems(self, scales: Scales) -> Iterator[Problem]:
        """Yield what is wrong with the options, or with how many of them may be chosen."""
        yield from super().problems(scales)
        most = len(self.options) if self.at_most is None else self.at_most
        if not 0 <= self.at_least <= most or not 1 <= most <= len(self.options):
            words = gettext_noop("There are too few options for these limits.")
            yield Problem(words, names=(("at_least, at_most",),))

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> list[str]:
        """Return the values that were chosen, in written order."""
        for value in values:
            one_of({option.value: value for option in self.options}, value)
        chosen = [option for option in self.options if option.value in values]
        if len(chosen) > 1 and any(option.alone for option in chosen):
            raise RefusedError(
                _("One of your choices excludes the others. Choose it alone, or remove it.")
            )
        if len(chosen) < self.at_least and not any(option.alone for option in chosen):
            raise RefusedError(_("Choose at least %(n)d.") % {"n": self.at_least})
        if self.at_most is not None and len(chosen) > self.at_most:
            raise RefusedError(_("Choose at most %(n)d.") % {"n": self.at_most})
        return [option.value for option in chosen]

    def cell(self, value: Any) -> str:
        """Return the values with bars between them."""
        return "|".join(value)

    def sent(self, value: Any) -> list[str]:
        """Return the values, each sent by itself."""
        return list(value)
