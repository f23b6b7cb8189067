"""A part of a document as a Django form, made from the classes of the definition and a guide.

A part is a plain document (dicts and lists, as in JSON); the names of fields are paths in it:
`leaves.0.text.en`.

- `PartForm(cls, document)` has a Django field for each value, in groups as in the classes;
- `PartForm.read(cls, sent)` returns the document of what a browser sent;
- the form of that document, with `is_sent`, has the `errors` of its values.

A number that cannot be read stays in the document as it was typed. An empty field has the default
of the class, if there is one.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Any, ClassVar

import msgspec
from django import forms
from django.utils.datastructures import MultiValueDict
from django.utils.translation import gettext_lazy
from msgspec import inspect

from surveys.document_forms import fields
from surveys.document_forms.fields import NOTHING, Offered, ValueField, field_of, text_of
from surveys.document_forms.guide import FormGuide
from surveys.document_forms.parts import AskedField, Document, is_numbered, members
from surveys.documents import Text

MOST_LISTED = 500  # of anything that is sent; the classes have their own, smaller limits


class FormLayout:
    """A form or a group, which have fields and groups."""

    parts: "list[forms.BoundField | Group]"

    @property
    def details(self) -> list[forms.BoundField]:
        fields = (one for one in self.parts if isinstance(one, forms.BoundField))
        return [one for one in fields if one.field.is_detail]

    @property
    def has_wrong_details(self) -> bool:
        return any(one.errors for one in self.details)


@dataclass(frozen=True)
class Group(FormLayout):
    """A part, optional part (`switch` names its checkbox), one `kind` of several, or a list."""

    name: str
    member: AskedField
    parts: "list[forms.BoundField | Group]" = field(default_factory=list)
    switch: str = ""
    is_on: bool = True
    is_list: bool = False
    kind: str = ""
    number: int | None = None  # of a part in a list, from 1
    was: str = ""  # its short name when the page was first shown
    is_last: bool = False
    is_group: bool = True  # tells it from a field in templates

    @property
    def key(self) -> str:
        return self.member.key

    @property
    def list_name(self) -> str:
        return self.name if self.number is None else self.name.rpartition(".")[0]

    @property
    def called(self) -> int:
        """The number of a part of a list for people, from 0 where parts are numbered."""
        return (self.number or 0) - is_numbered(self.member)

    @property
    def label(self) -> Any:
        guide, words = self.member.guide, self.member.called
        if self.kind:
            return guide.word(words, self.kind)
        return guide.item(words) if self.number is not None else guide.label(words)

    @property
    def item(self) -> Any:
        return self.member.guide.item(self.member.called)

    @property
    def added(self) -> list[tuple[str, Any]]:
        """The buttons that add to the list: what each sends, and its label."""
        kinds = self.member.guide.added(self.member.called)
        listed = [(f"{self.list_name}:{kind}", word) for kind, word in kinds]
        return listed or [(self.list_name, self.item)]

    @property
    def hint(self) -> Any:
        return "" if self.number is not None else self.member.guide.hint(self.member.called)


class PartForm(FormLayout, forms.Form):
    """The form of a part, or of some of its fields (`only`), without those `decided` elsewhere
    (`Class.key`). `parts` are its fields and groups in order. Subclasses have the guide.
    """

    guide: ClassVar[FormGuide]

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
        self._languages, self.offered, self._decided = languages, offered, decided
        self.parts = list(self._parts(cls, document, "", only))
        if is_sent:
            self.is_bound, self.data = True, MultiValueDict()
            for name, one in self.fields.items():
                self.data.setlist(name, one.as_sent(self.initial[name]))

    @property
    def refusals(self) -> dict[str, str]:
        return {name: str(found[0]) for name, found in self.errors.items()}

    def _parts(
        self, cls: type[Any], document: Document, prefix: str, only: Collection[str] = ()
    ) -> "Iterator[forms.BoundField | Group]":
        absent = self.guide.left_out(cls, document.get)
        for member in members(self.guide, cls, only):
            value, name = document.get(member.key, member.default), prefix + member.key
            if member.key in absent or member.called in self._decided:
                continue
            if member.kinds:
                if value is not None:
                    kind = value["kind"]
                    inner = list(self._parts(member.kinds[kind], value, f"{name}."))
                    yield Group(name, member, inner, kind=kind)
            elif member.part is not None:
                switch = f"{name}.on" if member.has_none else ""
                inner = list(self._parts(member.part, value or {}, f"{name}."))
                is_on = not switch or value is not None
                for field_name, one in self.fields.items():
                    one.is_off |= not is_on and field_name.startswith(f"{name}.")
                yield Group(name, member, inner, switch=switch, is_on=is_on)
            elif member.listed is not None:
                inner = list(self._items(member, value or [], name))
                yield Group(name, member, inner, is_list=True)
            else:
                yield from self.fields_of(member, value, name)

    def fields_of(self, member: AskedField, value: Any, name: str) -> Iterator[forms.BoundField]:
        """Add the field of a value, or the fields of a text in each language."""
        if member.annotation != Text:
            yield self.add(name, field_of(member, value, self.offered), value)
            return
        written = dict(value or {})
        for language in dict.fromkeys((*self._languages, *written)):
            one = fields.text_field(member, language)
            yield self.add(f"{name}.{language}", one, written.get(language, ""))

    def _items(self, member: AskedField, values: list[Document], name: str) -> Iterator[Group]:
        for n, value in enumerate(values, start=1):
            one, was = f"{name}.{n - 1}", value.get("was", value.get("key", ""))
            inner = list(self._parts(member.listed, value, f"{one}."))
            yield Group(one, member, inner, number=n, was=was, is_last=n == len(values))

    def add(self, name: str, one: ValueField, value: Any) -> forms.BoundField:
        self.fields[name], self.initial[name] = one, value
        return self[name]

    @classmethod
    def read(
        cls, part: type[Any], sent: Any, *, only: Collection[str] = (), prefix: str = ""
    ) -> Document:
        """Return the document of a class that a browser sent (a QueryDict)."""
        document: Document = {}
        absent = cls.guide.left_out(part, lambda key: f"{prefix}{key}.kind" in sent)
        for member in members(cls.guide, part, only):
            if member.key in absent:
                continue
            value = cls._read(member, sent, prefix + member.key)
            if value is not msgspec.UNSET and (member.is_required or value != member.default):
                document[member.key] = value
        return document

    @classmethod
    def _read(cls, member: AskedField, sent: Any, name: str) -> Any:
        if member.kinds:
            kind = sent.get(f"{name}.kind")
            part = member.kinds.get(kind)
            return part and {"kind": kind} | cls.read(part, sent, prefix=f"{name}.")
        if member.part is not None:
            is_off = member.has_none and f"{name}.on" not in sent
            return None if is_off else cls.read(member.part, sent, prefix=f"{name}.")
        if member.listed is not None:
            # Each part has a field of its name, even when it is empty.
            places = takewhile(lambda n: f"{name}.{n}" in sent, range(MOST_LISTED))
            parts = [cls.read(member.listed, sent, prefix=f"{name}.{n}.") for n in places]
            if is_numbered(member):
                return [{"number": n} | part for n, part in enumerate(parts)]
            return parts
        if isinstance(member.shape, inspect.DictType):
            keys = [key for key in sent if key.startswith(f"{name}.")]
            texts = {key.removeprefix(f"{name}."): text_of(sent.get(key)) for key in keys}
            return {language: text for language, text in texts.items() if text}
        return field_of(member).to_python(sent.getlist(name))

    @classmethod
    def list_in(
        cls, document: Document, name: str, part: type[Any], only: Collection[str] = ()
    ) -> list[Document] | None:
        """Return the list of parts at a path ("factors.0.levels") in the document of a class,
        created if missing; None for paths that the form does not have.
        """
        key, _dot, rest = name.partition(".")
        member = next((one for one in members(cls.guide, part, only) if one.key == key), None)
        if member is None:
            return None
        inner, inner_class = document.get(key), member.part or member.listed
        if member.listed is not None:
            if not rest:
                return document.setdefault(key, [])
            n, _dot, rest = rest.partition(".")
            inner = dict(enumerate(inner or ())).get(number(n))
        elif member.part is not None and not member.has_none:
            inner = document.setdefault(key, {})
        if inner_class is None or not isinstance(inner, dict):
            return None
        return cls.list_in(inner, rest, inner_class)


MEANWHILE = gettext_lazy(
    "Not saved: someone else changed this draft. If your change still applies, submit it again."
)


@dataclass
class SubmittedPart:
    """A part as it was typed, with `errors` by field, sentences to show `above` the form, and the
    `anchor` of the page to return to.
    """

    part: Document
    errors: dict[str, str] = field(default_factory=dict)
    above: list[str] = field(default_factory=list)
    anchor: str = ""

    @property
    def is_refused(self) -> bool:
        return bool(self.errors or self.above)


def pressed(sent: Any, count: int = 3) -> list[str]:
    """Return the `count` words in a button's value, mostly `verb:list:n`; missing ones are ""."""
    words = sent.get("do", "").split(":")
    return [*words, *[""] * count][:count]


def number(text: str) -> int:
    """Return the number of a part in a button's value; -1, which no part has, for other text."""
    return int(text[:6]) if text.isascii() and text.isdigit() else -1
