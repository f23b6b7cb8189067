"""Qualtrics survey files (.qsf): JSON with a list of elements.

The format has no published description. Its shape was read in public files and readers: the sample
surveys of ctesta01/QualtricsTools (16 files), the test data of fflewddur/sp (types MC, NPS, CS, RO,
PGR, Timing, Meta, forms), and data-raw/ of sumtxt/qsf (translations, AvailableLanguages).

The element BL has the blocks with their questions and page breaks, FL the order of the blocks, each
SQ a question, SO the options of the survey.
"""

import re
from collections.abc import Callable, Iterator
from typing import Any, ClassVar

import msgspec
from django.utils.translation import gettext as _

from surveys.documents import BadDefinitionError
from surveys.importing.draft import Draft, Item, language_of
from surveys.importing.parts import note_reversal
from surveys.importing.plain_text import plain
from surveys.importing.qualtrics.choices import choice, ranking
from surveys.importing.qualtrics.entries import slider, text_entry
from surveys.importing.qualtrics.matrices import matrix
from surveys.importing.qualtrics.question import QualtricsConversion, by_id, mapping, no_counterpart
from surveys.importing.report import Note, NotImportedError
from surveys.importing.survey_format import SurveyFormat, Wishes

_CHOICE = re.compile(r"^q://(?P<question>[^/]+)/Selectable(?:Choice|Answer)/(?P<choice>[^/]+)$")
_IN_ORDER = frozenset({"Block", "Standard"})
# Elements that ask nothing and change nothing of what is asked.
_QUIET = frozenset({"BL", "FL", "SQ", "SO", "SCO", "STAT", "QC", "RS", "NT", "PL", "PROJ", "BR"})
_QUIET_FLOW = frozenset({"Root", "Block", "Standard", "Group", "EndSurvey"})


class Qsf(SurveyFormat):
    """A survey exported from Qualtrics."""

    label: ClassVar[str] = "Qualtrics (.qsf)"

    @classmethod
    def is_in(cls, document: bytes) -> bool:
        """Tell by the names that every such file begins with."""
        return document.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"{") and (
            b'"SurveyElements"' in document
        )

    @classmethod
    def read(cls, document: bytes, _wishes: Wishes) -> Draft:
        """Return what a file asks.

        Raises:
            BadDefinitionError: it is no such file.
        """
        try:
            survey = msgspec.json.decode(document.removeprefix(b"\xef\xbb\xbf"))
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise BadDefinitionError(
                [_("This is not valid JSON: %(problem)s.") % {"problem": error}]
            ) from error
        return _QsfConversion(survey).draft()


