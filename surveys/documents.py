"""What questionnaires and studies share as JSON documents: texts in several languages, names, and
reading a document with every problem of it in a sentence.

A text is an object of languages, `{"en": "…", "es": "…"}`.
"""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import Annotated, TypeVar

import msgspec

Text = dict[str, str]
Key = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Slug = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9-]{0,39}$")]
Language = Annotated[str, msgspec.Meta(pattern=r"^[a-z]{2,3}(-[a-z0-9]{2,8})*$", max_length=16)]

T = TypeVar("T")

MAX_TEXT = 4000
# What msgspec says of a part whose `kind` no class has.
_UNKNOWN_KIND = re.compile(r"^Invalid value '(?P<kind>.*)' - at `(?P<path>\$.*)\.kind`$")


class DocumentPart(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True
):
    """Any part of a definition."""


class BadDefinitionError(ValueError):
    """A definition that cannot be used. `problems` has a sentence each."""

    def __init__(self, problems: list[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = problems


class ChangedMeanwhileError(RuntimeError):
    """Somebody else changed the draft, or put it to use, since it was read."""


def spoken(text: Mapping[str, str], language: str) -> str:
    """Return a text in a language, or in the first that it has; a definition has them all, a single
    label may be empty.
    """
    return text.get(language) or next(iter(text.values()), "")


def text_in(text: Mapping[str, str], languages: Iterable[str]) -> str:
    """Return a text in the first of these languages that has it; empty when none has."""
    return next((text[language] for language in languages if text.get(language)), "")


def checked(
    document: bytes,
    cls: type[T],
    problems_of: Callable[[T], Iterable[str]],
    *,
    limit: int,
    kinds: Collection[str],
    kind_name: str,
) -> T:
    """Return what a JSON document of at most `limit` bytes holds, when `problems_of` finds nothing
    wrong with it. `kinds` are the tags of its parts that come in several kinds, `kind_name` is what
    such a kind is called.

    Raises:
        BadDefinitionError: with every problem found; JSON or types that are wrong end the search at
            the first.
    """
    if len(document) > limit:
        raise BadDefinitionError([f"The file is larger than {limit // 1024} kB."])
    try:
        found = msgspec.json.decode(document, type=cls)
    except msgspec.ValidationError as error:
        raise BadDefinitionError([_sentence(str(error), kinds, kind_name)]) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadDefinitionError([f"This is not valid JSON: {error}."]) from error
    wrong = list(problems_of(found))
    if wrong:
        raise BadDefinitionError(wrong)
    return found


def _sentence(error: str, kinds: Collection[str], kind_name: str) -> str:
    unknown = _UNKNOWN_KIND.match(error)
    if unknown is None:
        return f"{error}."
    return (
        f"{unknown['path']}: there is no {kind_name} “{unknown['kind']}”; "
        f"choose one of {', '.join(sorted(kinds))}."
    )


def duplicates(what: str, names: Iterable[str]) -> Iterator[str]:
    """Yield a sentence for each name that stands more than once."""
    yield from (
        f"The {what} {name} appears {count} times."
        for name, count in Counter(names).items()
        if count > 1
    )


def text_problems(part: DocumentPart, where: str, languages: tuple[str, ...]) -> Iterator[str]:
    """Yield what is wrong with any text inside a part: each must be there in all of the languages
    and in no other.
    """
    for place, text, needed in _texts(part, where):
        if not needed and not any(text.values()):
            continue
        yield from (
            f"{place} has no text in {language}."
            for language in languages
            if not text.get(language, "").strip()
        )
        yield from (
            f"{place} has a text in {name}, which is not among the languages."
            for name in text
            if name not in languages
        )
        yield from (
            f"{place}: the text in {name} holds a null character."
            for name in text
            if "\x00" in text[name]
        )
        yield from (
            f"{place}: the text in {name} is longer than {MAX_TEXT} characters."
            for name in text
            if len(text[name]) > MAX_TEXT
        )


def _texts(part: DocumentPart, place: str) -> Iterator[tuple[str, Text, bool]]:
    """Yield (where, text, whether it must be there) for every text inside a part."""
    for field in msgspec.structs.fields(part):
        value = getattr(part, field.name)
        if field.type == Text:
            yield f"{place}.{field.encode_name}", value, field.required
        elif isinstance(value, DocumentPart):
            yield from _texts(value, f"{place}.{field.encode_name}")
        elif isinstance(value, tuple):
            for n, inner in enumerate(value):
                if isinstance(inner, DocumentPart):
                    yield from _texts(
                        inner, getattr(inner, "key", "") or f"{place}.{field.encode_name}[{n}]"
                    )
        elif isinstance(value, dict) and field.name == "scales":
            for name, points in value.items():
                for point in points:
                    yield from _texts(point, f"scale {name}, {point.value}")
