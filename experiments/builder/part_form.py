"""A part of a study as a Django form: what a page of the study builder asks follows from the
definition's classes alone.

A part is a plain document (dicts and lists, as in JSON); the names of fields are paths in it:
`leaves.0.text.en`. Three steps are all that there is:

- `PartForm(cls, document)` makes a Django field for each value of the document, and lays them out
  in groups as the class has them;
- `read(cls, sent)` makes the document of what a browser sent;
- the form of that document, with `is_sent`, has in `errors` what cannot be kept.

Which field a value gets is said once, in `field_of`. A field shows (`prepare_value`), reads
(`to_python`) and refuses (`validate`) one value. What was typed is never lost: a number that is
none stays in the document as the text that it was. A field that is empty has the value that the
class says, where it says one.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import msgspec
from django import forms
from django.utils.datastructures import MultiValueDict
from django.utils.translation import gettext
from msgspec import inspect

from experiments.builder import labels
from experiments.builder.parts import (
    AskedField,
    Document,
    choices_of,
    is_numbered,
    left_out,
    members,
    read_number,
    read_points,
)
from experiments.definition.design import Levels
from surveys.documents import Text

# what is written on several lines
LONG = frozenset(
    {
        *("text", "intro", "source", "recruitment", "compensation", "question", "rationale"),
        *("stopping", "blinding", "missing_data", "notes", "line", "description"),
    }
)
# names that may have spaces: only commas are between them
SPACED = frozenset({"values"})
MOST_LISTED = 500  # of anything that is sent; the classes have their own, smaller limits
NOT_POINTS = "Write one point per line: x and y in metres."
Offered = Mapping[str, Sequence[str]]
NOTHING: Offered = MappingProxyType({})


# --- fields: one value ----------------------------------------------------------------------------


class ValueField(forms.Field):
    """A value that is text, and what all values share. `style` names its class in CSS; in an
    optional part that `is_off` nothing is refused.
    """

    is_off = False

    def __init__(
        self, member: AskedField, style: str, widget: forms.Widget, *, language: str = ""
    ) -> None:
        self.member, self.style, self.language = member, style, language
        self.language_name = labels.language(language) if language else ""
        widget.attrs |= {"lang": language} if language else {}
        super().__init__(
            required=False,
            widget=widget,
            label=labels.label(member.called),
            help_text="" if language else labels.hint(member.called),
        )

    def prepare_value(self, value: Any) -> Any:
        """Return what is shown for a value of the document."""
        return "" if value is None else value

    def to_python(self, value: Any) -> Any:
        """Return the value of the document for what was sent; UNSET is what the class says."""
        text = text_of(value)
        if not text and (self.member.has_none or self.member.default is not None):
            return None if self.member.has_none else msgspec.UNSET
        return self.parse(text)

    def parse(self, text: str) -> Any:
        """Return the value that a text stands for, or the text itself when it is none."""
        return text

    def validate(self, value: Any) -> None:
        """Refuse what the class refuses."""
        says_class = value is msgspec.UNSET or self.member.says(value)
        if not (self.is_off or self.language or says_class) and (told := self.refusal(value)):
            raise forms.ValidationError(told)

    def refusal(self, value: Any) -> str:
        """Return why a value cannot be kept; empty when it can."""
        try:
            msgspec.convert(value, self.member.annotation)
        except msgspec.ValidationError as error:
            return f"{error}."
        return ""


class NumberField(ValueField):
    """A number, with a point or a comma."""

    def prepare_value(self, value: Any) -> Any:
        """Return a number without needless decimals."""
        return f"{value:.10g}" if isinstance(value, float) else super().prepare_value(value)

    def parse(self, text: str) -> Any:
        """Return the number."""
        return read_number(text, whole=isinstance(self.member.shape, inspect.IntType))

    def refusal(self, value: Any) -> str:
        """Return what is said of text, or what the class says."""
        if isinstance(value, str):
            return "This is not a number." if value else "Write a number."
        return super().refusal(value)


class CheckField(ValueField):
    """Yes or no."""

    def to_python(self, value: Any) -> bool:
        """Return whether it was ticked: else nothing of it was sent."""
        return bool(value)


class NamesField(ValueField):
    """Several names: on one line with commas between them, or as boxes to tick."""

    def prepare_value(self, value: Any) -> Any:
        """Return the names on one line, or for the boxes one by one."""
        is_line = self.style == "names" and not isinstance(value, str)
        return ", ".join(value or ()) if is_line else value or ()

    def refusal(self, value: Any) -> str:
        """Refuse to take the last language away: the study's texts would go with it."""
        if self.member.key == "languages" and not value:
            return gettext("Choose at least one language.")
        return super().refusal(value)

    def to_python(self, value: Any) -> list[str]:
        """Return the names."""
        values = [value] if isinstance(value, str) else value or ()
        if self.member.key in SPACED:
            return [name.strip() for one in values for name in one.split(",") if name.strip()]
        return [name for one in values for name in one.replace(",", " ").split()]