class _QsfConversion:
    """One file, element by element."""

    def __init__(self, survey: Any) -> None:
        elements = survey.get("SurveyElements") if isinstance(survey, dict) else None
        if not isinstance(elements, list) or not all(isinstance(one, dict) for one in elements):
            raise BadDefinitionError([_("The file has no list of SurveyElements.")])
        self.entry = mapping(survey.get("SurveyEntry"))
        self.elements = elements
        self.questions = {
            str(payload.get("QuestionID") or element.get("PrimaryAttribute")): payload
            for element in elements
            if element.get("Element") == "SQ" and (payload := mapping(element.get("Payload")))
        }
        self.blocks = {
            str(block.get("ID") or n): block
            for n, block in by_id(self._payload("BL")).items()
            if isinstance(block, dict)
        }
        self.into = Draft("qualtrics", Qsf.label, self._languages())

    def draft(self) -> Draft:
        """Return what it asks."""
        name = plain(str(self.entry.get("SurveyName") or "")).text[:200] or "Survey"
        self.into.title = self.into.same(name)
        self.into.source = f"Qualtrics, {plain(str(self.entry.get('SurveyID') or name)).text}"
        asked: set[str] = set()
        for block in self._blocks_in_order():
            asked |= set(self._take(block))
        for question in self.questions:
            if question not in asked:
                self._leave(
                    question, _("It is not part of the survey: it is in the trash or unused.")
                )
        for element in self.elements:
            if element.get("Element") == "SQ" and not mapping(element.get("Payload")):
                name = str(element.get("PrimaryAttribute") or "SQ")
                self.into.leave_out(name, _("The file has no question with this name."))
        self._rest()
        self.into.finish()
        return self.into

    def _payload(self, element: str) -> Any:
        return next(
            (one.get("Payload") for one in self.elements if one.get("Element") == element), None
        )

    def _languages(self) -> list[str]:
        first = language_of(str(self.entry.get("SurveyLanguage") or "EN")) or "en"
        found = dict.fromkeys(
            language_of(code)
            for payload in self.questions.values()
            for code, texts in mapping(payload.get("Language")).items()
            if mapping(texts).get("QuestionText")
        )
        return [first, *(lang for lang in found if lang and lang != first)]

    # the order of the blocks

    def _blocks_in_order(self) -> Iterator[dict[str, Any]]:
        flow = mapping(self._payload("FL")).get("Flow")
        order = list(self._flow(flow)) if isinstance(flow, list) else list(self.blocks)
        for one in dict.fromkeys(order):
            block = self.blocks.get(one)
            if block is not None and block.get("Type") != "Trash":
                yield block

    def _flow(self, flow: list[Any], depth: int = 0) -> Iterator[str]:
        """Yield the ids of the blocks in the order of the flow, and report what else it has."""
        if depth > 30:
            return
        for part in (mapping(one) for one in flow):
            kind = str(part.get("Type"))
            if kind in _IN_ORDER:
                yield str(part.get("ID"))
            elif kind not in _QUIET_FLOW:
                self._flow_part(kind, part)
            inner = part.get("Flow")
            if isinstance(inner, list):
                yield from self._flow(inner, depth + 1)

    def _flow_part(self, kind: str, part: dict[str, Any]) -> None:
        reasons = {
            "Branch": _("Branches are not imported: all blocks are asked."),
            "BlockRandomizer": _(
                "The random order of blocks is not imported: blocks are asked in the written order."
            ),
            "EmbeddedData": _("Embedded data is not imported: a study records its own data."),
        }
        name = _("Survey flow: %(name)s") % {"name": part.get("Description") or kind}
        self.into.leave_out(name, reasons.get(kind, _("This site has no equivalent.")))

    # questions

    def _take(self, block: dict[str, Any]) -> Iterator[str]:
        options = mapping(block.get("Options"))
        shuffled = str(options.get("RandomizeQuestions", "false")) not in {"false", "", "None"}
        self.into.page(is_shuffled=shuffled)
        if str(options.get("Looping", "None")) not in {"None", "", "false"}:
            self.into.leave_out(
                _("Block: %(name)s") % {"name": block.get("Description")},
                _("Loops are not imported: the questions are asked once."),
            )
        for element in by_id(block.get("BlockElements")).values():
            one = mapping(element)
            if one.get("Type") == "Page Break":
                self.into.page(is_shuffled=shuffled)
            elif one.get("Type") == "Question" and str(one.get("QuestionID")) in self.questions:
                question = str(one["QuestionID"])
                yield question
                self._ask(question, has_skip=bool(one.get("SkipLogic")))

    def _ask(self, question: str, *, has_skip: bool) -> None:
        payload = self.questions[question]
        note = self.into.note(_name(payload), str(payload.get("QuestionText") or ""))
        with self.into.trying(note):
            self._take_question(note, payload)
            self._remark(note, payload, has_skip=has_skip)

    def _take_question(self, note: Note, payload: dict[str, Any]) -> None:
        asked = QualtricsConversion(self.into, note, payload)
        if asked.kind == "DB" and asked.selector in {"TB", "PTB"}:
            self.into.say(note, self.into.text(asked.raw("QuestionText"), note))
            if payload.get("DisplayLogic"):
                note.changed(_("Its display logic is not imported: it is shown to everybody."))
            return
        condition = self._condition(note, payload.get("DisplayLogic"))
        items = _items_of(asked)
        if condition is not None:
            items = [{"show_if": condition} | item for item in items]
        self.into.ask(note, items)

    def _remark(self, note: Note, payload: dict[str, Any], *, has_skip: bool) -> None:
        if has_skip:
            note.changed(_("Its skip logic is not imported: nothing is skipped."))
        if payload.get("QuestionJS"):
            note.changed(_("Its JavaScript is not imported."))
        if _custom(payload):
            note.changed(_("Its own validation rules are not imported."))
        if payload.get("GradingData"):
            note.changed(_("Its scores are not imported."))
        if payload.get("DefaultChoices"):
            note.changed(_("Its default answer is not imported: no answer is preselected."))
        note_reversal(note, str(payload.get("QuestionDescription") or "")[:200])

    def _condition(self, note: Note, logic: Any) -> dict[str, Any] | None:
        """Return `show_if` for "one of these choices was selected"; anything else is noted."""
        if not logic:
            return None
        chosen = list(_selected(mapping(logic)))
        condition = None
        if chosen and None not in chosen:
            condition = self.into.condition([one for one in chosen if one is not None])
        if condition is None:
            note.changed(_("Its display logic is not imported: it is shown to everybody."))
        return condition

    def _leave(self, question: str, reason: str) -> None:
        payload = self.questions[question]
        self.into.leave_out(_name(payload), reason, str(payload.get("QuestionText") or ""))

    def _rest(self) -> None:
        for element in self.elements:
            if str(element.get("Element")) not in _QUIET:
                self.into.leave_out(
                    f"{element.get('Element')}: {element.get('PrimaryAttribute')}",
                    _("This site has no equivalent."),
                )
        options = mapping(self._payload("SO"))
        for name in ("Header", "Footer", "EOSMessage"):
            if options.get(name):
                self.into.leave_out(name, _("This site has no equivalent."), str(options[name]))
        if mapping(self._payload("SCO")).get("ScoringCategories"):
            self.into.leave_out(
                _("Scoring"), _("Choose the scoring yourself, in the questionnaire.")
            )
        translated = {language_of(code) for code in mapping(options.get("AvailableLanguages"))}
        for lang in sorted(translated - set(self.into.languages) - {""}):
            self.into.leave_out(lang, _("The file has no translated question in this language."))


