"""A questionnaire while it is taken from a file of another system: names that fit, texts in every
language, pages, and conditions on earlier answers.

Each question is checked by itself with the rules of surveys/problems.py, so that one that cannot be
asked here is listed with the reason and the others are imported.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

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


@dataclass
class _Page:
    title: Text
    intro: Text
    show_if: dict[str, Any] | None
    is_shuffled: bool
    items: list[Item] = field(default_factory=list)
    said: list[Note] = field(default_factory=list)


def language_of(code: str) -> str:
    """Return a language of another system as it is named here, "" for one that cannot be."""
    known = {"zh-s": "zh-hans", "zh-t": "zh-hant"}
    name = known.get(code.strip().lower(), code.strip().lower().replace("_", "-"))
    return name if re.fullmatch(r"[a-z]{2,3}(-[a-z0-9]{2,8})*", name) and len(name) <= 16 else ""


class Draft:
    """Collects what a file asks.

    Args:
        system: the product, as PIPED names it.
        label: the product's name for people.
        languages: as they are named here; the first is that of texts that others lack.
        keeps_lines: the system shows line breaks of its texts.
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
        self._scales: dict[str, list[dict[str, Any]]] = {}
        self._pages: list[_Page] = []
        self._answers: dict[tuple[str, str], tuple[str, str | int]] = {}
        self._asked = 0

    # what is reported

    def note(self, name: str, text: str = "") -> Note:
        """Return a new line of the report."""
        note = Note(clean(name), excerpt(plain(text).text))
        self.report.notes.append(note)
        return note

    @contextmanager
    def trying(self, note: Note) -> Iterator[None]:
        """Take a question of the file; one that cannot be asked here is left out with the reason,
        and its names are free again.
        """
        before = set(self._keys)
        try:
            yield
        except NotImportedError as error:
            self._keys = before
            note.left_out(str(error))

    def leave_out(self, name: str, reason: str, text: str = "") -> None:
        """Report a part of the file that is not imported."""
        self.note(name, text).left_out(reason)

    # texts

    def text(self, raw: Raw, note: Note, *, limit: int = MAX_TEXT) -> Text:
        """Return a text in every language, {} if the first language has none. What a reader of the
        file would miss is noted.
        """
        read = {
            language: plain(raw.get(language) or "", keeps_lines=self._keeps_lines)
            for language in self.languages
        }
        texts = {language: one.text for language, one in read.items()}
        first = texts[self.languages[0]] or next((text for text in texts.values() if text), "")
        lost = sorted({tag for one in read.values() for tag in one.lost})
        if lost:
            note.changed(_("Left out of the text: %(tags)s.") % {"tags": ", ".join(lost)})
        if not first:
            return {}
        lacking = [language for language, text in texts.items() if not text]
        if lacking:
            note.changed(
                _("A text is missing in %(languages)s; the text in another language is used.")
                % {"languages": ", ".join(lacking)}
            )
        full = {language: text or first for language, text in texts.items()}
        if any(self._piped.search(text) for text in full.values()):
            note.changed(
                _("The text inserts an earlier answer or value, which is not filled in here.")
            )
        return self.shortened(full, note, limit=limit)

    def shortened(self, text: Text, note: Note, *, limit: int = MAX_TEXT) -> Text:
        """Return a text that is not too long."""
        if any(len(one) > limit for one in text.values()):
            note.changed(_("A text is shortened to %(n)d characters.") % {"n": limit})
        return {language: one[:limit] for language, one in text.items()}

    def same(self, text: str) -> Text:
        """Return a text that is the same in every language."""
        return dict.fromkeys(self.languages, text)

    def joined(self, *texts: Text, by: str) -> Text:
        """Return several texts as one; empty ones are left out."""
        full = [text for text in texts if text]
        return {lang: by.join(text[lang] for text in full) for lang in self.languages if full}

    # names

    def key(self, wanted: str, note: Note) -> str:
        """Return a key like the name in the file that no other question has."""
        base = re.sub(r"[^a-z0-9]+", "_", wanted.lower()).strip("_") or "question"
        base = base if base[0].isalpha() else f"q_{base}"
        key, number = base[:MAX_KEY].rstrip("_"), 1
        if len(base) > MAX_KEY:
            note.changed(_("Its name is shortened to “%(key)s”.") % {"key": key})
        while key in self._keys:
            number += 1
            ending = f"_{number}"
            key = base[: MAX_KEY - len(ending)] + ending
        if number > 1:
            note.changed(
                _("It is renamed to “%(key)s”, because another question has its name.")
                % {"key": key}
            )
        self._keys.add(key)
        return key

    def scale(self, points: Sequence[tuple[int, Text]]) -> str:
        """Return the name of a scale with these points; equal scales are one."""
        wanted = [
            {"value": value, "label": label} if label else {"value": value}
            for value, label in points
        ]
        for name, known in self._scales.items():
            if known == wanted:
                return name
        name = f"scale_{len(self._scales) + 1}"
        self._scales[name] = wanted
        return name

    # pages

    def page(
        self,
        title: Text | None = None,
        intro: Text | None = None,
        show_if: dict[str, Any] | None = None,
        *,
        is_shuffled: bool = False,
    ) -> None:
        """Begin a page. One that stayed without questions hands its introduction on."""
        before = self._pages[-1] if self._pages else None
        page = _Page(title or {}, intro or {}, show_if, is_shuffled)
        if before is not None and not before.items:
            page.title = page.title or before.title
            page.intro = self.joined(before.intro, page.intro, by="\n\n")
            page.said = before.said
            self._pages.pop()
        self._pages.append(page)

    def say(self, note: Note, text: Text) -> None:
        """Show a text without a question: as the introduction of a page, which begins here when the
        page has questions already.
        """
        if not text:
            raise NotImportedError(_("It has no text."))
        page = self._pages[-1]
        if page.items:
            note.changed(_("It becomes the introduction of a new page."))
            self.page({}, {}, page.show_if, is_shuffled=page.is_shuffled)
            page = self._pages[-1]
        page.intro = self.shortened(self.joined(page.intro, text, by="\n\n"), note)
        page.said.append(note)

    # questions

    def ask(self, note: Note, items: Sequence[Item]) -> None:
        """Add the items of one question of the file.

        Raises:
            NotImportedError: this site cannot ask them.
        """
        asked = sum(len(item.get("rows", (item,))) for item in items)
        if self._asked + asked > MAX_QUESTIONS:
            raise NotImportedError(
                _("A questionnaire has at most %(n)d questions.") % {"n": MAX_QUESTIONS}
            )
        self._check(items)
        self._asked += asked
        self._pages[-1].items.extend(items)
        note.keys = [key for item in items for key in _keys_of(item)]

    def _check(self, items: Sequence[Item]) -> None:
        """Ask the rules of questionnaires about a question by itself, without its conditions."""
        bare = [
            {name: value for name, value in item.items() if name != "show_if"} for item in items
        ]
        used = {item["scale"]: self._scales[item["scale"]] for item in items if "scale" in item}
        document = {
            **self._frame("check", 1),
            "title": self.same("check"),
            "scales": used,
            "pages": [{"key": "page", "items": bare}],
        }
        try:
            found = sentences(problems(msgspec.convert(document, Definition)))
        except msgspec.ValidationError as error:
            found = [str(error)]
        if found:
            raise NotImportedError(" ".join(found))

    # conditions

    def remember(self, name: str, code: str, key: str, value: str | int) -> None:
        """Keep where an answer of the file is asked here: code `code` of its question `name`."""
        self._answers[name, code] = (key, value)

    def condition(self, alternatives: Iterable[tuple[str, str]]) -> dict[str, Any] | None:
        """Return `show_if` for "one of these answers was given", None when it cannot be said: of
        several questions, of one that is not asked before, or of one on the same shuffled page.
        """
        found = [self._answers.get(one) for one in alternatives]
        known = [one for one in found if one is not None]
        if not known or len(known) < len(found) or len({key for key, _value in known}) != 1:
            return None
        key = known[0][0]
        here = self._pages[-1] if self._pages else None
        if here is not None and here.is_shuffled and key in _keys_in(here.items):
            return None
        if not any(key in _keys_in(page.items) for page in self._pages):
            return None
        return {"item": key, "is": list(dict.fromkeys(value for _key, value in known))}

    # the whole

    def _frame(self, slug: str, version: int) -> dict[str, Any]:
        return {
            "format": 1,
            "slug": slug,
            "version": version,
            "languages": list(self.languages),
        }

    def finish(self) -> None:
        """End the last page; what it says without a question is reported."""
        if self._pages and not self._pages[-1].items:
            for note in self._pages.pop().said:
                note.left_out(
                    _("No question follows it. Here, a text always introduces a question.")
                )

    def definition(self, slug: str, version: int) -> Definition:
        """Return the questionnaire under a name.

        Raises:
            BadDefinitionError: nothing of the file could be imported, or too much.
        """
        if not self._pages:
            raise BadDefinitionError([_("None of the file's questions can be imported.")])
        used = {item.get("scale") for page in self._pages for item in page.items}
        document = {
            **self._frame(slug, version),
            "title": self.title or self.same(slug),
            "intro": self.intro,
            "source": self.source,
            "scales": {name: points for name, points in self._scales.items() if name in used},
            "pages": [_page(page, number) for number, page in enumerate(self._pages, start=1)],
        }
        try:
            definition = msgspec.convert(document, Definition)
        except msgspec.ValidationError as error:
            raise BadDefinitionError([f"{error}."]) from error
        if found := list(problems(definition)):
            raise BadDefinitionError(found)
        if len(to_json(definition)) > MAX_BYTES:
            raise BadDefinitionError(
                [_("The questionnaire is larger than %(n)d kB.") % {"n": MAX_BYTES // 1024}]
            )
        return definition


def _keys_of(item: Item) -> list[str]:
    return [row["key"] for row in item.get("rows", ())] or [item["key"]]


def _keys_in(items: Iterable[Item]) -> set[str]:
    return {key for item in items for key in _keys_of(item)}


def _page(page: _Page, number: int) -> dict[str, Any]:
    written: dict[str, Any] = {"key": f"page_{number}", "items": page.items}
    if page.title:
        written["title"] = {lang: text[:MAX_TITLE] for lang, text in page.title.items()}
    if page.intro:
        written["intro"] = page.intro
    if page.show_if:
        written["show_if"] = page.show_if
    if page.is_shuffled:
        written["order"] = "shuffled"
    return written
