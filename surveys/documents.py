"""JSON documents of questionnaires and studies: their texts, names and problems.

A text is an object of languages, `{"en": "…", "es": "…"}`.
"""

import functools
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Annotated, Any, TypeVar

import msgspec

Text = dict[str, str]
Path = tuple[str | int, ...]  # of names and places in a document
Key = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Slug = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9-]{0,39}$")]
Language = Annotated[str, msgspec.Meta(pattern=r"^[a-z]{2,3}(-[a-z0-9]{2,8})*$", max_length=16)]

T = TypeVar("T")


class MarkedText(str):
    """A text in English that pages translate (surveys/document_forms/problem_text.py)."""

    __slots__ = ()


gettext_noop = _ = MarkedText  # puts a text into the catalogue

MAX_TEXT = 4000
MOST_PROBLEMS = 100  # of a document are listed: one of 1 MB can have tens of thousands
# What msgspec says of a part whose `kind` no class has.
_UNKNOWN_KIND = re.compile(r"^Invalid value '(?P<kind>.*)' - at `(?P<path>\$.*)\.kind`$")

_NOT_A_LANGUAGE = _("%(text)s has a text in %(language)s, which is not among the languages.")
_NULL_CHARACTER = _("%(text)s: the text in %(language)s holds a null character.")
_TOO_LONG = _("%(text)s: the text in %(language)s is longer than %(n)d characters.")


class DocumentPart(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True
):
    """Any part of a definition."""


@functools.cache
def fields_of(kind: type[msgspec.Struct]) -> tuple[msgspec.structs.FieldInfo, ...]:
    """Return the fields of a class, cached: msgspec reads all annotations at each call."""
    return msgspec.structs.fields(kind)


@dataclass(frozen=True)
class ProblemPlace:
    """The place where a problem is corrected: a section of a document, or the part in it with a key
    or number (from 0). No section means no place in the document.
    """

    section: str = ""
    part: Any = None


NOWHERE = ProblemPlace()


@dataclass(frozen=True)
class Problem:
    """A problem of a document: a sentence, `words` filled in with `values`.

    It is corrected at `place`. `names` are those of the parts around it in the file, from the
    outside in, each of several words. `path` leads from the place to a text or a part in it;
    `language` is the one in which that text is missing.
    """

    words: str
    values: Mapping[str, Any] = field(default_factory=dict)
    place: ProblemPlace = NOWHERE
    names: tuple[tuple[Any, ...], ...] = ()
    path: Path = ()
    language: str = ""

    def __str__(self) -> str:
        """Return the sentence in English with the names around it, for files and commands."""
        return self.sentence(str)

    def sentence(self, translate: Callable[[str], str]) -> str:
        names = (" ".join(str(_in_words(one, translate)) for one in name) for name in self.names)
        return ": ".join([*names, self.text(translate)])

    def text(self, translate: Callable[[str], str]) -> str:
        """Return the sentence without names, for the page on which it is corrected."""
        words = str(_in_words(self.words, translate))
        values = {name: _in_words(value, translate) for name, value in self.values.items()}
        return words % values if values else words


def _in_words(one: Any, translate: Callable[[str], str]) -> Any:
    return translate(one) if isinstance(one, MarkedText) else one


def within(found: Iterable[Problem], place: ProblemPlace | None, *name: Any) -> Iterator[Problem]:
    """Yield a part's problems at `place` unless they have one, with a name around them, if any."""
    for one in found:
        here = place if place is not None and one.place == NOWHERE else one.place
        yield replace(one, place=here, names=(name, *one.names) if name else one.names)


class BadDefinitionError(ValueError):
    """A definition that cannot be used; `problems` are problems or sentences."""

    def __init__(self, problems: Iterable[Problem | str]) -> None:
        self.problems = list(problems)
        super().__init__("; ".join(map(str, self.problems)))


class ChangedMeanwhileError(RuntimeError):
    """Another user changed the draft, or put it to use, since it was read."""


def spoken(text: Mapping[str, str], language: str) -> str:
    """Return a text in a language, or in the first that it has; only labels may be empty."""
    return text.get(language) or next(iter(text.values()), "")


