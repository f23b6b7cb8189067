"""The conversion of a question that all formats share."""

import re
import tomllib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar

from django.utils.translation import gettext as _

from surveys.documents import Text
from surveys.importing.draft import Draft, Item, number_in
from surveys.importing.report import Note, NotImportedError
from surveys.problems import MAX_POINTS, MIN_POINTS

WORDS = tomllib.loads(Path(__file__).with_name("words.toml").read_text(encoding="utf-8"))
# Answers that become reasons for not answering, by the field of an item that offers them.
_REASONS = {
    "not_applicable": re.compile(
        r"n\s*/?\s*a|(not|non) applicable|does not apply|no aplica|no procede|nicht zutreffend|"
        r"trifft nicht zu|sans objet",
        re.IGNORECASE,
    ),
    "prefer_not": re.compile(
        r"(i )?(prefer|would rather|choose|decline)( not)? to (say|answer|respond)|"
        r"prefiero no (contestar|responder|decirlo)|keine angabe|ne souhaite pas répondre",
        re.IGNORECASE,
    ),
}
MAX_TEXT_LENGTH = 5000  # of a free text here
OTHER_LENGTH = 200


def values_of(options: Mapping[str, Item]) -> dict[str, str]:
    return {code: option["value"] for code, option in options.items()}


