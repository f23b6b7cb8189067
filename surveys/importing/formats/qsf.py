"""Qualtrics survey files (.qsf): JSON with a list of elements.

The format has no published description; this follows public files and readers: the sample surveys
of ctesta01/QualtricsTools (16 files), the test data of fflewddur/sp (types MC, NPS, CS, RO, PGR,
Timing, Meta, forms), and data-raw/ of sumtxt/qsf (translations, AvailableLanguages).

The element BL has the blocks with their questions and page breaks, FL the order of the blocks, each
SQ a question, SO the options of the survey.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar

import msgspec
from django.utils.translation import gettext as _, gettext_lazy

from surveys.documents import BadDefinitionError, Text
from surveys.importing.draft import Draft, Item, Raw, SurveyFormat, language_of, number_in
from surveys.importing.plain_text import plain
from surveys.importing.question import ImportedQuestion
from surveys.importing.report import Note, NotImportedError
from surveys.problems import MAX_POINTS

Payload = Mapping[str, Any]
_SINGLE = frozenset({"SAVR", "SAHR", "SACOL", "DL", "SB"})
_MULTIPLE = frozenset({"MAVR", "MAHR", "MACOL", "MSB"})
_TEXT_LINES = {"SL": 1, "ML": 4, "ESTB": 8}
# Formats of a text that are not checked here, by their names in the file.
_UNCHECKED = {
    "ValidEmail": "e-mail",
    "ValidPhone": "phone",
    "ValidZip": "ZIP",
    "ValidUSState": "state",
    "ValidTextOnly": "letters",
}


class QualtricsConversion(ImportedQuestion):
    def __init__(self, draft: Draft, note: Note, payload: Payload) -> None:
        name = str(payload.get("DataExportTag") or payload.get("QuestionID") or "question")
        super().__init__(draft, note, name, str(payload.get("QuestionType") or ""))
        self.payload = payload
        self.selector = str(payload.get("Selector") or "")
        self.sub_selector = str(payload.get("SubSelector") or "")
        self.id = str(payload.get("QuestionID") or "")
        self.settings: Payload = mapping(mapping(payload.get("Validation")).get("Settings"))
        self.configuration: Payload = mapping(payload.get("Configuration"))
        self._choices = by_id(payload.get("Choices"))
        texts = mapping(payload.get("Language")).items()
        self._in_languages = {language_of(code): mapping(one) for code, one in texts}
        self._in_languages[draft.languages[0]] = dict(payload)

    def raw_text(self) -> Raw:
        texts = self._in_languages.items()
        return {language: str(one.get("QuestionText") or "") for language, one in texts}

    def text(self) -> Text:
        return self.or_name(self.draft.text(self.raw_text(), self.note))

    def common(self) -> Item:
        wish = self.settings.get("ForceResponse")
        if "RequestResponse" in (wish, self.settings.get("ForceResponseType")) and wish != "OFF":
            self.note.changed(_("The file requests an answer; here it is optional."))
            return {}
        return {"required": wish == "ON"}

    def not_supported(self, kind: str) -> NotImportedError:
        parts = (kind, self.selector, self.sub_selector)
        return super().not_supported("/".join(part for part in parts if part))

    def _labels(self, part: str = "Choices", order: str = "ChoiceOrder") -> dict[str, Text]:
        """Return the labels of the choices or answers by their ids, in the order shown."""
        known = {language: by_id(one.get(part)) for language, one in self._in_languages.items()}
        own, named = by_id(self.payload.get(part)), self.payload.get(order)
        ids = [str(one) for one in named] if isinstance(named, list) else []
        found = {}
        for one in dict.fromkeys([*(one for one in ids if one in own), *own]):
            texts = {language: _display(choices.get(one)) for language, choices in known.items()}
            found[one] = self.draft.text(texts, self.note)
        return found

    def _codes(self, labels: Mapping[str, Text], *, are_unique: bool = False) -> dict[str, str]:
        """Return recode values or ids of choices; all ids where values repeat and must not."""
        recoded = mapping(self.payload.get("RecodeValues"))
        codes = {one: str(recoded.get(one, one)) for one in labels}
        if not are_unique or len(set(codes.values())) == len(codes):
            return codes
        self.note.changed(_("Several options share a recode value, so their ids are stored."))
        return {one: one for one in labels}

    def _order(self) -> str:
        wanted = mapping(self.payload.get("Randomization")).get("Type")
        if str(wanted) in {"Advanced", "Subset", "ScaleReversal"}:
            self.note.changed(_("Its random order with rules is replaced by a fixed order."))
        return "shuffled" if wanted == "All" else "fixed"

    def _note_choices(self) -> None:
        if any(mapping(choice).get("DisplayLogic") for choice in self._choices.values()):
            self.note.changed(_("Conditions of single options are not imported: all are shown."))
        if self.payload.get("DynamicChoices"):
            self.note.changed(_("Options carried forward from another question are not imported."))

    def _rows(self) -> Iterator[tuple[str, Text]]:
        tags = mapping(self.payload.get("ChoiceDataExportTags"))
        for one, label in self._labels().items():
            if _is_set(self._choices[one], "TextEntry"):
                self.note.changed(_("The text entry in a row is not imported."))
            if label:
                wanted = str(tags.get(one) or f"{self.name}_{one}")
                yield self.draft.key(wanted, self.note), label
            else:
                self.note.changed(_("A row without a text is not imported."))

    def choice(self) -> list[Item]:
        """MC: one or several options, or the eleven points of a Net Promoter Score."""
        if self.selector == "NPS":
            return [self._net_promoter_score()]
        if self.selector not in _SINGLE | _MULTIPLE:
            raise self.not_supported(self.kind)
        self._note_choices()
        labels, several = self._labels(), self.selector in _MULTIPLE
        codes, key = self._codes(labels, are_unique=True), self.key()
        exclusive = [one for one in labels if _is_set(self._choices[one], "ExclusiveAnswer")]
        alone = [codes[one] for one in exclusive if several]
        options = self.options({codes[one]: label for one, label in labels.items()}, alone)
        most = _whole(self.settings.get("MaxChoices"), 0)
        least = _whole(self.settings.get("MinChoices"), 0)
        bounds = {"at_least": least, "at_most": most or None} if several else {}
        kind, listed = "multiple" if several else "single", list(options.values())
        items = [self.item(kind, key, options=listed, order=self._order(), **bounds)]
        for one in labels:
            if option := options.get(codes[one]):
                self.draft.remember(self.id, key, {one: option["value"]})
                if _is_set(self._choices[one], "TextEntry"):
                    items.append(self.other(key, option))
        return items

    def _net_promoter_score(self) -> Item:
        numbers = [int(one) for one in self._labels() if re.fullmatch(r"[0-9]{1,9}", one)]
        named = [label for label in self._labels("ColumnLabels", "").values() if label]
        first, last = (named[0], named[-1]) if len(named) > 1 else ({}, {})
        return self.item("likert", scale=self.numbered(numbers, first, last))

    def ranking(self) -> list[Item]:
        """RO: options to put into an order."""
        self._note_choices()
        labels = self._labels()
        if any(_is_set(self._choices[one], "TextEntry") for one in labels):
            self.note.changed(_("The text entry of an option is not imported."))
        codes = self._codes(labels)
        options = self.options({codes[one]: label for one, label in labels.items()})
        return [self.item("ranking", options=list(options.values()), order=self._order())]

    def matrix(self) -> list[Item]:
        """Matrix: statements on a scale, choices or texts by row."""
        if self.selector == "TE":
            return self._cells()
        if self.selector == "Bipolar":
            remark = _("Each row becomes a separate question with its own end labels.")
            return self.apart(remark, self._bipolar())
        if self.selector != "Likert":
            raise self.not_supported(self.kind)
        self._note_choices()
        if self.sub_selector == "MultipleAnswer":
            return self._choices_by_row("multiple")
        answers = self._labels("Answers", "AnswerOrder")
        if len(answers) > MAX_POINTS:
            words = _("A scale can have at most 11 points, so each row becomes a list of options.")
            self.note.changed(words)
            return self._choices_by_row("single")
        if self.sub_selector not in {"", "SingleAnswer"}:
            self.note.changed(_("It becomes statements on a scale."))
        return [self._grid(*self.scale(answers, self._codes(answers)))]

    def _grid(self, scale: str, values: Mapping[str, int], reasons: Mapping[str, bool]) -> Item:
        key = self.key()
        rows = [{"key": own, "text": label} for own, label in self._rows()]
        if len(rows) == 1:
            self.draft.remember(self.id, str(rows[0]["key"]), values)
        return self.item("grid", key, scale=scale, rows=rows, order=self._order(), **reasons)

    def _choices_by_row(self, kind: str) -> list[Item]:
        answers = self._labels("Answers", "AnswerOrder")
        codes = self._codes(answers, are_unique=True)
        options = self.options({codes[one]: label for one, label in answers.items()})
        fields = {"kind": kind, "options": list(options.values())}
        parts = ((key, label, fields) for key, label in self._rows())
        return self.apart(_("Each row becomes a separate question."), parts)

    def _cells(self) -> list[Item]:
        answers = self._labels("Answers", "AnswerOrder") or {"": {}}
        lines = 1 if self.sub_selector in {"", "Short", "Medium", "Long"} else 4
        parts = (
            (
                self.draft.key(f"{key}_{column}", self.note) if column else key,
                self.draft.joined(label, answer),
                {"kind": "text", "lines": lines},
            )
            for key, label in list(self._rows())
            for column, answer in answers.items()
        )
        return self.apart(_("Each cell becomes a separate question."), parts)

    def _bipolar(self) -> Iterator[tuple[str, Text, Item]]:
        """Yield rows with labels at both ends, written "left:right"."""
        most = len(self._labels("Answers", "AnswerOrder"))
        for key, label in self._rows():
            parts = {language: words.partition(":") for language, words in label.items()}
            ends = {}
            for n, part in ((1, 0), (most, 2)):
                end = {language: words[part].strip() for language, words in parts.items()}
                ends[n] = end if all(end.values()) else {}
            scale = self.draft.scale((n, ends.get(n, {})) for n in range(1, most + 1))
            yield key, label, {"kind": "likert", "scale": scale}

    def columns(self) -> list[Item]:
        """SBS: several matrices with the same rows, one a column."""
        self.note.changed(_("Each column becomes a separate question."))
        rows = {name: self.payload.get(name) for name in ("Choices", "ChoiceOrder")}
        items: list[Item] = []
        for one, column in by_id(self.payload.get("AdditionalQuestions")).items():
            inner = QualtricsConversion(self.draft, self.note, {**mapping(column), **rows})
            inner.name = f"{self.name}_{one}"
            if inner.kind == self.kind:
                raise inner.not_supported(inner.kind)
            made, text = inner.items(), self.text()
            items += [item | {"text": self.draft.joined(text, item["text"])} for item in made]
        return items

    def text_entry(self) -> list[Item]:
        """TE: a text, a number or a date on one line or several, or a form of several lines."""
        if self.selector == "PW":
            raise NotImportedError(_("Questions for passwords are not supported."))
        if self.selector == "FORM":
            labels = self._labels().items()
            parts = ((self.key(one), label, {"kind": "text"}) for one, label in labels)
            return self.apart(_("Each line of the form becomes a separate question."), parts)
        if self.selector not in _TEXT_LINES:
            raise self.not_supported(self.kind)
        has_format = self.settings.get("Type") == "ContentType"
        wanted = self.settings.get("ContentType") if has_format else ""
        if wanted == "ValidNumber":
            rules = mapping(self.settings.get("ValidNumber"))
            least, most = number_in(rules.get("Min")), number_in(rules.get("Max"))
            is_whole = str(rules.get("NumDecimals")) == "0"
            return [self.item("number", minimum=least, maximum=most, whole=is_whole)]
        if wanted == "ValidDate":
            return [self.item("date")]
        if wanted:
            rule = _UNCHECKED.get(str(wanted), wanted)
            self.note.changed(_("Its format (%(rule)s) is not checked."), rule=rule)
        lines = _TEXT_LINES[self.selector]
        limit = self.settings.get("MaxChars") or self.settings.get("TotalChars")
        length = self.length(_whole(limit, 0), is_line=lines == 1)
        return [self.item("text", lines=lines, max_length=length)]

    def sliders(self) -> list[Item]:
        """Slider: one slider a choice, between the ends of all."""
        least = _whole(self.configuration.get("CSSliderMin"), 0)
        most = _whole(self.configuration.get("CSSliderMax"), 100)
        parts = _whole(self.configuration.get("GridLines"), 0)
        snaps = str(self.configuration.get("SnapToGrid")).lower() == "true" and parts > 0
        step = (most - least) // parts if snaps and (most - least) % parts == 0 else 1
        if _whole(self.configuration.get("NumDecimals"), 0) > 0:
            self.note.changed(_("It accepts only whole numbers."))
        if self.selector == "STAR":
            self.note.changed(_("The stars become a slider."))
        ends = [label for label in self._labels("Labels", "").values() if label]
        if len(ends) > 2:
            self.note.changed(_("Labels between the two ends are not imported."))
        low, high = (ends[0], ends[-1]) if len(ends) > 1 else ({}, {})
        lacks = str(self.configuration.get("NotApplicable")).lower() == "true"
        fields = self.slider(least, most, low, high, step) | {"not_applicable": lacks}
        rows = [(self.key(one), label, fields) for one, label in self._labels().items()]
        remark = _("Each slider becomes a separate question.") if len(rows) > 1 else ""
        return self.apart(remark, rows or [(self.key(), {}, fields)])

    TYPES: ClassVar[Mapping[str, Callable[["QualtricsConversion"], list[Item]]]] = {
        "MC": choice,
        "Matrix": matrix,
        "TE": text_entry,
        "Slider": sliders,
        "RO": ranking,
        "SBS": columns,
    }


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
    return choice if isinstance(choice, str) else str(mapping(choice).get("Display") or "")


def _whole(value: Any, default: int) -> int:
    number = number_in(value)
    return default if number is None else int(number)


def _is_set(choice: Any, name: str) -> bool:
    """Tell whether a choice has a mark; Qualtrics writes these as words, numbers or truth."""
    return str(mapping(choice).get(name)).lower() in {"true", "on", "1"}


# --- the file -------------------------------------------------------------------------------------

_CHOICE = re.compile(r"^q://(?P<question>[^/]+)/Selectable(?:Choice|Answer)/(?P<choice>[^/]+)$")
_IN_ORDER = frozenset({"Block", "Standard"})
# Elements without questions and rules.
_QUIET = frozenset({"BL", "FL", "SQ", "SO", "SCO", "STAT", "QC", "RS", "NT", "PL", "PROJ", "BR"})
_QUIET_FLOW = frozenset({"Root", "Block", "Standard", "Group", "EndSurvey"})
_LOST_FLOW = {
    "Branch": gettext_lazy("Branches are not imported: all blocks are asked."),
    "BlockRandomizer": gettext_lazy(
        "The random order of blocks is not imported: blocks are asked in the written order."
    ),
    "EmbeddedData": gettext_lazy("Embedded data is not imported: a study records its own data."),
}
MAX_DEPTH = 30  # of the survey flow


class Qsf(SurveyFormat):
    label: ClassVar[str] = "Qualtrics (.qsf)"

    def __init__(self, document: bytes, _language: str, _form: str) -> None:
        try:
            survey = mapping(msgspec.json.decode(document.removeprefix(b"\xef\xbb\xbf")))
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            words = _("This is not valid JSON: %(problem)s.") % {"problem": error}
            raise BadDefinitionError([words]) from error
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
        # The first payload of each kind of element.
        self.payloads = {str(one.get("Element")): one.get("Payload") for one in elements[::-1]}
        blocks = by_id(self.payloads.get("BL")).items()
        listed = ((n, block) for n, block in blocks if isinstance(block, dict))
        self.blocks = {str(block.get("ID") or n): block for n, block in listed}
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

    def _languages(self) -> list[str]:
        first = language_of(str(self.entry.get("SurveyLanguage") or "EN")) or "en"
        translated = (mapping(one.get("Language")).items() for one in self.questions.values())
        texts = ((code, mapping(one)) for listed in translated for code, one in listed)
        found = [language_of(code) for code, one in texts if one.get("QuestionText")]
        return [language for language in dict.fromkeys([first, *found]) if language]

    def _blocks_in_order(self) -> list[dict[str, Any]]:
        flow = mapping(self.payloads.get("FL")).get("Flow")
        order = list(self._flow(flow)) if isinstance(flow, list) else list(self.blocks)
        blocks = [self.blocks[one] for one in dict.fromkeys(order) if one in self.blocks]
        return [block for block in blocks if block.get("Type") != "Trash"]

    def _flow(self, flow: list[Any], depth: int = 0) -> Iterator[str]:
        """Yield the ids of the blocks in the order of the flow, and report its other parts."""
        for part in map(mapping, flow if depth <= MAX_DEPTH else ()):
            kind = str(part.get("Type"))
            if kind in _IN_ORDER:
                yield str(part.get("ID"))
            elif kind not in _QUIET_FLOW:
                name = _("Survey flow: %(name)s") % {"name": part.get("Description") or kind}
                reason = _LOST_FLOW.get(kind, _("This site has no equivalent."))
                self.into.leave_out(name, str(reason))
            inner = part.get("Flow")
            if isinstance(inner, list):
                yield from self._flow(inner, depth + 1)

    def _take(self, block: dict[str, Any]) -> Iterator[str]:
        options = mapping(block.get("Options"))
        shuffled = str(options.get("RandomizeQuestions", "false")) not in {"false", "", "None"}
        order = "shuffled" if shuffled else "fixed"
        self.into.page({}, {}, order=order)
        if str(options.get("Looping", "None")) not in {"None", "", "false"}:
            name = _("Block: %(name)s") % {"name": block.get("Description")}
            self.into.leave_out(name, _("Loops are not imported: the questions are asked once."))
        for one in map(mapping, by_id(block.get("BlockElements")).values()):
            question = str(one.get("QuestionID"))
            if one.get("Type") == "Page Break":
                self.into.page({}, {}, order=order)
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
        payload, settings = asked.payload, asked.settings
        has_rules = settings.get("CustomValidation") or settings.get("Type") == "CustomValidation"
        default = _("Its default answer is not imported: no answer is preselected.")
        for lost, remark in (
            (has_skip, _("Its skip logic is not imported: nothing is skipped.")),
            (payload.get("QuestionJS"), _("Its JavaScript is not imported.")),
            (has_rules, _("Its own validation rules are not imported.")),
            (payload.get("GradingData"), _("Its scores are not imported.")),
            (payload.get("DefaultChoices"), default),
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
        options = mapping(self.payloads.get("SO"))
        for name in ("Header", "Footer", "EOSMessage"):
            if options.get(name):
                self.into.leave_out(name, nowhere, str(options[name]))
        if mapping(self.payloads.get("SCO")).get("ScoringCategories"):
            reason = _("Choose the scoring yourself, in the questionnaire.")
            self.into.leave_out(_("Scoring"), reason)
        translated = set(map(language_of, mapping(options.get("AvailableLanguages"))))
        reason = _("The file has no translated question in this language.")
        for language in sorted(translated - {"", *self.into.languages}):
            self.into.leave_out(language, reason)


def _name(payload: Payload) -> str:
    return str(payload.get("DataExportTag") or payload.get("QuestionID") or "")


def _selected(logic: Mapping[str, Any]) -> Iterator[tuple[str, str] | None]:
    """Yield question and choice of each part of an "or" of selected choices; None for others."""
    groups = [group for name, group in logic.items() if name.isdigit()]
    parts = (one for group in groups for one in mapping(group).items())
    for one in (mapping(part) for name, part in parts if name.isdigit()):
        found = _CHOICE.match(str(one.get("LeftOperand") or one.get("ChoiceLocator") or ""))
        joined = str(one.get("Conjuction") or "Or").lower() == "or"
        is_plain = joined and one.get("Operator") == "Selected" and len(groups) == 1
        yield (found["question"], found["choice"]) if found and is_plain else None