def text_in(text: Mapping[str, str], languages: Iterable[str]) -> str:
    """Return a text in the first of these languages that has it; empty when none has."""
    return next((text[language] for language in languages if text.get(language)), "")


def ascii_name(text: str, joint: str = "_") -> str:
    """Return a text in lower-case ASCII, with `joint` for all but letters and digits."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", joint, plain).strip(joint)


def checked(
    document: bytes,
    cls: type[T],
    problems_of: Callable[[T], Iterable[Problem]],
    *,
    limit: int,
    kinds: Collection[str],
    kind_name: str,
) -> T:
    """Return the content of a JSON document of at most `limit` bytes without problems. `kinds` are
    the tags of its parts that come in several kinds, `kind_name` is their name for people. Raises
    BadDefinitionError with the first hundred problems, or the only one of JSON or types.
    """
    if len(document) > limit:
        words = _("The file is larger than %(n)d kB.")
        raise BadDefinitionError([Problem(words, {"n": limit // 1024})])
    try:
        found = msgspec.json.decode(document, type=cls)
    except msgspec.ValidationError as error:
        problem = Problem(f"{error}.")
        if unknown := _UNKNOWN_KIND.match(str(error)):
            words = _("there is no %(what)s “%(kind)s”; choose one of %(kinds)s.")
            listed = {"what": kind_name, "kind": unknown["kind"], "kinds": ", ".join(sorted(kinds))}
            problem = Problem(words, listed, names=((unknown["path"],),))
        raise BadDefinitionError([problem]) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        words = _("This is not valid JSON: %(error)s.")
        raise BadDefinitionError([Problem(words, {"error": error})]) from error
    wrong = list(islice(problems_of(found), MOST_PROBLEMS + 1))
    if len(wrong) > MOST_PROBLEMS:
        wrong[-1] = Problem(_("Only the first %(n)d problems are listed."), {"n": MOST_PROBLEMS})
    if wrong:
        raise BadDefinitionError(wrong)
    return found


def duplicates(what: str, names: Iterable[str]) -> Iterator[Problem]:
    """Yield a problem for each name of a `what` that occurs more than once."""
    for name, count in Counter(names).items():
        if count > 1:
            words = _("%(what)s “%(name)s” appears %(n)d times.")
            yield Problem(words, {"what": what, "name": name, "n": count})


def text_problems(part: DocumentPart, name: str, languages: tuple[str, ...]) -> Iterator[Problem]:
    """Yield problems of the texts in a part: each must be in all of the languages and in no other.
    Paths start at the part.
    """
    for called, path, text, needed in _texts(part, name, ()):
        if not needed and not any(text.values()):
            continue
        for language in languages:
            if not text.get(language, "").strip():
                words = _("%(text)s has no text in %(language)s.")
                named = {"text": called, "language": language}
                yield Problem(words, named, path=path, language=language)
        for language, own in text.items():
            values = {"text": called, "language": language, "n": MAX_TEXT}
            if language not in languages:
                yield Problem(_NOT_A_LANGUAGE, values)
            if "\x00" in own:
                yield Problem(_NULL_CHARACTER, values)
            if len(own) > MAX_TEXT:
                yield Problem(_TOO_LONG, values)


def _texts(part: DocumentPart, name: str, path: Path) -> Iterator[tuple[str, Path, Text, bool]]:
    """Yield name (a key, if there is one), path, text and whether it is required for each text."""
    for one in fields_of(type(part)):
        value, key = getattr(part, one.name), one.encode_name
        called, here = f"{name}.{key}", (*path, key)
        if one.type == Text:
            yield called, here, value, one.required
        elif isinstance(value, DocumentPart):
            yield from _texts(value, called, here)
        elif isinstance(value, tuple):
            for n, inner in enumerate(value):
                if isinstance(inner, DocumentPart):
                    own = getattr(inner, "key", "") or f"{called}[{n}]"
                    yield from _texts(inner, own, (*here, n))
        elif isinstance(value, dict) and one.name == "scales":
            for scale, points in value.items():
                for n, point in enumerate(points):
                    yield from _texts(point, f"scale {scale}, {point.value}", (*here, scale, n))