class PointsField(ValueField):
    """Points, one a line."""

    def prepare_value(self, value: Any) -> str:
        """Return a line a point."""
        return (
            value if isinstance(value, str) else "\n".join(f"{x:g} {y:g}" for x, y in value or ())
        )

    def to_python(self, value: Any) -> Any:
        """Return the points."""
        return read_points(text_of(value))

    def refusal(self, value: Any) -> str:
        """Return what is said of text, or what the class says."""
        return NOT_POINTS if isinstance(value, str) else super().refusal(value)


class LevelField(ValueField):
    """The level that a condition has of one factor, or none yet."""

    def __init__(self, member: AskedField, factor: str, levels: Sequence[str], value: str) -> None:
        known = dict.fromkeys(("", *levels, value))
        listed = [(level, level or labels.NOTHING) for level in known]
        super().__init__(member, "choice", forms.Select(choices=listed))
        self.label = f"{self.label}: {factor}"

    def refusal(self, value: Any) -> str:
        """Refuse nothing: which levels there are is the study's to say."""
        return ""


def field_of(member: AskedField, value: Any = None, offered: Offered = NOTHING) -> ValueField:
    """Return the field of a value that is no part, no list of parts and no text in languages.
    `offered` is what may be chosen, by key; `value` stays among it.
    """
    offers = offered.get(member.called, offered.get(member.key, ()))
    shape, choices = member.shape, choices_of(member) or tuple(offers)
    if isinstance(shape, inspect.VarTupleType):
        if not isinstance(shape.item_type, inspect.LiteralType | inspect.StrType):
            return PointsField(member, "points", _box(5))
        if not choices:
            return NamesField(member, "names", _line())
        listed = _named(member, dict.fromkeys((*choices, *(value or ()))))
        return NamesField(member, "choices", forms.CheckboxSelectMultiple(choices=listed))
    if isinstance(shape, inspect.BoolType):
        return CheckField(member, "check", forms.CheckboxInput())
    if isinstance(shape, inspect.IntType | inspect.FloatType):
        return NumberField(member, "number", _line(inputmode="decimal"))
    if choices:
        empty = ("",) if member.has_none or member.default == "" else ()
        missing = () if value in {*choices, None, ""} else (str(value),)
        listed = _named(member, (*empty, *choices, *missing))
        return ValueField(member, "choice", forms.Select(choices=listed))
    return text_field(member)


def text_field(member: AskedField, language: str = "") -> ValueField:
    """Return the field of a text, on a line or several."""
    style, widget = ("text", _box(4)) if member.key in LONG else ("line", _line())
    return ValueField(member, style, widget, language=language)


def _line(**attributes: str) -> forms.TextInput:
    return forms.TextInput({"autocomplete": "off", **attributes})


def _box(lines: int) -> forms.Textarea:
    return forms.Textarea({"rows": lines, "cols": None})


def _named(member: AskedField, choices: Iterable[str]) -> list[tuple[str, Any]]:
    return [(choice, labels.word(member.called, choice)) for choice in choices]


def text_of(value: Any) -> str:
    """Return what was sent for a field as text; of several values the last one counts."""
    if isinstance(value, list):
        value = value[-1] if value else ""
    return str(value or "").replace("\r\n", "\n").strip()


# --- forms: a part --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Group:
    """Fields that belong together: a part, an optional part (`switch` is the name of its box to
    tick), a part of one `kind` among several, or a list of parts. `words` is by what its words are
    looked up.
    """

    name: str
    key: str
    words: str
    parts: "list[forms.BoundField | Group]" = field(default_factory=list)
    switch: str = ""
    is_on: bool = True
    is_list: bool = False
    kind: str = ""
    number: int | None = None  # of a part in a list, from 1
    is_last: bool = False
    is_group: bool = True  # a field has no such thing

    @property
    def called(self) -> int:
        """Return the number by which people know a part of a list; checkpoints are counted from 0,
        the station.
        """
        return (self.number or 0) - (self.key == "checkpoints")

    @property
    def label(self) -> Any:
        """What it is called; a part of a list by what one of them is called."""
        if self.kind:
            return labels.word(self.words, self.kind)
        return labels.item(self.words) if self.number is not None else labels.label(self.words)

    @property
    def item(self) -> Any:
        """What one part of the list is called."""
        return labels.item(self.words)

    @property
    def added(self) -> list[tuple[str, Any]]:
        """What can be added to the list: what its button sends, and what that is called."""
        kinds = labels.kinds(self.words)
        return [(f"{self.key}:{kind}", word) for kind, word in kinds] or [(self.key, self.item)]

    @property
    def hint(self) -> Any:
        """What is said below it."""
        return "" if self.number is not None else labels.hint(self.words)