def _name(payload: dict[str, Any]) -> str:
    return str(payload.get("DataExportTag") or payload.get("QuestionID") or "")


def _custom(payload: dict[str, Any]) -> bool:
    settings = mapping(mapping(payload.get("Validation")).get("Settings"))
    return bool(settings.get("CustomValidation")) or settings.get("Type") == "CustomValidation"


def _selected(logic: dict[str, Any]) -> Iterator[tuple[str, str] | None]:
    """Yield the question and choice of each part of a logic that only joins selected choices by
    "or"; None for any other part.
    """
    groups = [group for name, group in logic.items() if name.isdigit()]
    for group in groups:
        for name, part in mapping(group).items():
            if not name.isdigit():
                continue
            one = mapping(part)
            found = _CHOICE.match(str(one.get("LeftOperand") or one.get("ChoiceLocator") or ""))
            joined = str(one.get("Conjuction") or "Or").lower() == "or"
            if found and joined and one.get("Operator") == "Selected" and len(groups) == 1:
                yield found["question"], found["choice"]
            else:
                yield None


def _columns_of(asked: QualtricsConversion) -> list[Item]:
    """SBS: several matrices with the same rows, one a column."""
    asked.note.changed(_("Each column becomes a separate question."))
    columns = by_id(asked.payload.get("AdditionalQuestions"))
    rows = {name: asked.payload.get(name) for name in ("Choices", "ChoiceOrder")}
    items: list[Item] = []
    for one, column in columns.items():
        inner = QualtricsConversion(asked.draft, asked.note, {**mapping(column), **rows})
        inner.name = f"{asked.name}_{one}"
        converter = _TYPES.get(inner.kind)
        if converter is None or converter is _columns_of:
            raise NotImportedError(no_counterpart(inner))
        made = converter(inner)
        text = asked.text()
        items += [
            {**item, "text": asked.draft.joined(text, item["text"], by=" – ")} for item in made
        ]
    return items


# By type and selector; a type without an entry has no counterpart.
_TYPES: dict[str, Callable[[QualtricsConversion], list[Item]]] = {
    "MC": choice,
    "Matrix": matrix,
    "TE": text_entry,
    "Slider": slider,
    "RO": ranking,
    "SBS": _columns_of,
}


def _items_of(asked: QualtricsConversion) -> list[Item]:
    """Return what a question becomes.

    Raises:
        NotImportedError: it has no counterpart here.
    """
    converter = _TYPES.get(asked.kind)
    if converter is None:
        raise NotImportedError(no_counterpart(asked))
    return converter(asked)
