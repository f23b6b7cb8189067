"""The form fields of values in documents; `field_of` chooses the field of a value."""

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any

import msgspec
from django import forms
from django.utils.formats import get_format
from django.utils.text import capfirst
from django.utils.translation import get_language_info, gettext, gettext_lazy
from msgspec import inspect

from surveys.document_forms.guide import is_among
from surveys.document_forms.parts import AskedField, choices_of, literals, read_number, read_points

NOT_POINTS = "Write one point per line: x and y in metres."
NONE = gettext_lazy("not chosen")
# msgspec's message for a number beyond its limits, and ours.
BEYOND = re.compile(r"Expected `\w+(?: \| null)?` ([<>]=?) (-?[\d.]+)\.$")
LIMITS = {
    ">=": gettext_lazy("Write a number of at least %(n)s."),
    ">": gettext_lazy("Write a number above %(n)s."),
    "<=": gettext_lazy("Write a number of at most %(n)s."),
    "<": gettext_lazy("Write a number below %(n)s."),
}
# Choices by field: values, values with labels, or groups of values with labels.
Offered = Mapping[str, Sequence[str] | Mapping[str, Any]]
NOTHING: Offered = MappingProxyType({})
Labelled = list[tuple[str, Any]]  # values with labels, or groups with values and labels


class GroupedText(str):
    """The label of a choice, with the name of the `group` that lists it."""

    __slots__ = ("group",)
    group: str


def _labels(offers: Sequence[str] | Mapping[str, Any]) -> dict[str, Any]:
    """Return the labels of choices by value; nothing for choices without labels."""
    found: dict[str, Any] = {}
    for key, one in offers.items() if isinstance(offers, Mapping) else ():
        if isinstance(one, Mapping):
            found |= {value: GroupedText(label) for value, label in one.items()}
            for value in one:
                found[value].group = key
        else:
            found[key] = one
    return found


def language_name(code: str) -> str:
    try:
        return str(capfirst(get_language_info(code)["name_translated"]))
    except KeyError:
        return code


class ValueField(forms.Field):
    """A text, and the base of other values. `style` names its class in CSS. It refuses no value
    that is `allowed`, and none in an optional part that `is_off`.
    """

    is_off = False

    def __init__(
        self,
        member: AskedField,
        style: str,
        widget: forms.Widget,
        *,
        language: str = "",
        allowed: Collection[str] = (),
    ) -> None:
        self.member, self.style, self.language, self.allowed = member, style, language, allowed
        self.language_name = language_name(language) if language else ""
        self.is_detail = is_among(member.guide.details, member.called)
        widget.attrs |= {"lang": language} if language else {}
        label = member.guide.label(member.called)
        hint = "" if language else member.guide.hint(member.called)
        super().__init__(required=False, widget=widget, label=label, help_text=hint)

    def prepare_value(self, value: Any) -> Any:
        return "" if value is None else value

    def to_python(self, value: Any) -> Any:
        """Return the value in the document for what was sent; UNSET is the default."""
        text = text_of(value)
        if not text and (self.member.has_none or self.member.default is not None):
            return None if self.member.has_none else msgspec.UNSET
        return self.parse(text)

    def parse(self, text: str) -> Any:
        """Return the value of a text, or the text itself when it has none."""
        return text

    def as_sent(self, value: Any) -> list[Any]:
        """Return what a browser sends for a value that was not edited."""
        shown = self.prepare_value(value)
        return list(shown) if self.style == "choices" else [shown]

    def validate(self, value: Any) -> None:
        is_default = not self.member.is_required and value == self.member.default
        is_free = self.is_off or self.language or value is msgspec.UNSET or is_default
        if is_free or value in self.allowed:
            return
        if refusal := self.refusal(value):
            raise forms.ValidationError(refusal)

    def refusal(self, value: Any) -> str:
        """Return why the class refuses a value; empty when it does not."""
        try:
            msgspec.convert(value, self.member.annotation)
        except msgspec.ValidationError as error:
            return f"{error}."
        return ""


def decimal_mark() -> str:
    return str(get_format("DECIMAL_SEPARATOR"))


def number_text(value: float) -> str:
    """Return the shortest text that is read as exactly the same number."""
    text = f"{value:.10g}"
    return text if float(text) == value else repr(value)


class NumberField(ValueField):
    """A number, with a point or the language's own decimal mark."""

    def prepare_value(self, value: Any) -> Any:
        return number_text(value) if isinstance(value, float) else str(super().prepare_value(value))

    def parse(self, text: str) -> Any:
        is_word = text in literals(self.member.annotation)
        whole = isinstance(self.member.shape, inspect.IntType)
        return text if is_word else read_number(text, whole=whole, mark=decimal_mark())

    def refusal(self, value: Any) -> str:
        if isinstance(value, str) and value not in literals(self.member.annotation):
            if isinstance(read_number(value, whole=False, mark=decimal_mark()), float):
                return gettext("Write a whole number.")
            if "," in value:
                return gettext("Use a decimal point and no comma: 0.6, or 1000.")
            return gettext("This is not a number.") if value else gettext("Write a number.")
        refusal = super().refusal(value)
        beyond = BEYOND.search(refusal)
        return LIMITS[beyond[1]] % {"n": self.limit(float(beyond[2]))} if beyond else refusal

    def limit(self, value: float) -> str:
        return f"{value:g}"


class DegreesInput(forms.TextInput):
    """A number in degrees, preceded by a hidden input with the `exact` number in radians."""

    exact = ""

    def value_from_datadict(self, data: Any, _files: Any, name: str) -> Any:
        return data.getlist(name)

    def render(self, name: str, value: Any, attrs: Any = None, renderer: Any = None) -> Any:
        shown = super().render(name, value, attrs, renderer)
        return forms.HiddenInput().render(name, self.exact) + shown