class PartForm(forms.Form):
    """The form of a part, or of some of its fields (`only`), without those that something else has
    `decided` (`Class.key`). `parts` are its fields and groups as they are laid out.
    """

    def __init__(
        self,
        cls: type[Any],
        document: Document,
        *,
        languages: Sequence[str] = (),
        offered: Offered = NOTHING,
        only: Collection[str] = (),
        is_sent: bool = False,
        decided: Collection[str] = (),
    ) -> None:
        super().__init__(initial={})
        self._languages, self._offered, self._decided = languages, offered, decided
        self.parts = list(self._parts(cls, document, "", only))
        if is_sent:
            self.is_bound, self.data = True, MultiValueDict()
            for name, one in self.fields.items():
                shown = one.prepare_value(self.initial[name])
                self.data.setlist(name, list(shown) if one.style == "choices" else [shown])

    @property
    def told(self) -> dict[str, str]:
        """The first error of each field, by its name."""
        return {name: str(found[0]) for name, found in self.errors.items()}

    def _parts(
        self, cls: type[Any], document: Document, prefix: str, only: Collection[str] = ()
    ) -> "Iterator[forms.BoundField | Group]":
        absent = left_out(cls, document.get)
        for member in members(cls, only):
            value, name = document.get(member.key, member.default), prefix + member.key
            if member.key in absent or member.called in self._decided:
                continue
            if member.kinds:
                yield from self._of_a_kind(member, value, name)
            elif member.part is not None:
                switch = f"{name}.on" if member.has_none else ""
                inner = list(self._parts(member.part, value or {}, f"{name}."))
                is_on = not switch or value is not None
                if not is_on:
                    self._leave_out(f"{name}.")
                yield Group(name, member.key, member.called, inner, switch=switch, is_on=is_on)
            elif member.listed is not None:
                inner = list(self._items(member, value or [], name))
                yield Group(name, member.key, member.called, inner, is_list=True)
            elif member.annotation == Text:
                written = dict(value or {})
                for language in dict.fromkeys((*self._languages, *written)):
                    one = text_field(member, language)
                    yield self._add(f"{name}.{language}", one, written.get(language, ""))
            elif member.annotation == Levels:
                yield from self._levels(member, dict(value or {}), name)
            else:
                yield self._add(name, field_of(member, value, self._offered), value)

    def _of_a_kind(self, member: AskedField, value: Any, name: str) -> Iterator[Group]:
        if value is not None:
            kind = value["kind"]
            inner = list(self._parts(member.kinds[kind], value, f"{name}."))
            yield Group(name, member.key, member.called, inner, kind=kind)

    def _levels(
        self, member: AskedField, chosen: dict[str, str], name: str
    ) -> Iterator[forms.BoundField]:
        start = f"{member.key}."
        factors = (key.removeprefix(start) for key in self._offered if key.startswith(start))
        for factor in dict.fromkeys((*factors, *chosen)):
            levels, level = self._offered.get(start + factor, ()), chosen.get(factor, "")
            yield self._add(f"{name}.{factor}", LevelField(member, factor, levels, level), level)

    def _items(self, member: AskedField, values: list[Document], name: str) -> Iterator[Group]:
        for n, value in enumerate(values):
            inner = list(self._parts(member.listed, value, f"{name}.{n}."))
            last = n == len(values) - 1
            one = f"{name}.{n}"
            yield Group(one, member.key, member.called, inner, number=n + 1, is_last=last)

    def _add(self, name: str, one: ValueField, value: Any) -> forms.BoundField:
        self.fields[name], self.initial[name] = one, value
        return self[name]

    def _leave_out(self, prefix: str) -> None:
        for name, one in self.fields.items():
            one.is_off = one.is_off or name.startswith(prefix)


def read(cls: type[Any], sent: Any, *, only: Collection[str] = (), prefix: str = "") -> Document:
    """Return the document that a form makes (`sent` is a QueryDict); what cannot be read is in it
    as it was typed.
    """
    document: Document = {}
    absent = left_out(cls, lambda key: f"{prefix}{key}.kind" in sent)
    for member in members(cls, only):
        if member.key in absent:
            continue
        value = _read(member, sent, prefix + member.key)
        if value is not msgspec.UNSET and (member.is_required or value != member.default):
            document[member.key] = value
    return document


def _read(member: AskedField, sent: Any, name: str) -> Any:
    if member.kinds:
        kind = sent.get(f"{name}.kind")
        cls = member.kinds.get(kind)
        return None if cls is None else {"kind": kind} | read(cls, sent, prefix=f"{name}.")
    if member.part is not None:
        is_off = member.has_none and f"{name}.on" not in sent
        return None if is_off else read(member.part, sent, prefix=f"{name}.")
    if member.listed is not None:
        numbered = is_numbered(member.listed)
        return [
            ({"number": n} if numbered else {}) | read(member.listed, sent, prefix=f"{name}.{n}.")
            for n in range(_count(sent, name))
        ]
    if member.annotation in (Text, Levels):
        start = f"{name}."
        texts = {
            key.removeprefix(start): text_of(sent.get(key)) for key in sent if key.startswith(start)
        }
        return {language: text for language, text in texts.items() if text}
    return field_of(member).to_python(sent.getlist(name))


def _count(sent: Any, name: str) -> int:
    """Return how many parts of a list were sent: each has a field `<name>.<n>`, so that an empty
    one is there too.
    """
    return next((n for n in range(MOST_LISTED) if f"{name}.{n}" not in sent), MOST_LISTED)
