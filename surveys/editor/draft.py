"""Changes that the editor makes in place to a questionnaire, which is a plain document, as in JSON.
Keys are made here and stay, because answers are stored under them.
"""

import copy
import itertools
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
from msgspec import inspect

from surveys.definition import Definition, Page
from surveys.document_forms.fields import decimal_mark
from surveys.document_forms.parts import Document, change, in_languages, read_number
from surveys.documents import DocumentPart, ascii_name
from surveys.item import Question, ScalePoint
from surveys.questions import TYPES

ABOUT = ("title", "languages", "intro", "source", "licence", "template", "scoring", "topics")
LONGEST_STEM = 34  # of a key, before its number
_NUMBERED = re.compile(r"option_\d+")


class EditedScale(DocumentPart, frozen=True, kw_only=True):
    points: tuple[ScalePoint, ...]


@dataclass(frozen=True)
class EditorPlace:
    """The part that a form edits: "about" (the questionnaire), or one of "pages", "questions",
    "scales".
    """

    section: str
    key: str = ""

    @property
    def only(self) -> Collection[str]:
        return ABOUT if self.section == "about" else ()

    def cls(self, part: Document) -> type[Any]:
        if self.section == "questions":
            return TYPES[part["kind"]]
        return {"about": Definition, "pages": Page, "scales": EditedScale}[self.section]

    def part(self, whole: Document) -> Document | None:
        if self.section == "about":
            return whole
        if self.section == "scales":
            points = whole["scales"].get(self.key)
            return None if points is None else {"points": points}
        return next((parts[n] for parts, n in self.located(whole)), None)

    def put(self, whole: Document, part: Document) -> Document:
        if self.section == "about":
            languages = part["languages"]
            kept = {key: value for key, value in whole.items() if key not in ABOUT}
            scales = dict(whole["scales"])
            for name, points in scales.items():
                scales[name] = [in_languages(ScalePoint, point, languages) for point in points]
            return in_languages(Definition, kept | part, languages) | {"scales": scales}
        if self.section == "scales":
            whole["scales"][self.key] = part["points"]
        for parts, n in self.located(whole):
            kept = {key: parts[n][key] for key in ("kind", "items") if key in parts[n]}
            parts[n] = kept | part
        return whole

    def located(self, whole: Document) -> list[tuple[list[Document], int]]:
        """Return the list of a page or question with its place in it; nothing for others."""
        pages = whole["pages"]
        lists = {"pages": [pages], "questions": [page["items"] for page in pages]}
        known = ((parts, n) for parts in lists.get(self.section, ()) for n in range(len(parts)))
        return [(parts, n) for parts, n in known if parts[n]["key"] == self.key]


def keys_of(part: Document) -> list[str]:
    return [part["key"], *(row["key"] for row in part.get("rows", ()))]


def _parts(whole: Document) -> list[Document]:
    return [*whole["pages"], *(item for page in whole["pages"] for item in page["items"])]


def keys_in(whole: Document) -> set[str]:
    return {key for part in _parts(whole) for key in keys_of(part)}


def numbered(stem: str, taken: Collection[str]) -> str:
    keys = (f"{stem[:LONGEST_STEM]}{n}" for n in itertools.count(1))
    return next(key for key in keys if key not in taken)


def complete(part: Document, former: Document, whole: Document) -> Document:
    """Return a form's part with unique keys, to which conditions and topics then refer."""
    if "key" not in former:
        return part
    part["key"] = part.get("key") or former["key"]
    taken = keys_in(whole) - set(keys_of(former))
    for one in (part, *part.get("rows", ())):
        key = one.get("key", "")
        if not key or key in taken:
            one["key"] = numbered(f"{key or part['key']}_", taken)
        taken.add(one["key"])
    renamed = dict(zip(keys_of(former), keys_of(part), strict=False))
    for condition in filter(None, (one.get("show_if") for one in _parts(whole))):
        if condition.get("item") in renamed:
            condition["item"] = renamed[condition["item"]]
    for topic in whole["topics"]:
        topic["items"] = [renamed.get(key, key) for key in topic["items"]]
    values: set[str] = set()
    for option in part.get("options", ()):
        option["value"] = _option_value(option, values)
        values.add(option["value"])
    return part


