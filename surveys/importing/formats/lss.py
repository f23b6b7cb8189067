"""LimeSurvey survey structures (.lss): XML with the rows of LimeSurvey's tables.

Read against LimeSurvey's own source (application/helpers/export_helper.php) and its test surveys
(tests/data/surveys/, database versions 264 to 359), the demonstration survey of amaltawfik/lssdoc
(version 700, 27 types of questions in four languages) and the surveys of
TonisOrmisson/limesurvey-structure-imex (version 630).
"""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import ClassVar

from django.utils.translation import gettext as _

from surveys.documents import BadDefinitionError, Text
from surveys.importing import safe_xml
from surveys.importing.draft import Draft, Item, SurveyFormat, language_of
from surveys.importing.limesurvey_tables import LimeSurveyRow, survey_of, tables_of
from surveys.importing.question import ImportedQuestion, values_of
from surveys.importing.report import Note, NotImportedError
from surveys.problems import MAX_POINTS

NAMES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
_LINES = {"S": 1, "T": 5, "U": 15}


class LimeSurveyConversion(ImportedQuestion):
    def __init__(self, draft: Draft, note: Note, question: LimeSurveyRow) -> None:
        super().__init__(draft, note, question.get("title"), question.get("type"))
        self.question = question

    def texts_of(self, question: LimeSurveyRow, column: str = "question") -> Text:
        return self.draft.text(question.text(column), self.note)

    def text(self) -> Text:
        return self.or_name(self.texts_of(self.question))

    def common(self) -> Item:
        wish = self.question.get("mandatory")
        if wish == "S":
            self.note.changed(_("The file requests an answer; here it is optional."))
        return {"required": wish == "Y", "hint": self.texts_of(self.question, "help")}

    def items(self) -> list[Item]:
        if self.kind in NAMES["no_counterpart"]:
            raise self.not_supported(NAMES["no_counterpart"][self.kind])
        return super().items()

    def _answers(self, scale_id: str = "0") -> dict[str, Text]:
        if worded := NAMES["worded"].get(self.kind):
            return {code: self.word(name) for code, name in worded.items()}
        listed = (one for one in self.question.answers if one.row.get("scale_id", "0") == scale_id)
        return {one.get("code"): self.texts_of(one, "answer") for one in listed}

    def _parts(self, scale_id: str = "0") -> list[tuple[str, Text]]:
        return [
            (part.get("title"), self.texts_of(part) or self.draft.same(part.get("title")))
            for part in self.question.parts
            if part.row.get("scale_id", "0") in {scale_id, ""}
        ]

    def _by_part(self, fields: Item, remark: str) -> list[Item]:
        parts = ((self.key(code), label, fields) for code, label in self._parts())
        return self.apart(remark, parts)

    def _attribute_text(self, name: str) -> Text:
        return self.draft.text(self.question.attribute_texts(name), self.note)

    @property
    def _has_other(self) -> bool:
        return self.question.get("other") == "Y" and self.kind not in NAMES["worded"]

    def _other(self) -> dict[str, Text]:
        if not self._has_other:
            return {}
        return {"other": self._attribute_text("other_replace_text") or self.word("other")}

    def _order(self, attribute: str) -> str:
        wanted = self.question.attribute(attribute)
        if wanted.startswith("random") or self.question.attribute("random_order") == "1":
            return "shuffled"
        if wanted not in {"", "normal"}:
            words = _("Its order (%(order)s) is replaced by the written order.")
            self.note.changed(words, order=wanted)
        return "fixed"

    def _number(self, name: str) -> float | None:
        return self.number_bound(name, self.question.attribute(name))

    def single(self) -> list[Item]:
        """L, !, O, Y and G: one of the answers; O has a comment."""
        key, options = self.key(), self.options(self._answers() | self._other())
        self.draft.remember(self.name, key, values_of(options))
        order = self._order("answer_order")
        items = [self.item("single", key, options=list(options.values()), order=order)]
        if self._has_other:
            items.append(self.other(key, options["other"]))
        if self.kind == "O":
            self.note.changed(_("The comment becomes a separate question."))
            own = self.draft.key(f"{key}_comment", self.note)
            items.append({"kind": "text", "key": own, "text": self.word("comment"), "lines": 3})
        return items

    def multiple(self) -> list[Item]:
        """M and P: any of the subquestions; P has a comment for each."""
        key, labels = self.key(), dict(self._parts()) | self._other()
        alone = [code for code in self.question.attribute("exclude_all_others").split(";") if code]
        least, most = (self._number(f"{name}_answers") for name in ("min", "max"))
        options, bounds = self.options(labels, alone), {"at_least": int(least or 0)}
        bounds |= {"at_most": int(most)} if most else {}
        order = self._order("subquestion_order")
        item = self.item("multiple", key, options=list(options.values()), order=order, **bounds)
        for code, option in options.items():
            self.draft.remember(f"{self.name}_{code}", key, {"Y": option["value"]})
        with_text = options if self.kind == "P" else ["other"] if self._has_other else []
        return [item, *(self.other(key, options[code]) for code in with_text)]

    def ranking(self) -> list[Item]:
        """R: the answers in an order."""
        if self._number("max_answers") or self.question.attribute("max_subquestions"):
            self.note.changed(_("Respondents rank all options, not only some."))
        options = self.options(self._answers() or dict(self._parts()))
        order = self._order("answer_order")
        return [self.item("ranking", options=list(options.values()), order=order)]

    def five_points(self) -> list[Item]:
        """5: one of the numbers from 1 to 5."""
        key = self.key()
        self.draft.remember(self.name, key, {str(n): n for n in range(1, 6)})
        return [self.item("likert", key, scale=self.numbered(range(1, 6), {}, {}))]

    def array(self) -> list[Item]:
        """A, B, C, E, F, H: subquestions on one scale."""
        if self.kind in {"A", "B"}:
            numbers = range(1, 6 if self.kind == "A" else 11)
            values = {str(n): n for n in numbers}
            return [self._grid(self.numbered(numbers, {}, {}), values, {})]
        answers = self._answers()
        if self.kind == "H":
            self.note.changed(_("Its columns become rows."))
        if len(answers) > MAX_POINTS:
            words = _("A scale can have at most 11 points, so each row becomes a list of options.")
            self.note.changed(words)
            fields = {"kind": "single", "options": list(self.options(answers).values())}
            return self._by_part(fields, _("Each row becomes a separate question."))
        return [self._grid(*self.scale(answers))]

    def two_scales(self) -> list[Item]:
        """1: subquestions on two scales."""
        self.note.changed(_("Its two scales become two questions."))
        items = []
        for scale_id, header in (("0", "dualscale_headerA"), ("1", "dualscale_headerB")):
            scale = self.scale(self._answers(scale_id))
            items.append(self._grid(*scale, (scale_id,), self._attribute_text(header)))
        return items

    def _grid(
        self,
        scale: str,
        values: Mapping[str, int],
        reasons: Mapping[str, bool],
        endings: tuple[str, ...] = (),
        heading: Text | None = None,
    ) -> Item:
        rows = []
        for part, label in self._parts():
            key = self.key(part, *endings)
            rows.append({"key": key, "text": label})
            self.draft.remember("_".join((self.name, part, *endings)), key, values)
        order = self._order("subquestion_order")
        item = self.item("grid", self.key(*endings), scale=scale, rows=rows, order=order, **reasons)
        return item | {"text": self.draft.joined(item["text"], heading or {})}

    def cells(self) -> list[Item]:
        """: and ;: a number, a tick or a text for each row and column."""
        columns, is_number = self._parts("1"), self.kind == ":"
        if is_number and self.question.attribute("multiflexible_checkbox") == "1":
            fields = {"kind": "multiple", "options": list(self.options(dict(columns)).values())}
            return self._by_part(fields, _("Each row becomes a separate question."))
        content: Item = {"kind": "text"}
        if is_number:
            least, most = self._number("multiflexible_min"), self._number("multiflexible_max")
            content = {"kind": "number", "minimum": least, "maximum": most}
        cells = ((*row, *column) for row in self._parts() for column in columns)
        parts = (
            (self.key(row, column), self.draft.joined(label, heading), content)
            for row, label, column, heading in cells
        )
        return self.apart(_("Each cell becomes a separate question."), parts)

    def free_text(self) -> list[Item]:
        """S, T, U: a text, or a number where only numbers are allowed."""
        if self.question.attribute("numbers_only") == "1":
            return self.number()
        lines = _LINES[self.kind]
        length = self.length(self._number("maximum_chars"), is_line=lines == 1)
        return [self.item("text", lines=lines, max_length=length)]

    def texts(self) -> list[Item]:
        """Q: several texts."""
        return self._by_part({"kind": "text"}, _("Each line becomes a separate question."))

    def _number_fields(self) -> Item:
        suffix = self._attribute_text("suffix")
        if any(self.question.attribute_texts("prefix").values()):
            self.note.changed(_("The text before the number is not imported."))
        least, most = (self._number(f"{name}_num_value_n") for name in ("min", "max"))
        is_whole = self.question.attribute("num_value_int_only") == "1"
        return {"minimum": least, "maximum": most, "whole": is_whole, "unit": suffix}

    def number(self) -> list[Item]:
        """N: a number."""
        return [self.item("number", **self._number_fields())]

    def numbers(self) -> list[Item]:
        """K: several numbers, or sliders."""
        if self.question.attribute("slider_layout") == "1":
            return self.apart(_("Each slider becomes a separate question."), self._sliders())
        for rule in ("min_num_value", "max_num_value", "equals_num_value"):
            if value := self.question.attribute(rule):
                self.unchecked(f"{rule} = {value}")
        fields = {"kind": "number", **self._number_fields()}
        return self._by_part(fields, _("Each line becomes a separate question."))

    def _sliders(self) -> Iterator[tuple[str, Text, Item]]:
        least, most = self._number("slider_min"), self._number("slider_max")
        low, high = int(least or 0), int(100 if most is None else most)
        step = self._number("slider_accuracy") or 1
        if step != int(step):
            self.note.changed(_("It accepts only whole numbers."))
        separator = self.question.attribute("slider_separator") or "|"
        for code, label in self._parts():
            words = {language: [*one.split(separator), "", ""] for language, one in label.items()}
            own, *ends = ({one: parts[n].strip() for one, parts in words.items()} for n in range(3))
            left, right = (end if all(end.values()) else {} for end in ends)
            yield self.key(code), own, self.slider(low, high, left, right, max(int(step), 1))

    def day(self) -> list[Item]:
        """D: a day."""
        if any(sign in self.question.attribute("date_format") for sign in ("H", "M:")):
            self.note.changed(_("It asks for the date, not the time."))
        get = self.question.attribute
        first, last = (self.date_bound(one, get(one)) for one in ("date_min", "date_max"))
        return [self.item("date", earliest=first, latest=last)]

    TYPES: ClassVar[Mapping[str, Callable[["LimeSurveyConversion"], list[Item]]]] = {
        **dict.fromkeys("L!OYG", single),
        **dict.fromkeys("MP", multiple),
        **dict.fromkeys("ABCEFH", array),
        **dict.fromkeys(":;", cells),
        **dict.fromkeys("STU", free_text),
        "1": two_scales,
        "5": five_points,
        "D": day,
        "K": numbers,
        "N": number,
        "Q": texts,
        "R": ranking,
    }


