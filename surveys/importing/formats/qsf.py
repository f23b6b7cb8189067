"""Qualtrics survey files (.qsf): JSON with a list of elements.

The format has no published description. Its shape was read in public files and readers: the sample
surveys of ctesta01/QualtricsTools (16 files), the test data of fflewddur/sp (types MC, NPS, CS, RO,
PGR, Timing, Meta, forms), and data-raw/ of sumtxt/qsf (translations, AvailableLanguages).

The element BL has the blocks with their questions and page breaks, FL the order of the blocks, each
SQ a question, SO the options of the survey.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import msgspec
from django.utils.translation import gettext as _

from surveys.documents import BadDefinitionError
from surveys.importing.draft import Draft, SurveyFormat, language_of
from surveys.importing.plain_text import plain
from surveys.importing.qualtrics import Payload, QualtricsConversion, by_id, mapping

_CHOICE = re.compile(r"^q://(?P<question>[^/]+)/Selectable(?:Choice|Answer)/(?P<choice>[^/]+)$")
_IN_ORDER = frozenset({"Block", "Standard"})
# Elements that ask nothing and change nothing of what is asked.
_QUIET = frozenset({"BL", "FL", "SQ", "SO", "SCO", "STAT", "QC", "RS", "NT", "PL", "PROJ", "BR"})
_QUIET_FLOW = frozenset({"Root", "Block", "Standard", "Group", "EndSurvey"})
MAX_DEPTH = 30  # of the survey flow


class Qsf(SurveyFormat):
    """A survey exported from Qualtrics, element by element."""

    label: ClassVar[str] = "Qualtrics (.qsf)"

    def __init__(self, document: bytes, _language: str, _form: str) -> None:
        try:
            survey = mapping(msgspec.json.decode(document.removeprefix(b"\xef\xbb\xbf")))
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            told = _("This is not valid JSON: %(problem)s.") % {"problem": error}
            raise BadDefinitionError([told]) from error
        elements = survey.get("SurveyElements")
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
        self.into = Draft("qualtrics", self.label, self._languages())

    @classmethod
    def is_in(cls, document: bytes) -> bool:
        start = document.lstrip(b"\xef\xbb\xbf \r\n\t")
        return start.startswith(b"{") and b'"SurveyElements"' in document

    def convert(self) -> None:
        name = plain(str(self.entry.get("SurveyName") or "")).text[:200] or "Survey"
        self.into.title = self.into.same(name)
        self.into.source = f"Qualtrics, {plain(str(self.entry.get('SurveyID') or name)).text}"
        asked: set[str] = set()
        for block in self._blocks_in_order():
            asked |= set(self._take(block))
        for question, payload in self.questions.items():
            if question not in asked:
                reason = _("It is not part of the survey: it is in the trash or unused.")
                text = str(payload.get("QuestionText") or "")
                self.into.leave_out(_name(payload), reason, text)
        for element in self.elements:
            if element.get("Element") == "SQ" and not mapping(element.get("Payload")):
                name = str(element.get("PrimaryAttribute") or "SQ")
                self.into.leave_out(name, _("The file has no question with this name."))
        self._rest()

    def _payload(self, element: str) -> Any:
        found = (one.get("Payload") for one in self.elements if one.get("Element") == element)
        return next(found, None)

    def _languages(self) -> list[str]:
        first = language_of(str(self.entry.get("SurveyLanguage") or "EN")) or "en"
        found = [
            language_of(code)
            for payload in self.questions.values()
            for code, texts in mapping(payload.get("Language")).items()
            if mapping(texts).get("QuestionText")
        ]
        return [language for language in dict.fromkeys([first, *found]) if language]

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
        for part in map(mapping, flow if depth <= MAX_DEPTH else ()):
            kind = str(part.get("Type"))
            if kind in _IN_ORDER:
                yield str(part.get("ID"))
            elif kind not in _QUIET_FLOW:
                self._leave_out_flow(kind, part)
            inner = part.get("Flow")
            if isinstance(inner, list):
                yield from self._flow(inner, depth + 1)

    def _leave_out_flow(self, kind: str, part: Payload) -> None:
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
        """Ask the questions of a block, and yield their ids."""
        options = mapping(block.get("Options"))
        shuffled = str(options.get("RandomizeQuestions", "false")) not in {"false", "", "None"}
        self.into.page(is_shuffled=shuffled)
        if str(options.get("Looping", "None")) not in {"None", "", "false"}:
            self.into.leave_out(
                _("Block: %(name)s") % {"name": block.get("Description")},
                _("Loops are not imported: the questions are asked once."),
            )
        for one in map(mapping, by_id(block.get("BlockElements")).values()):
            question = str(one.get("QuestionID"))
            if one.get("Type") == "Page Break":
                self.into.page(is_shuffled=shuffled)
            elif one.get("Type") == "Question" and question in self.questions:
                yield question
                self._ask(self.questions[question], has_skip=bool(one.get("SkipLogic")))

    def _ask(self, payload: Payload, *, has_skip: bool) -> None:
        note = self.into.note(_name(payload), str(payload.get("QuestionText") or ""))
        logic = payload.get("DisplayLogic")
        shown_to_all = _("Its display logic is not imported: it is shown to everybody.")
        with self.into.trying(note):
            asked = QualtricsConversion(self.into, note, payload)
            if asked.kind == "DB" and asked.selector in {"TB", "PTB"}:
                self.into.introduce(note, self.into.text(asked.raw_text(), note))
                if logic:
                    note.changed(shown_to_all)
            else:
                chosen = _selected(mapping(logic))
                condition = self.into.condition(note, chosen, shown_to_all) if logic else None
                self.into.ask(note, asked.items(), condition)
            self._remark(asked, has_skip=has_skip)

    def _remark(self, asked: QualtricsConversion, *, has_skip: bool) -> None:
        """Note what of a question is not imported."""
        payload, settings = asked.payload, asked.settings
        has_rules = settings.get("CustomValidation") or settings.get("Type") == "CustomValidation"
        for lost, remark in (
            (has_skip, _("Its skip logic is not imported: nothing is skipped.")),
            (payload.get("QuestionJS"), _("Its JavaScript is not imported.")),
            (has_rules, _("Its own validation rules are not imported.")),
            (payload.get("GradingData"), _("Its scores are not imported.")),
            (
                payload.get("DefaultChoices"),
                _("Its default answer is not imported: no answer is preselected."),
            ),
        ):
            if lost:
                asked.note.changed(remark)
        asked.note_reversal(str(payload.get("QuestionDescription") or "")[:200])

    def _rest(self) -> None:
        nowhere = _("This site has no equivalent.")
        for element in self.elements:
            if str(element.get("Element")) not in _QUIET:
                name = f"{element.get('Element')}: {element.get('PrimaryAttribute')}"
                self.into.leave_out(name, nowhere)
        options = mapping(self._payload("SO"))
        for name in ("Header", "Footer", "EOSMessage"):
            if options.get(name):
                self.into.leave_out(name, nowhere, str(options[name]))
        if mapping(self._payload("SCO")).get("ScoringCategories"):
            self.into.leave_out(
                _("Scoring"), _("Choose the scoring yourself, in the questionnaire.")
            )
        translated = set(map(language_of, mapping(options.get("AvailableLanguages"))))
        for language in sorted(translated - {"", *self.into.languages}):
            self.into.leave_out(
                language, _("The file has no translated question in this language.")
            )


def _name(payload: Payload) -> str:
    return str(payload.get("DataExportTag") or payload.get("QuestionID") or "")


def _selected(logic: Mapping[str, Any]) -> Iterator[tuple[str, str] | None]:
    """Yield the question and choice of each part of a logic that only joins selected choices by
    "or"; None for any other part.
    """
    groups = [group for name, group in logic.items() if name.isdigit()]
    parts = (one for group in groups for one in mapping(group).items())
    for one in (mapping(part) for name, part in parts if name.isdigit()):
        found = _CHOICE.match(str(one.get("LeftOperand") or one.get("ChoiceLocator") or ""))
        joined = str(one.get("Conjuction") or "Or").lower() == "or"
        is_plain = joined and one.get("Operator") == "Selected" and len(groups) == 1
        yield (found["question"], found["choice"]) if found and is_plain else None