class DegreesField(NumberField):
    """An angle or angular velocity, in radians in the document and in rounded degrees on the page.
    A number that is not edited stays exactly the same.
    """

    def __init__(self, member: AskedField, value: Any) -> None:
        widget = DegreesInput({"autocomplete": "off", "inputmode": "decimal"})
        widget.exact = repr(value) if isinstance(value, int | float) else ""
        super().__init__(member, "number", widget)

    def prepare_value(self, value: Any) -> Any:
        if isinstance(value, int | float):
            return f"{round(math.degrees(value), 2):.10g}"
        return text_of(value)

    def as_sent(self, value: Any) -> list[Any]:
        is_number = isinstance(value, int | float)
        return [repr(value) if is_number else "", self.prepare_value(value)]

    def to_python(self, value: Any) -> Any:
        """Return the exact number unless its degrees were edited."""
        exact, *shown = value if isinstance(value, list) and value else [""]
        known = read_number(exact, whole=False)
        if isinstance(known, float) and shown and text_of(shown) == self.prepare_value(known):
            return known
        return super().to_python(value)

    def parse(self, text: str) -> Any:
        number = super().parse(text)
        return math.radians(number) if isinstance(number, int | float) else number

    def limit(self, value: float) -> str:
        return f"{math.degrees(value):.4g}"


class CheckField(ValueField):
    def to_python(self, value: Any) -> bool:
        return bool(value)


class NamesField(ValueField):
    """Several names or numbers on one line with commas, or names as boxes to tick."""

    def prepare_value(self, value: Any) -> Any:
        if isinstance(value, str):
            return value
        names = [number_text(one) if isinstance(one, float) else str(one) for one in value or ()]
        return ", ".join(names) if self.style == "names" else names

    def refusal(self, value: Any) -> str:
        """Also refuse to remove the last language, and with it all texts."""
        if self.member.key == "languages" and not value:
            return gettext("Choose at least one language.")
        return super().refusal(value)

    def to_python(self, value: Any) -> list[Any]:
        text = ",".join([value] if isinstance(value, str) else value or ())
        is_spaced = self.member.key in self.member.guide.spaced
        names = text.split(",") if is_spaced else text.replace(",", " ").split()
        words = [name.strip() for name in names if name.strip()]
        if not isinstance(self.member.shape.item_type, inspect.FloatType):  # type: ignore[attr-defined]
            return words
        return [read_number(word, whole=False, mark=decimal_mark()) for word in words]


class PointsField(ValueField):
    def prepare_value(self, value: Any) -> str:
        if isinstance(value, str):
            return value
        return "\n".join(" ".join(map(number_text, point)) for point in value or ())

    def to_python(self, value: Any) -> Any:
        return read_points(text_of(value), decimal_mark())

    def refusal(self, value: Any) -> str:
        return NOT_POINTS if isinstance(value, str) else super().refusal(value)


def field_of(member: AskedField, value: Any = None, offered: Offered = NOTHING) -> ValueField:
    """Return the field of a value that is no part, no list of parts and no text in languages. The
    choices are those `offered`, and `value`.
    """
    offers = offered.get(member.called, offered.get(member.key, ()))
    names = _labels(offers)
    shape, choices = member.shape, tuple(names or offers) or choices_of(member)
    if isinstance(shape, inspect.VarTupleType):
        if isinstance(shape.item_type, inspect.TupleType):
            return PointsField(member, "points", _box(5))
        if not choices:
            return NamesField(member, "names", _line())
        listed = _named(member, dict.fromkeys((*choices, *map(str, value or ()))), names)
        return NamesField(member, "choices", forms.CheckboxSelectMultiple(choices=listed))
    if isinstance(shape, inspect.BoolType):
        return CheckField(member, "check", forms.CheckboxInput())
    if is_among(member.guide.angles, member.called):
        return DegreesField(member, value)
    if isinstance(shape, inspect.IntType | inspect.FloatType):
        return NumberField(member, "number", _line(inputmode="decimal"))
    if choices:
        empty = ("",) if member.has_none or member.default == "" else ()
        missing = () if value in {*choices, None, ""} else (str(value),)
        listed = _in_groups(_named(member, (*empty, *choices, *missing), names))
        return ValueField(member, "choice", forms.Select(choices=listed), allowed=names)
    return text_field(member)


def text_field(member: AskedField, language: str = "") -> ValueField:
    is_long = is_among(member.guide.long, member.called)
    style, widget = ("text", _box(8)) if is_long else ("line", _line())
    return ValueField(member, style, widget, language=language)


def _line(**attributes: str) -> forms.TextInput:
    return forms.TextInput({"autocomplete": "off", **attributes})


def _box(lines: int) -> forms.Textarea:
    return forms.Textarea({"rows": lines, "cols": None})


def _in_groups(listed: Labelled) -> Labelled:
    groups: dict[str, Labelled] = {"": []}
    for value, words in listed:
        groups.setdefault(getattr(words, "group", ""), []).append((value, words))
    return [*groups.pop(""), *groups.items()]


def _named(member: AskedField, choices: Iterable[str], names: Mapping[str, str]) -> Labelled:
    word = language_name if member.key == "languages" else partial(member.guide.word, member.called)
    return [(choice, names.get(choice) or word(choice) or NONE) for choice in choices]


def text_of(value: Any) -> str:
    """Return the last of the values sent for a field, as text."""
    if isinstance(value, list):
        value = value[-1] if value else ""
    return str(value or "").replace("\r\n", "\n").strip()
