"""A question of a Qualtrics file with its texts in all languages, and what its kinds share."""

from collections.abc import Iterator, Mapping
from typing import Any

from django.utils.translation import gettext as _

from surveys.documents import Text
from surveys.importing.draft import Draft, Raw, language_of
from surveys.importing.report import Note

Payload = Mapping[str, Any]


class QualtricsConversion:
    """One question of the file with its texts in all languages."""

    def __init__(self, draft: Draft, note: Note, payload: Payload) -> None:
        self.draft = draft
        self.note = note
        self.payload = payload
        self.kind = str(payload.get("QuestionType") or "")
        self.selector = str(payload.get("Selector") or "")
        self.sub_selector = str(payload.get("SubSelector") or "")
        self.name = str(payload.get("DataExportTag") or payload.get("QuestionID") or "question")
        self.id = str(payload.get("QuestionID") or "")
        self.settings: Payload = mapping(mapping(payload.get("Validation")).get("Settings"))
        self.configuration: Payload = mapping(payload.get("Configuration"))
        self._translations = {
            language_of(code): mapping(one)
            for code, one in mapping(payload.get("Language")).items()
        }

    def raw(self, field: str) -> Raw:
        """Return a text of the question by language."""
        first = {self.draft.languages[0]: str(self.payload.get(field) or "")}
        return first | {
            lang: str(one.get(field) or "")
            for lang, one in self._translations.items()
            if lang != self.draft.languages[0]
        }

    def text(self) -> Text:
        """Return the question; its name where it has none."""
        text = self.draft.text(self.raw("QuestionText"), self.note)
        if not text:
            self.note.changed(_("It has no text; its name is shown."))
        return text or self.draft.same(self.name)

    def labels(self, part: str = "Choices", order: str = "ChoiceOrder") -> dict[str, Text]:
        """Return the labels of the choices or answers by their ids, in the order shown."""
        own = by_id(self.payload.get(part))
        others = {
            lang: by_id(one.get(part))
            for lang, one in self._translations.items()
            if lang != self.draft.languages[0]
        }
        first = self.draft.languages[0]
        return {
            one: self.draft.text(
                {first: _display(own[one])}
                | {lang: _display(texts.get(one)) for lang, texts in others.items()},
                self.note,
            )
            for one in _ordered(own, self.payload.get(order))
        }

    def codes(self, labels: Mapping[str, Text]) -> dict[str, str]:
        """Return what Qualtrics stores for each choice: its recode value, else its id."""
        recoded = mapping(self.payload.get("RecodeValues"))
        return {one: str(recoded.get(one, one)) for one in labels}

    @property
    def is_required(self) -> bool:
        """Whether an answer is forced; one that is only requested is noted."""
        wish = self.settings.get("ForceResponse")
        kinds = (wish, self.settings.get("ForceResponseType"))
        if "RequestResponse" in kinds and wish != "OFF":
            self.note.changed(_("The file requests an answer; here it is optional."))
            return False
        return wish == "ON"

    def order(self) -> str:
        """Return the order of the choices."""
        wanted = mapping(self.payload.get("Randomization"))
        if wanted.get("Type") == "All":
            return "shuffled"
        if str(wanted.get("Type")) in {"Advanced", "Subset", "ScaleReversal"}:
            self.note.changed(_("Its random order with rules is replaced by a fixed order."))
        return ""


# --- reading --------------------------------------------------------------------------------------


def mapping(value: Any) -> dict[str, Any]:
    """Return an object of the file; PHP writes an empty one as a list."""
    return value if isinstance(value, dict) else {}


def by_id(value: Any) -> dict[str, Any]:
    """Return choices by id: an object, or a list whose places are the ids."""
    if isinstance(value, list):
        return {str(n): one for n, one in enumerate(value)}
    return mapping(value)


def _display(choice: Any) -> str:
    return str(mapping(choice).get("Display") or "") if not isinstance(choice, str) else choice


def _ordered(choices: Mapping[str, Any], order: Any) -> list[str]:
    named = [str(one) for one in order] if isinstance(order, list) else []
    known = dict.fromkeys(one for one in named if one in choices)
    return list(known | dict.fromkeys(choices))


def whole(value: Any, default: int) -> int:
    """Return a number of the file as a whole one."""
    try:
        return int(float(value))
    except (TypeError, ValueError, OverflowError):
        return default


def is_set(choice: Any, name: str) -> bool:
    """Tell whether a choice has a mark; Qualtrics writes these as words, numbers or truth."""
    return str(mapping(choice).get(name)).lower() in {"true", "on", "1"}


# --- what kinds share -----------------------------------------------------------------------------


def note_choices(asked: QualtricsConversion) -> None:
    """Note what of the choices themselves is not imported."""
    choices = by_id(asked.payload.get("Choices"))
    if any(mapping(choice).get("DisplayLogic") for choice in choices.values()):
        asked.note.changed(_("Conditions of single options are not imported: all are shown."))
    if asked.payload.get("DynamicChoices"):
        asked.note.changed(_("Options carried forward from another question are not imported."))


def form_rows(asked: QualtricsConversion) -> Iterator[tuple[str, str, Text]]:
    """Yield the id, key and text of each choice that is a question of its own."""
    for one, label in asked.labels().items():
        own = asked.draft.key(f"{asked.name}_{one}", asked.note)
        yield one, own, label


def no_counterpart(asked: QualtricsConversion) -> str:
    """Return the reason why a kind of question is not imported."""
    kind = "/".join(part for part in (asked.kind, asked.selector, asked.sub_selector) if part)
    return str(_("Questions of the type %(kind)s are not supported.") % {"kind": kind})
