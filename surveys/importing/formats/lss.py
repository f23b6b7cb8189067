"""LimeSurvey survey structures (.lss): XML with the rows of LimeSurvey's tables.

Read against LimeSurvey's own source (application/helpers/export_helper.php) and its test surveys
(tests/data/surveys/, database versions 264 to 359), the demonstration survey of amaltawfik/lssdoc
(version 700, 27 types of questions in four languages) and the surveys of
TonisOrmisson/limesurvey-structure-imex (version 630).
"""

import re
from typing import ClassVar

from django.utils.translation import gettext as _

from surveys.documents import BadDefinitionError, Text
from surveys.importing import safe_xml
from surveys.importing.draft import Draft, Item, Raw, SurveyFormat
from surveys.importing.limesurvey import LimeSurveyConversion
from surveys.importing.limesurvey_tables import (
    LimeSurveyGroup,
    LimeSurveyQuestion,
    Texts,
    survey_of,
)
from surveys.importing.report import Note, NotImportedError

_OR = re.compile(r"\|\||\bor\b")
# One comparison of an expression: Q1.NAOK == "A1", Q2_SQ001 == 'Y', that.Q1 == 5.
_COMPARISON = re.compile(
    r"""(?:that\.)?(?P<name>[A-Za-z][A-Za-z0-9_]*)(?:\.(?:NAOK|value|code|valueNAOK))?
    \s*(?:==|\beq\b)\s*(?P<answer>"[^"]*"|'[^']*'|-?\d+)""",
    re.VERBOSE,
)
# Attributes that change what is asked and have no counterpart, with what is said of them.
_UNSUPPORTED = {
    "array_filter": "array filter",
    "array_filter_exclude": "array filter",
    "em_validation_q": "validation",
    "em_validation_sq": "validation",
    "time_limit": "time limit",
    "random_group": "random group",
    "other_comment_mandatory": "mandatory comment",
}
# Tables of the file that have no counterpart, with their names for people.
_TABLES = {
    "quota": "quotas",
    "assessments": "assessments",
    "survey_url_parameters": "URL parameters",
    "plugin_settings": "plugin settings",
}


class Lss(SurveyFormat):
    """A survey structure exported from LimeSurvey, group by group."""

    label: ClassVar[str] = "LimeSurvey (.lss)"

    def __init__(self, document: bytes, _language: str, _form: str) -> None:
        root = safe_xml.read(document)
        kind = root.findtext("LimeSurveyDocType") or ""
        if root.tag != "document" or kind != "Survey":
            words = _("This is not a LimeSurvey survey structure (its type is “%(kind)s”).")
            raise BadDefinitionError([words % {"kind": kind[:40] or root.tag[:40]}])
        self.survey = survey_of(root)
        self.into = Draft("limesurvey", self.label, self.survey.languages)

    @classmethod
    def is_in(cls, document: bytes) -> bool:
        return document.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"<")

    def convert(self) -> None:
        into, about = self.into, Note(_("Welcome text"))
        title = _field(self.survey.texts, "surveyls_title")
        into.title = into.text(title, Note(""), limit=200)
        intro = into.joined(
            self._text(self.survey.texts, "surveyls_description", about),
            self._text(self.survey.texts, "surveyls_welcometext", about),
            by="\n\n",
        )
        into.intro = into.shortened(intro, about)
        into.report.notes += [about] if intro else []
        into.source = f"LimeSurvey, {self.survey.settings.get('sid', '')}".rstrip(", ")
        for group in self.survey.groups:
            self._take_group(group)
        self._rest()

    def _text(self, texts: Texts, field: str, note: Note) -> Text:
        return self.into.text(_field(texts, field), note)

    def _take_group(self, group: LimeSurveyGroup) -> None:
        names = _field(group.texts, "group_name")
        note = Note(_("Group: %(name)s") % {"name": next(iter(names.values()), "")})
        title = self.into.text(names, note, limit=200)
        intro = self._text(group.texts, "description", note)
        condition = self._condition(note, group.row.get("grelevance", ""))
        if group.row.get("randomization_group"):
            note.changed(
                _(
                    "The random order of groups is not imported: groups are asked in the "
                    "written order."
                )
            )
        self.into.report.notes += [note] if note.remarks else []
        self.into.page(title, intro, condition)
        for question in group.questions:
            if self.survey.settings.get("format") == "S":
                self.into.page(title, None, condition)
            self._ask(question)

    def _ask(self, question: LimeSurveyQuestion) -> None:
        texts = question.texts
        shown = texts.get(self.into.languages[0]) or next(iter(texts.values()), {})
        note = self.into.note(question.title, shown.get("question", ""))
        with self.into.trying(note):
            if question.attribute("hidden") == "1":
                raise NotImportedError(_("It is hidden from respondents."))
            asked = LimeSurveyConversion(self.into, note, question)
            if question.type == "X":
                self.into.introduce(note, asked.texts_of(question))
                if self._condition(note, question.row.get("relevance", "")):
                    note.changed(_("Its condition is not imported: it is shown to everybody."))
            else:
                condition = self._condition(note, question.row.get("relevance", ""))
                self.into.ask(note, asked.items(), condition)
                self._remark(asked)

    def _remark(self, asked: LimeSurveyConversion) -> None:
        """Note what of a question is not imported."""
        note, question = asked.note, asked.question
        lost = [
            words
            for name, words in _UNSUPPORTED.items()
            if question.attribute(name) not in {"", "0", "N"}
        ]
        for words in [*lost, "validation"] if question.row.get("preg") else lost:
            note.changed(_("Not imported: %(what)s."), what=words)
        if any(part.row.get("relevance", "") not in {"", "1"} for part in question.parts):
            note.changed(_("Conditions of single options are not imported: all are shown."))
        has_scores = any(answer.score not in {"", "0"} for answer in question.answers)
        if self.survey.settings.get("assessments") == "Y" and has_scores:
            note.changed(_("Its scores are not imported."))
        for text in _field(question.texts, "help").values():
            asked.note_reversal(text[:200])

    def _condition(self, note: Note, expression: str) -> Item | None:
        if expression.strip() in {"", "1"}:
            return None
        return self.into.comparisons(note, expression, _OR, _COMPARISON)

    def _rest(self) -> None:
        nowhere = _("This site has no equivalent.")
        for table, words in _TABLES.items():
            if self.survey.tables.get(table):
                self.into.leave_out(words, nowhere)
        if self.survey.tables.get("defaultvalues"):
            self.into.leave_out(
                "default values", _("Its default answer is not imported: no answer is preselected.")
            )
        for field in ("surveyls_endtext", "surveyls_policy_notice"):
            texts = _field(self.survey.texts, field).values()
            if text := next((one for one in texts if one.strip()), ""):
                self.into.leave_out(field, nowhere, text)


def _field(texts: Texts, field: str) -> Raw:
    """Return one column of the rows of several languages."""
    return {language: row.get(field, "") for language, row in texts.items()}
