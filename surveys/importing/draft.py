"""The questionnaire that an importer builds: names that fit, texts in every language, pages, and
conditions on earlier answers.

Each question is checked by itself with the rules of surveys/problems.py, so that one that this site
cannot ask is reported with the reason and the others are imported.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar

import msgspec
from django.utils.translation import gettext as _

from surveys.definition import Definition, to_json
from surveys.document_forms.problem_text import sentences
from surveys.documents import MAX_TEXT, BadDefinitionError, Text
from surveys.importing.plain_text import PIPED, plain
from surveys.importing.report import ImportReport, Note, NotImportedError, clean, excerpt
from surveys.problems import MAX_BYTES, MAX_QUESTIONS, problems

MAX_KEY = 40
MAX_TITLE = 200
Item = dict[str, Any]
# A text of the file by language, as markup; languages without it are missing or empty.
Raw = Mapping[str, str]
Given = tuple[str, str]  # an answer in the file: the name of its question, and its code


def language_of(code: str) -> str:
    """Return the code here for a language of another system; "" when there can be none."""
    known = {"zh-s": "zh-hans", "zh-t": "zh-hant"}
    name = known.get(code.strip().lower(), code.strip().lower().replace("_", "-"))
    return name if re.fullmatch(r"[a-z]{2,3}(-[a-z0-9]{2,8})*", name) and len(name) <= 16 else ""


def number_in(value: Any) -> float | None:
    """Return a finite number of a file; None for anything else."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


