"""All options in an order, first to last, stored as the list of their values. The page sends a
place and an option at a time, "2.a", because without JavaScript each option has a list of places.
"""

import datetime
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

from django.utils.translation import gettext as _, gettext_lazy

from surveys import item
from surveys.documents import Problem, Text, gettext_noop, spoken
from surveys.item import Choice, OptionsItem, Question, RefusedError, Viewing, Widget

MIN_OPTIONS, MAX_OPTIONS = 2, 20


class Ranking(OptionsItem, frozen=True, kw_only=True, tag="ranking"):
    plain_name: ClassVar[Any] = gettext_lazy("Ranking")
    takes_several: ClassVar[bool] = True

    def problems(self, scales: item.Scales) -> Iterator[Problem]:
        yield from super().problems(scales)
        count = len(self.options)
        if self.options and not MIN_OPTIONS <= count <= MAX_OPTIONS:
            words = gettext_noop(
                "A ranking needs %(least)d to %(most)d options; this one has %(n)d."
            )
            yield Problem(words, {"least": MIN_OPTIONS, "most": MAX_OPTIONS, "n": count})
        if any(option.alone for option in self.options):
            words = gettext_noop("An option of a ranking can't exclude the others.")
            yield Problem(words, names=(("alone",),))

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> list[str]:
        places = range(1, len(self.options) + 1)
        pairs = ((place, option.value) for place in places for option in self.options)
        sendable = {f"{place}.{option}": (place, option) for place, option in pairs}
        given = {item.one_of(sendable, value) for value in values}
        ranked = dict(given)
        if len(ranked) < len(given) or len(set(ranked.values())) < len(given):
            raise RefusedError(_("Give each option a different place."))
        if len(ranked) < len(self.options):
            raise RefusedError(_("Give every option a place."))
        return [ranked[place] for place in sorted(ranked)]

    def sent(self, value: Any) -> list[str]:
        return [f"{place}.{option}" for place, option in enumerate(value, start=1)]

    def compared(self, value: Any) -> Any:
        """Return the option in the first place; an answer to another version may be no list."""
        return value[0] if isinstance(value, list) else value

    def columns(self, key: str) -> Mapping[str, Text]:
        """Return a column for each option; no other key has a point in it."""
        return {f"{key}.{option.value}": option.label for option in self.options}

    def cells(self, value: Any) -> tuple[Any, ...]:
        """Return the place of each option, from 1."""
        places = {option: place for place, option in enumerate(value or (), start=1)}
        return tuple(places.get(option.value, "") for option in self.options)

    def widget(self, question: Question, chosen: Sequence[str], viewing: Viewing) -> Widget:
        """Return the options in their order so far, each with a list of places;
        static/js/pages/survey/ranking.js keeps the order and makes them draggable.
        """
        places = [str(place) for place in range(1, len(self.options) + 1)]
        given = {option: place for place, _point, option in (one.partition(".") for one in chosen)}
        language = viewing.language
        rows = [
            Choice(one.value, spoken(one.label, language), number=given.get(one.value, ""))
            for one in self.options_shown(viewing.seed)
        ]
        rows.sort(key=lambda row: places.index(row.number) if row.number in places else len(places))
        more = {"places": places}
        return Widget("surveys/_ranking.html", self.kind, choices=tuple(rows), more=more)