def _option_value(option: Document, taken: Collection[str]) -> str:
    """Return the value of an option, made from its first label once it has one."""
    value = option.get("value", "")
    if value and value not in taken and not _NUMBERED.fullmatch(value):
        return str(value)
    label = next(filter(None, option.get("label", {}).values()), "")
    stem = ascii_name(label)[:LONGEST_STEM]
    wanted = stem or value
    return wanted if wanted and wanted not in taken else numbered(f"{stem or 'option'}_", taken)


def new_question(kind: str, scale: str, whole: Document) -> Document:
    """Return a question without texts, with two parts in each of its lists."""
    made: Document = {"kind": kind, "key": numbered("q", keys_in(whole))}
    for one in msgspec.structs.fields(TYPES[kind]):
        if one.required and one.name != "key":
            made[one.encode_name] = scale if one.name == "scale" else _blank(one)
    for name in [name for name, value in made.items() if value == []]:
        for _ in range(2):
            made[name].append(new_entry(TYPES[kind], name, made, whole))
    return made


def new_entry(cls: type[Any], name: str, part: Document, whole: Document) -> Document:
    """Return a new part for a list in a page, question or scale."""
    types = {one.name: one.type for one in msgspec.structs.fields(cls)}
    listed: Any = inspect.type_info(types[name])
    stem = f"{part['key']}_" if name == "rows" else f"{name.removesuffix('s')}_"
    made: Document = {}
    for one in (one for one in msgspec.structs.fields(listed.item_type.cls) if one.required):
        others, shape = [other.get(one.name) for other in part.get(name, [])], one.type
        if isinstance(inspect.type_info(shape), inspect.StrType):
            made[one.name] = numbered(stem, {*others, *keys_in(whole)})
        elif isinstance(inspect.type_info(shape), inspect.IntType):
            made[one.name] = max((n for n in others if isinstance(n, int)), default=0) + 1
        else:
            made[one.name] = _blank(one)
    return made


def _blank(field: Any) -> Any:
    return {} if isinstance(inspect.type_info(field.type), inspect.DictType) else []


def copied(original: Document, whole: Document) -> Document:
    copy_of, taken = copy.deepcopy(original), keys_in(whole)
    parts = [copy_of, *copy_of.get("items", ())]
    for one in [*parts, *(row for part in parts for row in part.get("rows", ()))]:
        one["key"] = numbered(re.sub(r"\d+$", "", one["key"]) or "q", taken)
        taken.add(one["key"])
    return copy_of


def arrange(whole: Document, verb: str, place: EditorPlace) -> None:
    """Move a page or question up or down, copy or remove it. From an end of its page, a question
    moves to the next page. The only page cannot be removed.
    """
    pages = whole["pages"]
    if place.section == "scales" and verb == "remove":
        whole["scales"].pop(place.key, None)
    if place.section == "pages" and verb == "remove" and len(pages) == 1:
        return
    for parts, n in place.located(whole):
        here = next((m for m, page in enumerate(pages) if page["items"] is parts), None)
        if here is not None and verb == "up" and n == 0 and here > 0:
            pages[here - 1]["items"].append(parts.pop(n))
        elif here is not None and verb == "down" and n == len(parts) - 1 and here < len(pages) - 1:
            pages[here + 1]["items"].insert(0, parts.pop(n))
        else:
            parts[:] = change(parts, verb, n)
            if verb == "copy":
                parts[n + 1] = copied(parts[n], whole)


def type_answers(
    condition: Document, former: Document | None, questions: Sequence[Question]
) -> None:
    """Convert answers in a condition to stored values; drop them when the question has changed."""
    asked = next((one for one in questions if one.key == condition.get("item")), None)
    if former is not None and former.get("item") != condition.get("item"):
        condition.pop("is", None)
    if asked is None or "is" not in condition:
        return
    stored = {str(value): value for value, _label in asked.labelled_values}
    is_number = asked.item.is_number and not stored
    condition["is"] = [
        read_number(text, whole=False, mark=decimal_mark()) if is_number else stored.get(text, text)
        for text in condition["is"]
    ]


def earlier(definition: Definition, place: EditorPlace) -> Iterator[Question]:
    """Yield the questions that a condition of a page or question may refer to."""
    for question in definition.questions():
        page = definition.pages[question.page]
        if place.key == (page.key if place.section == "pages" else question.item.key):
            return
        yield question