class ImportedQuestion:
    """A question with a `name` and a `kind` in the file. Each format has a subclass."""

    # The conversion of each kind.
    TYPES: ClassVar[Mapping[str, Callable[[Any], list[Item]]]]

    def __init__(self, draft: Draft, note: Note, name: str, kind: str) -> None:
        self.draft, self.note, self.name, self.kind = draft, note, name, kind

    def text(self) -> Text:
        raise NotImplementedError

    def common(self) -> Item:
        """Return the fields of each of its items, such as `required`."""
        raise NotImplementedError

    def items(self) -> list[Item]:
        """Return the items that it becomes; raises NotImportedError when it becomes none."""
        if self.kind not in self.TYPES:
            raise self.not_supported(self.kind)
        return self.TYPES[self.kind](self)

    def not_supported(self, kind: str) -> NotImportedError:
        words = _("Questions of the type %(kind)s are not supported.")
        return NotImportedError(words % {"kind": kind})

    def note_reversal(self, text: str) -> None:
        if re.search(r"\brevers(e|ed)\b|\binvert(ed|ido|ida)\b|\bumgepolt\b", text, re.IGNORECASE):
            words = _("It is reverse-scored in the file. If a score uses it, add reverse: %(text)s")
            self.note.changed(words, text=text.strip())

    def unchecked(self, rule: str) -> None:
        self.note.changed(_("Its rule %(rule)s is not checked."), rule=rule)

    def number_bound(self, name: str, value: str) -> float | None:
        number = number_in(value.strip().replace(",", "."))
        if value.strip() and number is None:
            self.unchecked(f"{name} = {value.strip()[:60]}")
        return number

    def date_bound(self, name: str, value: str) -> str | None:
        """Return a bound of a date without its time; another value is noted."""
        value = value.strip("\"' ").lower()
        if value in {"today", "now"}:
            return "today"
        if found := re.match(r"\d{4}-\d{2}-\d{2}(?!\d)", value):
            return found[0]
        if value:
            self.unchecked(f"{name} = {value[:60]}")
        return None

    def or_name(self, text: Text) -> Text:
        if not text:
            self.note.changed(_("It has no text; its name is shown."))
        return text or self.draft.same(self.name)

    def word(self, name: str) -> Text:
        known = WORDS[name]
        lacking = [one for one in self.draft.languages if one.split("-")[0] not in known]
        if lacking:
            words = _("The file has no text for the answer “%(word)s” in %(languages)s; add it.")
            self.note.changed(words, word=known["en"], languages=", ".join(lacking))
        return {one: known.get(one.split("-")[0], known["en"]) for one in self.draft.languages}

    def key(self, *endings: str) -> str:
        return self.draft.key("_".join((self.name, *endings)), self.note)

    def item(self, kind: str, key: str | None = None, **fields: Any) -> Item:
        own = key or self.key()
        return {"kind": kind, "key": own, "text": self.text(), **self.common(), **fields}

    def apart(self, remark: str, parts: Iterable[tuple[str, Text, Item]]) -> list[Item]:
        """Return an item for each part of the question (key, label and fields)."""
        if remark:
            self.note.changed(remark)
        text, common, join = self.text(), self.common(), self.draft.joined
        return [{"key": key, "text": join(text, label)} | common | own for key, label, own in parts]

    def length(self, most: float | None, *, is_line: bool) -> int:
        """Return the maximum length of a text: that of the file where it is possible here."""
        usual = 1000 if is_line else MAX_TEXT_LENGTH
        return int(most) if most is not None and 1 <= most <= MAX_TEXT_LENGTH else usual

    def slider(self, least: int, most: int, low: Text, high: Text, step: int = 1) -> Item:
        """Return the fields of a slider; the number is the label of an end without one."""
        low, high = low or self.draft.same(str(least)), high or self.draft.same(str(most))
        ends = {"minimum": least, "maximum": most, "low": low, "high": high}
        return {"kind": "slider", **ends, "step": step}

    def options(self, labels: Mapping[str, Text], alone: Collection[str] = ()) -> dict[str, Item]:
        """Return options by the codes of the file; those without a label are left out."""
        values = self._option_values(list(labels))
        if lost := ", ".join(code for code, label in labels.items() if not label):
            self.note.changed(_("Options without a text are not imported: %(codes)s."), codes=lost)
        named = {code: {"value": values[code], "label": label} for code, label in labels.items()}
        return {code: one | {"alone": code in alone} for code, one in named.items() if one["label"]}

    def _option_values(self, codes: Sequence[str]) -> dict[str, str]:
        values: dict[str, str] = {}
        taken: set[str] = set()  # a file can have tens of thousands of options
        numbers: Counter[str] = Counter()
        for code in codes:
            bare = code.strip().lower()
            bare = f"minus_{bare[1:]}" if bare.startswith("-") else bare
            base = re.sub(r"[^a-z0-9_-]+", "_", bare).strip("_-")[:36] or "option"
            value = base
            while value in taken:
                numbers[base] += 1
                value = f"{base}_{numbers[base] + 1}"
            values[code] = value
            taken.add(value)
        renamed = [f"{one} → {new}" for one, new in values.items() if new != one.strip().lower()]
        if renamed:
            words = _("These codes are stored in a different form: %(codes)s.")
            self.note.changed(words, codes=", ".join(renamed))
        return values

    def other(self, key: str, option: Item) -> Item:
        """Return the question for the text beside an option of the question with a key."""
        value, label = option["value"], option["label"]
        words = _(
            "The text for “%(option)s” becomes a separate question, shown when that option is "
            "chosen."
        )
        self.note.changed(words, option=label[self.draft.languages[0]])
        own = self.draft.key(f"{key}_{value}_text", self.note)
        more = {"text": label, "max_length": OTHER_LENGTH, "show_if": {"item": key, "is": [value]}}
        return {"kind": "text", "key": own, **more}

    def numbered(self, numbers: Sequence[int], low: Text, high: Text) -> str:
        """Return the name of a scale; the number is the label of an end without one."""
        ends = {numbers[0]: low, numbers[-1]: high} if numbers else {}
        points = ((n, ends[n] or self.draft.same(str(n)) if n in ends else {}) for n in numbers)
        return self.draft.scale(points)

    def scale(
        self, labels: Mapping[str, Text], codes: Mapping[str, str] | None = None
    ) -> tuple[str, dict[str, int], dict[str, bool]]:
        """Return the scale of a grid: its name, its values by answer, and the reasons for not
        answering (`not_applicable`, `prefer_not`). `labels` are by answer in the order shown; an
        answer without one of the `codes` is its own.
        """
        reasons: dict[str, bool] = {}
        kept = dict(labels)
        remark = _("“%(label)s” becomes a reason for not answering, not a point of the scale.")
        for name, pattern in _REASONS.items():
            for answer, label in list(kept.items()):
                words = (text.strip(" .()") for text in label.values())
                if len(kept) > MIN_POINTS and any(pattern.fullmatch(one) for one in words):
                    reasons[name] = True
                    del kept[answer]
                    self.note.changed(remark, label=label[self.draft.languages[0]])
        values = self._scale_values({answer: (codes or {}).get(answer, answer) for answer in kept})
        points = [(values[answer], label) for answer, label in kept.items()]
        if MIN_POINTS <= len(points) <= MAX_POINTS:
            for n in (0, -1):
                value, label = points[n]
                points[n] = (value, label or self.draft.same(str(value)))
        return self.draft.scale(points), values, reasons

    def _scale_values(self, codes: Mapping[str, str]) -> dict[str, int]:
        """Return the codes of a scale as numbers where these increase, else 1, 2 and so on."""
        numbers: list[int] = []
        with suppress(ValueError):
            numbers = [int(code) for code in codes.values()]
        if len(numbers) == len(codes) and numbers == sorted(set(numbers)):
            return dict(zip(codes, numbers, strict=True))
        values = {answer: n for n, answer in enumerate(codes, start=1)}
        stored = ", ".join(f"{codes[answer]} → {value}" for answer, value in values.items())
        words = _("The values of a scale must increase, so they are stored as %(codes)s.")
        self.note.changed(words, codes=stored)
        if len(numbers) == len(codes) > 1 and numbers == sorted(set(numbers), reverse=True):
            words = _("The file scores this scale in reverse. Reverse it when you score it.")
            self.note.changed(words)
        return values
