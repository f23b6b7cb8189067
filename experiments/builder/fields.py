"""A definition as a form, and a form as a definition: what a page of the study builder asks follows
from the classes alone.

A part of a study is a plain document (dicts and lists, as in JSON). `ask` lays it out as groups of
fields for a template, `read` makes the document of what was sent, `change` adds, removes and moves
what stands in lists, and `errors` tells, field by field, what cannot be kept. What was typed is
never lost: a number that is none stays in the document as the text that it was.

The names of fields are paths: `leaves.0.text.en`. A field that is empty has the value that the
class says, where it says one.

Longer than most files here, because laying out, reading and refusing go over the same shapes and
must agree on each of them.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, get_args

import msgspec
from msgspec import inspect

from experiments.definition.schema import Checkpoint
from robots.api.messages import Point
from surveys.documents import Text

Document = dict[str, Any]
Widget = Literal["line", "text", "number", "check", "choice", "choices", "points", "names"]
LONG = frozenset({"text", "intro", "source"})  # what is written on several lines
DERIVED = {Checkpoint: frozenset({"number"})}  # its place in the list says it
MOST_LISTED = 500  # of anything that is sent; the classes have their own, smaller limits


class Sent(Protocol):
    """What a browser sent: django.http.QueryDict is one."""

    def get(self, name: str, default: str = "") -> Any:
        """Return the last value of a field."""

    def getlist(self, name: str) -> list[str]:
        """Return all of its values."""

    def __contains__(self, name: object) -> bool: ...
    def __iter__(self) -> Iterator[str]: ...


@dataclass(frozen=True)
class Field:
    """One thing to fill in. `key` is the field of the class, `language` is set for a text's;
    `choices` are values.
    """

    name: str
    key: str
    widget: Widget
    value: Any
    choices: tuple[str, ...] = ()
    language: str = ""
    error: str = ""


@dataclass(frozen=True)
class Group:
    """Fields that belong together: a part, an optional part (`switch` is the name of its box to
    tick), or a list of parts.
    """

    name: str
    key: str
    parts: list["Field | Group"] = field(default_factory=list)
    switch: str = ""
    is_on: bool = True
    is_list: bool = False
    number: int | None = None  # of a part in a list, from 1
    is_last: bool = False

    @property
    def is_group(self) -> bool:
        """True; a field has no such thing."""
        return True

    @property
    def called(self) -> int:
        """Return the number by which people know a part of a list; checkpoints are counted from 0,
        the station.
        """
        return (self.number or 0) - (self.key == "checkpoints")

    @property
    def has_error(self) -> bool:
        """Tell whether anything inside is wrong."""
        return any(
            part.has_error if isinstance(part, Group) else bool(part.error) for part in self.parts
        )


@dataclass(frozen=True)
class Asking:
    """What a form needs beside the document: the study's languages, what may be chosen by key of a
    field, and errors by name.
    """

    languages: Sequence[str]
    offered: Mapping[str, Sequence[str]] = field(default_factory=dict)
    errors: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class _Member:
    """A field of a class: `shape` is what it holds, without None; `has_none` tells whether it may
    hold nothing.
    """

    key: str
    type: Any
    shape: inspect.Type
    has_none: bool
    default: Any
    is_required: bool


def members(cls: type[Any], only: Collection[str] = ()) -> list[_Member]:
    """Return what of a class is asked for, in its order."""
    hidden = DERIVED.get(cls, frozenset())
    found = [_member(one) for one in msgspec.structs.fields(cls) if one.name not in hidden]
    return [one for one in found if not only or one.key in only]


def _member(one: Any) -> _Member:
    shape = inspect.type_info(one.type)
    inner = (
        [kind for kind in shape.types if not isinstance(kind, inspect.NoneType)]
        if isinstance(shape, inspect.UnionType)
        else [shape]
    )
    default = None if one.default is msgspec.NODEFAULT else msgspec.to_builtins(one.default)
    return _Member(
        one.name,
        one.type,
        inner[0],
        len(inner) != 1 or inner[0] is not shape,
        default,
        one.required,
    )


def _parts_of(shape: inspect.Type) -> type[Any] | None:
    """Return the class of the parts that a list holds; None for other lists."""
    inner = shape.item_type if isinstance(shape, inspect.VarTupleType) else None
    return inner.cls if isinstance(inner, inspect.StructType) else None


# --- laying out -----------------------------------------------------------------------------------


def ask(cls: type[Any], document: Document, asking: Asking, *, only: Collection[str] = ()) -> Group:
    """Return the form of a part; with `only`, of some of its fields."""
    return Group("", cls.__name__.lower(), list(_ask_all(cls, document, "", asking, only)))


def _ask_all(
    cls: type[Any], document: Document, prefix: str, asking: Asking, only: Collection[str] = ()
) -> Iterator[Field | Group]:
    for member in members(cls, only):
        value = document.get(member.key, member.default)
        yield from _ask(member, value, prefix + member.key, asking)


def _ask(member: _Member, value: Any, name: str, asking: Asking) -> Iterator[Field | Group]:
    listed = _parts_of(member.shape)
    if isinstance(member.shape, inspect.StructType):
        switch = f"{name}.on" if member.has_none else ""
        inner = list(_ask_all(member.shape.cls, value or {}, f"{name}.", asking))
        yield Group(name, member.key, inner, switch=switch, is_on=not switch or value is not None)
    elif listed is not None:
        yield Group(
            name,
            member.key,
            list(_ask_list(listed, member.key, value or [], name, asking)),
            is_list=True,
        )
    elif member.type == Text:
        for language in [
            *asking.languages,
            *(other for other in value or {} if other not in asking.languages),
        ]:
            label = f"{name}.{language}"
            widget: Widget = "text" if member.key in LONG else "line"
            yield Field(
                label,
                member.key,
                widget,
                (value or {}).get(language, ""),
                language=language,
                error=asking.errors.get(label, ""),
            )
    else:
        yield _ask_one(member, value, name, asking)


def _ask_list(
    cls: type[Any], key: str, values: list[Document], name: str, asking: Asking
) -> Iterator[Group]:
    for n, value in enumerate(values):
        inner = list(_ask_all(cls, value, f"{name}.{n}.", asking))
        yield Group(f"{name}.{n}", key, inner, number=n + 1, is_last=n == len(values) - 1)


def _ask_one(member: _Member, value: Any, name: str, asking: Asking) -> Field:
    widget, choices = _widget(member, asking.offered.get(member.key, ()))
    if widget == "choices":
        choices = tuple(dict.fromkeys((*choices, *(value or ()))))
    elif widget == "choice":
        missing = () if value in choices or value in {None, ""} else (str(value),)
        choices = (*(("",) if member.has_none or member.default == "" else ()), *choices, *missing)
    return Field(
        name, member.key, widget, _shown(widget, value), choices, error=asking.errors.get(name, "")
    )


def _widget(member: _Member, offered: Sequence[str]) -> tuple[Widget, tuple[str, ...]]:
    shape = member.shape
    if isinstance(shape, inspect.VarTupleType):
        return _widget_of_list(member, shape.item_type, offered)
    if isinstance(shape, inspect.LiteralType):
        return "choice", get_args(member.type)
    if isinstance(shape, inspect.BoolType):
        return "check", ()
    if isinstance(shape, inspect.IntType | inspect.FloatType):
        return "number", ()
    return ("choice", tuple(offered)) if offered else ("text" if member.key in LONG else "line", ())


def _widget_of_list(
    member: _Member, inner: inspect.Type, offered: Sequence[str]
) -> tuple[Widget, tuple[str, ...]]:
    if isinstance(inner, inspect.LiteralType):
        return "choices", get_args(get_args(member.type)[0])  # inspect has sorted them
    if isinstance(inner, inspect.StrType):
        return ("choices", tuple(offered)) if offered else ("names", ())
    return "points", ()


def _shown(widget: Widget, value: Any) -> Any:
    if widget == "points":
        return (
            value if isinstance(value, str) else "\n".join(f"{x:g} {y:g}" for x, y in value or ())
        )
    if widget == "names":
        return ", ".join(value or ())
    if widget == "number":
        return f"{value:.10g}" if isinstance(value, float) else "" if value is None else str(value)
    if widget in {"check", "choices"}:
        return value
    return "" if value is None else value


# --- reading --------------------------------------------------------------------------------------


def read(cls: type[Any], sent: Sent, *, only: Collection[str] = (), prefix: str = "") -> Document:
    """Return the document that a form makes; what cannot be read is in it as it was typed."""
    document: Document = {}
    for member in members(cls, only):
        value = _read(member, sent, prefix + member.key)
        if value is not msgspec.UNSET and (member.is_required or value != member.default):
            document[member.key] = value
    return document


def _read(member: _Member, sent: Sent, name: str) -> Any:
    listed = _parts_of(member.shape)
    if isinstance(member.shape, inspect.StructType):
        is_off = member.has_none and f"{name}.on" not in sent
        return None if is_off else read(member.shape.cls, sent, prefix=f"{name}.")
    if listed is not None:
        return [
            _numbered(listed, n, read(listed, sent, prefix=f"{name}.{n}."))
            for n in range(_count(sent, name))
        ]
    if member.type == Text:
        start = f"{name}."
        texts = {
            key.removeprefix(start): _lines(sent.get(key)) for key in sent if key.startswith(start)
        }
        return {language: text for language, text in texts.items() if text}
    return _read_one(member, sent, name)


def _count(sent: Sent, name: str) -> int:
    """Return how many parts of a list were sent: each has a field `<name>.<n>`, so that an empty
    one is there too.
    """
    return next((n for n in range(MOST_LISTED) if f"{name}.{n}" not in sent), MOST_LISTED)


def _numbered(cls: type[Any], n: int, document: Document) -> Document:
    return {"number": n, **document} if cls is Checkpoint else document


def _lines(text: str) -> str:
    return text.replace("\r\n", "\n").strip()


def _read_one(member: _Member, sent: Sent, name: str) -> Any:
    shape, text = member.shape, _lines(sent.get(name, ""))
    if isinstance(shape, inspect.BoolType):
        return name in sent
    if isinstance(shape, inspect.VarTupleType):
        if isinstance(shape.item_type, inspect.LiteralType | inspect.StrType):
            return [part for one in sent.getlist(name) for part in one.replace(",", " ").split()]
        return _points(text)
    if not text and (member.has_none or member.default is not None):
        return None if member.has_none else msgspec.UNSET
    if isinstance(shape, inspect.IntType | inspect.FloatType):
        return _number(text, whole=isinstance(shape, inspect.IntType))
    return text


def _number(text: str, *, whole: bool) -> int | float | str:
    try:
        value = int(text) if whole else float(text.replace(",", "."))
    except ValueError:
        return text
    return value if math.isfinite(value) else text


def _points(text: str) -> list[list[float]] | str:
    """Return the points of a text with one a line, "x y"; the text itself when a line is none."""
    found = [_point(line) for line in text.splitlines() if line.strip()]
    points = [point for point in found if point is not None]
    return points if len(points) == len(found) else text


def _point(line: str) -> list[float] | None:
    numbers = [_number(word, whole=False) for word in line.replace(";", " ").split()]
    x_and_y = [number for number in numbers if isinstance(number, float)]
    return x_and_y if len(x_and_y) == len(numbers) == 2 else None


# --- what cannot be kept --------------------------------------------------------------------------


def errors(
    cls: type[Any], document: Document, *, only: Collection[str] = (), prefix: str = ""
) -> dict[str, str]:
    """Return, by name of the field, what the classes refuse."""
    found: dict[str, str] = {}
    for member in members(cls, only):
        name, value = prefix + member.key, document.get(member.key, member.default)
        listed = _parts_of(member.shape)
        if isinstance(member.shape, inspect.StructType):
            found |= errors(member.shape.cls, value, prefix=f"{name}.") if value is not None else {}
        elif listed is not None:
            for n, inner in enumerate(value or ()):
                found |= errors(listed, inner, prefix=f"{name}.{n}.")
        elif (member.is_required or value != member.default) and (told := _refused(member, value)):
            found[name] = told
    return found


def _refused(member: _Member, value: Any) -> str:
    if isinstance(value, str):
        if _widget(member, ())[0] == "points":
            return "Write one point a line: x and y in metres."
        if isinstance(member.shape, inspect.IntType | inspect.FloatType):
            return "This is not a number." if value else "Write a number."
    try:
        msgspec.convert(value, member.type)
    except msgspec.ValidationError as error:
        return f"{error}."
    return ""


# --- lists ----------------------------------------------------------------------------------------


def change(values: list[Any], verb: str, n: int) -> list[Any]:
    """Return a list with its part number `n` (from 0) removed, copied, or moved up or down; the
    list itself where that makes no sense.
    """
    if not 0 <= n < len(values):
        return values
    rest = [*values[:n], *values[n + 1 :]]
    match verb:
        case "remove":
            return rest
        case "copy":
            return [*values[: n + 1], values[n], *values[n + 1 :]]
        case "up" | "down":
            place = n - 1 if verb == "up" else n + 1
            return [*rest[: max(place, 0)], values[n], *rest[max(place, 0) :]]
    return values


def renumber(course: Document) -> Document:
    """Return a course whose checkpoints are numbered as they stand, its photo staying with its
    checkpoint.
    """
    checkpoints, photo = course.get("checkpoints", []), course.get("photo")
    places = {checkpoint.get("number"): n for n, checkpoint in enumerate(checkpoints)}
    numbered = {
        **course,
        "checkpoints": [{**checkpoint, "number": n} for n, checkpoint in enumerate(checkpoints)],
    }
    return (
        {**numbered, "photo": {**photo, "checkpoint": places[photo["checkpoint"]]}}
        if photo and photo.get("checkpoint") in places
        else numbered
    )


def in_languages(cls: type[Any], document: Document, languages: Collection[str]) -> Document:
    """Return a document without the texts in other languages."""
    kept = dict(document)
    for key in document.keys() & {one.name for one in msgspec.structs.fields(cls)}:
        kept[key] = _in_languages(
            next(one for one in msgspec.structs.fields(cls) if one.name == key),
            document[key],
            languages,
        )
    return kept


def _in_languages(one: Any, value: Any, languages: Collection[str]) -> Any:
    if one.type == Text:
        return {language: text for language, text in value.items() if language in languages}
    shape = _member(one).shape
    if isinstance(shape, inspect.StructType) and value is not None:
        return in_languages(shape.cls, value, languages)
    inner = shape.item_type if isinstance(shape, inspect.VarTupleType) else None
    kinds = inner.types if isinstance(inner, inspect.UnionType) else [inner]
    classes = [kind for kind in kinds if isinstance(kind, inspect.StructType)]
    return (
        [in_languages(_class_of(classes, part), part, languages) for part in value]
        if classes
        else value
    )


def _class_of(classes: Sequence[inspect.StructType], part: Document) -> type[Any]:
    return next((kind.cls for kind in classes if kind.tag == part.get("kind")), classes[0].cls)


def new_point(at: str, default: Point) -> Point:
    """Return the point "x y" that a click on the map stands for; `default` when there was none."""
    points = _points(at)
    return (
        (points[0][0], points[0][1]) if isinstance(points, list) and len(points) == 1 else default
    )
