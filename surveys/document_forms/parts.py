"""The fields of definition classes for forms, and changes of documents of these classes: plain
dicts and lists, as in JSON.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, cast, get_args, get_origin

import msgspec
from msgspec import inspect

from surveys.document_forms.guide import FormGuide
from surveys.documents import Text, fields_of

Document = dict[str, Any]


@dataclass(frozen=True)
class AskedField:
    guide: FormGuide
    key: str
    annotation: Any
    shape: inspect.Type  # without None
    has_none: bool  # whether it may be None
    default: Any
    is_required: bool
    kinds: Mapping[str, type[Any]]  # classes of a part by tag, if there are several
    called: str  # `Class.key`, its name in the guide

    @property
    def part(self) -> type[Any] | None:
        return self.shape.cls if isinstance(self.shape, inspect.StructType) else None

    @property
    def listed(self) -> type[Any] | None:
        inner = self.shape.item_type if isinstance(self.shape, inspect.VarTupleType) else None
        return inner.cls if isinstance(inner, inspect.StructType) else None


def members(
    guide: FormGuide, cls: type[msgspec.Struct], only: Collection[str] = ()
) -> list[AskedField]:
    shown = (one for one in fields_of(cls) if not guide.is_hidden(cls, one.name))
    found = [_member(guide, one, cls) for one in shown if not only or one.encode_name in only]
    return sorted(found, key=lambda one: one.key in guide.last)


def _member(guide: FormGuide, one: Any, cls: type[Any]) -> AskedField:
    shape = inspect.type_info(one.type)
    inner = _inner(shape)
    default = None if one.default is msgspec.NODEFAULT else msgspec.to_builtins(one.default)
    has_none = isinstance(shape, inspect.UnionType) and len(inner) < len(shape.types)
    kinds = {str(kind.tag): kind.cls for kind in inner if isinstance(kind, inspect.StructType)}
    several = kinds if len(kinds) > 1 else {}
    named = (guide, one.encode_name, one.type, inner[0])
    called = f"{cls.__name__}.{one.name}"
    return AskedField(*named, has_none, default, one.required, several, called)


def _inner(shape: inspect.Type) -> list[inspect.Type]:
    kinds = shape.types if isinstance(shape, inspect.UnionType) else (shape,)
    return [kind for kind in kinds if not isinstance(kind, inspect.NoneType)]


def choices_of(member: AskedField) -> tuple[str, ...]:
    """Return the values of a Literal or of a list of them, in written order; else none."""
    inner = getattr(member.shape, "item_type", member.shape)
    return tuple(literals(member.annotation)) if isinstance(inner, inspect.LiteralType) else ()


def literals(annotation: Any) -> Iterator[str]:
    """Yield the texts of each Literal in an annotation; `msgspec.inspect` would sort them."""
    for one in get_args(annotation):
        if get_origin(one) is not None:
            yield from literals(one)
        elif isinstance(one, str):
            yield one


def is_numbered(member: AskedField) -> bool:
    cls = member.listed
    return cls is not None and "number" in member.guide.hidden.get(cls, ())


def read_number(text: str, *, whole: bool, mark: str = ".") -> int | float | str:
    """Return the finite number in a text, else the text; `mark` is a second decimal mark."""
    try:
        value = int(text) if whole else float(text.replace(mark, "."))
    except ValueError:
        return text
    return value if math.isfinite(value) else text


def read_points(text: str, mark: str = ".") -> list[list[float]] | str:
    """Return the points of a text with one a line, "x y"; the text itself when it has others."""
    lines = [line.replace(";", " ").split() for line in text.splitlines() if line.strip()]
    points = [[read_number(word, whole=False, mark=mark) for word in line] for line in lines]
    are_points = all(len(one) == 2 and all(isinstance(n, float) for n in one) for one in points)
    return cast("list[list[float]]", points) if are_points else text


def change(values: list[Any], verb: str, n: int) -> list[Any]:
    """Return a copy of a list with part `n` (from 0) removed, copied or moved, where possible."""
    changed = list(values)
    match verb if 0 <= n < len(values) else "":
        case "remove":
            del changed[n]
        case "copy":
            changed.insert(n + 1, values[n])
        case "up":
            changed.insert(max(n - 1, 0), changed.pop(n))
        case "down":
            changed.insert(n + 1, changed.pop(n))
    return changed


def in_languages(
    cls: type[msgspec.Struct], document: Document, languages: Collection[str]
) -> Document:
    fields = {one.encode_name: one for one in fields_of(cls)}
    known = {key: value for key, value in document.items() if key in fields}
    return document | {k: _in_languages(fields[k], one, languages) for k, one in known.items()}


def _in_languages(one: Any, value: Any, languages: Collection[str]) -> Any:
    if one.type == Text:
        return {language: text for language, text in value.items() if language in languages}
    shape = _inner(inspect.type_info(one.type))[0]
    if isinstance(shape, inspect.StructType) and value is not None:
        return in_languages(shape.cls, value, languages)
    kinds = _inner(shape.item_type) if isinstance(shape, inspect.VarTupleType) else []
    classes = {kind.tag: kind.cls for kind in kinds if isinstance(kind, inspect.StructType)}
    if not classes:
        return value
    usual = next(iter(classes.values()))
    return [in_languages(classes.get(one.get("kind"), usual), one, languages) for one in value]