class Draft:
    """Collects the questions of a file. `system` is its key in PIPED; the system shows line breaks
    of texts if `keeps_lines`. `languages` are codes here.
    """

    def __init__(
        self, system: str, label: str, languages: Sequence[str], *, keeps_lines: bool = False
    ) -> None:
        self.languages = tuple(languages)
        self.report = ImportReport(label)
        self.title: Text = {}
        self.intro: Text = {}
        self.source = ""
        self._keeps_lines = keeps_lines
        self._piped = PIPED[system]
        self._keys: set[str] = set()
        self._scales: dict[str, list[Item]] = {}
        self._pages: list[Item] = []
        self._introductions: list[Note] = []  # of the last page
        self._answers: dict[tuple[str, str], tuple[str, str | int]] = {}
        self._asked = 0

    def note(self, name: str, text: str = "") -> Note:
        note = Note(clean(name), excerpt(plain(text).text))
        self.report.notes.append(note)
        return note

    @contextmanager
    def trying(self, note: Note) -> Iterator[None]:
        """Leave out a question that cannot be asked here, with the reason, and free its names."""
        before = set(self._keys)
        try:
            yield
        except NotImportedError as error:
            self._keys = before
            note.left_out(str(error))

    def leave_out(self, name: str, reason: str, text: str = "") -> None:
        self.note(name, text).left_out(reason)

    def text(self, raw: Raw, note: Note, *, limit: int = MAX_TEXT) -> Text:
        """Return a text in every language, {} if none has it; losses are noted."""
        read = [plain(raw.get(one) or "", keeps_lines=self._keeps_lines) for one in self.languages]
        texts = {language: one.text for language, one in zip(self.languages, read, strict=True)}
        first = next((text for text in texts.values() if text), "")
        if lost := sorted({tag for one in read for tag in one.lost}):
            note.changed(_("Left out of the text: %(tags)s."), tags=", ".join(lost))
        if not first:
            return {}
        if lacking := ", ".join(language for language, text in texts.items() if not text):
            words = _("A text is missing in %(languages)s; the text in another language is used.")
            note.changed(words, languages=lacking)
        if any(map(self._piped.search, texts.values())):
            words = _("The text inserts an earlier answer or value, which is not filled in here.")
            note.changed(words)
        full = {language: text or first for language, text in texts.items()}
        return self.shortened(full, note, limit=limit)

    def shortened(self, text: Text, note: Note, *, limit: int = MAX_TEXT) -> Text:
        if any(len(one) > limit for one in text.values()):
            note.changed(_("A text is shortened to %(n)d characters."), n=limit)
        return {language: one[:limit] for language, one in text.items()}

    def same(self, text: str) -> Text:
        return dict.fromkeys(self.languages, text)

    def joined(self, *texts: Text, by: str = " – ") -> Text:
        full = [text for text in texts if text]
        languages = self.languages if full else ()
        return {language: by.join(text[language] for text in full) for language in languages}

    def key(self, wanted: str, note: Note) -> str:
        """Return an unused key like the name in the file."""
        base = re.sub(r"[^a-z0-9]+", "_", wanted.lower()).strip("_") or "question"
        base = base if base[0].isalpha() else f"q_{base}"
        key, number = base[:MAX_KEY].rstrip("_"), 1
        if len(base) > MAX_KEY:
            note.changed(_("Its name is shortened to “%(key)s”."), key=key)
        while key in self._keys:
            number += 1
            ending = f"_{number}"
            key = base[: MAX_KEY - len(ending)] + ending
        if number > 1:
            words = _("It is renamed to “%(key)s”, because another question has its name.")
            note.changed(words, key=key)
        self._keys.add(key)
        return key

    def scale(self, points: Iterable[tuple[int, Text]]) -> str:
        """Return the name of a scale with these points; equal scales are one."""
        wanted = [{"value": value, "label": label} for value, label in points]
        known = next((name for name, one in self._scales.items() if one == wanted), "")
        name = known or f"scale_{len(self._scales) + 1}"
        self._scales[name] = wanted
        return name

    def page(
        self, title: Text, intro: Text, show_if: Item | None = None, order: str = "fixed"
    ) -> None:
        """Begin a page. One without questions passes its introduction on."""
        title = {language: text[:MAX_TITLE] for language, text in title.items()}
        if self._pages and not self._pages[-1]["items"]:
            before = self._pages.pop()
            title = title or before["title"]
            intro = self.joined(before["intro"], intro, by="\n\n")
        else:
            self._introductions = []
        page: Item = {"title": title, "intro": intro, "show_if": show_if, "order": order}
        self._pages.append(page | {"items": []})

    def introduce(self, note: Note, text: Text) -> None:
        """Show a text as the introduction of the page; after questions, of a new page."""
        if not text:
            raise NotImportedError(_("It has no text."))
        page = self._pages[-1]
        if page["items"]:
            note.changed(_("It becomes the introduction of a new page."))
            self.page({}, {}, page["show_if"], page["order"])
            page = self._pages[-1]
        page["intro"] = self.shortened(self.joined(page["intro"], text, by="\n\n"), note)
        self._introductions.append(note)

    def ask(self, note: Note, items: Sequence[Item], show_if: Item | None = None) -> None:
        """Add the items of one question of the file, with its condition where they have none of
        their own. Raises NotImportedError for what this site cannot ask.
        """
        keys = [key for item in items for key in _keys_of(item)]
        if self._asked + len(keys) > MAX_QUESTIONS:
            words = _("A questionnaire has at most %(n)d questions.")
            raise NotImportedError(words % {"n": MAX_QUESTIONS})
        bare = [{name: value for name, value in one.items() if name != "show_if"} for one in items]
        try:
            self._checked("check", 1, [{"key": "page", "items": bare}], title=self.same("check"))
        except BadDefinitionError as error:
            raise NotImportedError(" ".join(sentences(error.problems))) from error
        self._asked += len(keys)
        self._pages[-1]["items"] += [{"show_if": show_if} | item for item in items]
        note.keys = keys

    def remember(self, name: str, key: str, values: Mapping[str, str | int]) -> None:
        """Map answers to the file's question `name`, by code, to `values` of a question here."""
        self._answers |= {(name.lower(), code): (key, value) for code, value in values.items()}

    def condition(self, note: Note, answers: Iterable[Given | None], remark: str) -> Item | None:
        """Return `show_if` for "one of these answers was given". Returns None and adds a remark for
        a None among them, and for answers to several questions, to one that is not asked before, or
        to one on the same shuffled page.
        """
        found = [one and self._answers.get((one[0].lower(), one[1])) for one in answers]
        known = [one for one in found if one]
        key = known[0][0] if known else ""
        is_shuffled = bool(self._pages) and self._pages[-1]["order"] == "shuffled"
        pages = self._pages[:-1] if is_shuffled else self._pages
        earlier = {key for page in pages for item in page["items"] for key in _keys_of(item)}
        is_one = len(known) == len(found) and {one[0] for one in known} == {key}
        if not is_one or key not in earlier:
            note.changed(remark)
            return None
        return {"item": key, "is": list(dict.fromkeys(value for _key, value in known))}

    def comparisons(
        self, note: Note, expression: str, joint: re.Pattern[str], comparison: re.Pattern[str]
    ) -> Item | None:
        """Return `show_if` for comparisons of one question with answers, joined by "or"; anything
        else is noted. `comparison` has the groups `name` and `answer`, which may be in quotes.
        """
        parts = (comparison.fullmatch(part.strip("() \t\r\n")) for part in joint.split(expression))
        answers = (one and (one["name"], one["answer"].strip("\"'")) for one in parts)
        remark = _("Its condition is not imported: it is shown to everybody (%(condition)s).")
        shown = {"condition": " ".join(expression.split())[:100]}
        return self.condition(note, answers, remark % shown)

    def finish(self) -> None:
        """Drop the last page when it has no question, and report its introduction."""
        reason = _("No question follows it. Here, a text always introduces a question.")
        if self._pages and not self._pages[-1]["items"]:
            self._pages.pop()
            for note in self._introductions:
                note.left_out(reason)

    def _checked(self, slug: str, version: int, pages: Sequence[Item], **more: Any) -> Definition:
        used = {item.get("scale") for page in pages for item in page["items"]}
        scales = {name: points for name, points in self._scales.items() if name in used}
        named = {"format": 1, "slug": slug, "version": version, "languages": self.languages}
        document = named | {"scales": scales, "pages": pages} | more
        try:
            definition = msgspec.convert(document, Definition)
        except msgspec.ValidationError as error:
            raise BadDefinitionError([str(error)]) from error
        if found := list(problems(definition)):
            raise BadDefinitionError(found)
        return definition

    def definition(self, slug: str, version: int) -> Definition:
        """Return the questionnaire under a name. Raises BadDefinitionError when nothing of the file
        could be imported, or too much.
        """
        if not self._pages:
            raise BadDefinitionError([_("None of the file's questions can be imported.")])
        pages = [{"key": f"page_{n}", **page} for n, page in enumerate(self._pages, start=1)]
        more = {"title": self.title or self.same(slug), "intro": self.intro, "source": self.source}
        definition = self._checked(slug, version, pages, **more)
        if len(to_json(definition)) > MAX_BYTES:
            words = _("The questionnaire is larger than %(n)d kB.") % {"n": MAX_BYTES // 1024}
            raise BadDefinitionError([words])
        return definition


def _keys_of(item: Item) -> list[str]:
    return [row["key"] for row in item.get("rows", ())] or [item["key"]]


class SurveyFormat:
    """A file and the draft that it becomes; each module of `surveys.importing.formats` has a
    subclass.

    `language` is that of texts whose language the file does not name, `form` the one form to import
    of a file with several (empty: all). Raises BadDefinitionError for a file that cannot be read.
    """

    label: ClassVar[str]  # product and file name extension, for people
    into: Draft

    def __init__(self, document: bytes, language: str, form: str) -> None:
        raise NotImplementedError

    @classmethod
    def is_in(cls, document: bytes) -> bool:
        """Tell from its start whether a file has this format."""
        raise NotImplementedError

    def convert(self) -> None:
        """Fill the draft."""
        raise NotImplementedError