# --- the file -------------------------------------------------------------------------------------

_OR = re.compile(r"\|\||\bor\b")
# One comparison of an expression: Q1.NAOK == "A1", Q2_SQ001 == 'Y', that.Q1 == 5.
_COMPARISON = re.compile(
    r"""(?:that\.)?(?P<name>[A-Za-z][A-Za-z0-9_]*)(?:\.(?:NAOK|value|code|valueNAOK))?
    \s*(?:==|\beq\b)\s*(?P<answer>"[^"]*"|'[^']*'|-?\d+)""",
    re.VERBOSE,
)


class Lss(SurveyFormat):
    label: ClassVar[str] = "LimeSurvey (.lss)"

    def __init__(self, document: bytes, _language: str, _form: str) -> None:
        root = safe_xml.read(document)
        kind = root.findtext("LimeSurveyDocType") or ""
        if root.tag != "document" or kind != "Survey":
            words = _("This is not a LimeSurvey survey structure (its type is “%(kind)s”).")
            raise BadDefinitionError([words % {"kind": kind[:40] or root.tag[:40]}])
        self.tables = tables_of(root)
        self.survey = survey_of(self.tables)
        listed = [one.text or "" for one in root.iterfind("languages/language")]
        named = map(language_of, [self.survey.get("language"), *listed])
        languages = list(dict.fromkeys(filter(None, named)))
        self.into = Draft("limesurvey", self.label, languages or ["en"])

    @classmethod
    def is_in(cls, document: bytes) -> bool:
        return document.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"<")

    def convert(self) -> None:
        into, about = self.into, Note(_("Welcome text"))
        into.title = into.text(self.survey.text("surveyls_title"), Note(""), limit=200)
        columns = ("surveyls_description", "surveyls_welcometext")
        texts = [into.text(self.survey.text(column), about) for column in columns]
        into.intro = into.shortened(into.joined(*texts, by="\n\n"), about)
        into.report.notes += [about] if into.intro else []
        into.source = f"LimeSurvey, {self.survey.get('sid')}".rstrip(", ")
        for group in self.survey.parts:
            self._take_group(group)
        self._rest()

    def _take_group(self, group: LimeSurveyRow) -> None:
        names = group.text("group_name")
        note = Note(_("Group: %(name)s") % {"name": next(iter(names.values()), "")})
        title = self.into.text(names, note, limit=200)
        intro = self.into.text(group.text("description"), note)
        condition = self._condition(note, group.get("grelevance"))
        if group.get("randomization_group"):
            words = _(
                "The random order of groups is not imported: groups are asked in the written order."
            )
            note.changed(words)
        self.into.report.notes += [note] if note.remarks else []
        self.into.page(title, intro, condition)
        for question in group.parts:
            if self.survey.get("format") == "S":
                self.into.page(title, {}, condition)
            self._ask(question)

    def _ask(self, question: LimeSurveyRow) -> None:
        texts = question.texts
        shown = texts.get(self.into.languages[0]) or next(iter(texts.values()), {})
        note = self.into.note(question.get("title"), shown.get("question", ""))
        with self.into.trying(note):
            if question.attribute("hidden") == "1":
                raise NotImportedError(_("It is hidden from respondents."))
            asked = LimeSurveyConversion(self.into, note, question)
            if question.get("type") == "X":
                self.into.introduce(note, asked.texts_of(question))
                if self._condition(note, question.get("relevance")):
                    note.changed(_("Its condition is not imported: it is shown to everybody."))
            else:
                condition = self._condition(note, question.get("relevance"))
                self.into.ask(note, asked.items(), condition)
                self._remark(asked)

    def _remark(self, asked: LimeSurveyConversion) -> None:
        note, question = asked.note, asked.question
        named = NAMES["unsupported"].items()
        lost = [words for name, words in named if question.attribute(name) not in {"", "0", "N"}]
        for words in [*lost, "validation"] if question.get("preg") else lost:
            note.changed(_("Not imported: %(what)s."), what=words)
        if any(part.get("relevance") not in {"", "1"} for part in question.parts):
            note.changed(_("Conditions of single options are not imported: all are shown."))
        has_scores = any(one.get("assessment_value") not in {"", "0"} for one in question.answers)
        if self.survey.get("assessments") == "Y" and has_scores:
            note.changed(_("Its scores are not imported."))
        for text in question.text("help").values():
            asked.note_reversal(text[:200])

    def _condition(self, note: Note, expression: str) -> Item | None:
        if expression.strip() in {"", "1"}:
            return None
        return self.into.comparisons(note, expression, _OR, _COMPARISON)

    def _rest(self) -> None:
        nowhere = _("This site has no equivalent.")
        for table, words in NAMES["tables"].items():
            if self.tables.get(table):
                self.into.leave_out(words, nowhere)
        if self.tables.get("defaultvalues"):
            reason = _("Its default answer is not imported: no answer is preselected.")
            self.into.leave_out("default values", reason)
        for column in ("surveyls_endtext", "surveyls_policy_notice"):
            texts = self.survey.text(column).values()
            if text := next((one for one in texts if one.strip()), ""):
                self.into.leave_out(column, nowhere, text)
