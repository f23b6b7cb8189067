"""LimeSurvey survey structures (.lss): XML with the rows of LimeSurvey's tables.

Read against LimeSurvey's own source (application/helpers/export_helper.php) and its test surveys
(tests/data/surveys/, database versions 264 to 359), the demonstration survey of amaltawfik/lssdoc
(version 700, 27 types of questions in four languages) and the surveys of
TonisOrmisson/limesurvey-structure-imex (version 630).
"""

import re
from collections.abc import Callable
from typing import Any, ClassVar

from django.utils.translation import gettext as _

from surveys.documents import BadDefinitionError
from surveys.importing import safe_xml
from surveys.importing.draft import Draft, Item, language_of
from surveys.importing.limesurvey.arrays import array, cells, two_scales
from surveys.importing.limesurvey.choices import five_points, fixed, multiple, ranking, single
from surveys.importing.limesurvey.entries import day, free_text, number, numbers, texts
from surveys.importing.limesurvey.question import LimeSurveyConversion
from surveys.importing.limesurvey.tables import (
    LimeSurveyGroup,
    LimeSurveyQuestion,
    Survey,
    has_scores,
    survey_of,
)
from surveys.importing.parts import note_reversal
from surveys.importing.report import Note, NotImportedError
from surveys.importing.survey_format import SurveyFormat, Wishes

# By LimeSurvey's letters (its `Question` model); a letter without an entry has no counterpart.
_TYPES: dict[str, Callable[[LimeSurveyConversion], list[Item]]] = {
    **dict.fromkeys("L!O", single),
    **dict.fromkeys("YG", fixed),
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
_NAMES = {"|": "file upload", "*": "equation", "I": "language switch"}
# One comparison of an expression: Q1.NAOK == "A1", Q2_SQ001 == 'Y', that.Q1 == 5.
_COMPARED = re.compile(
    r"""^\(*\s*(?:that\.)?(?P<name>[A-Za-z][A-Za-z0-9_]*)(?:\.(?:NAOK|value|code|valueNAOK))?
    \s*(?:==|\beq\b)\s*(?:"(?P<one>[^"]*)"|'(?P<two>[^']*)'|(?P<three>-?\d+))\s*\)*$""",
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
    "max_subquestions": "",
}
# Tables of the file that have no counterpart, with their names for people.
_TABLES = {
    "quota": "quotas",
    "assessments": "assessments",
    "survey_url_parameters": "URL parameters",
    "plugin_settings": "plugin settings",
}
_TEXTS = ("surveyls_endtext", "surveyls_policy_notice")


class Lss(SurveyFormat):
    """A survey structure exported from LimeSurvey."""

    label: ClassVar[str] = "LimeSurvey (.lss)"

    @classmethod
    def is_in(cls, document: bytes) -> bool:
        """Tell by the mark of XML."""
        return document.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"<")

    @classmethod
    def read(cls, document: bytes, _wishes: Wishes) -> Draft:
        """Return what a file asks.

        Raises:
            BadDefinitionError: it is no such file.
        """
        root = safe_xml.read(document)
        kind = root.findtext("LimeSurveyDocType") or ""
        if root.tag != "document" or kind != "Survey":
            raise BadDefinitionError(
                [
                    _("This is not a LimeSurvey survey structure (its type is “%(kind)s”).")
                    % {"kind": kind[:40] or root.tag[:40]}
                ]
            )
        return _LssConversion(survey_of(root)).draft()


class _LssConversion:
    """One file, group by group."""

    def __init__(self, survey: Survey) -> None:
        self.survey = survey
        names = {code: language_of(code) for code in survey.languages}
        languages = list(dict.fromkeys(name for name in names.values() if name)) or ["en"]
        for one in _all_texts(survey):
            for code in list(one):
                if code in names and names[code] not in {"", code}:
                    one[names[code]] = one.pop(code)
        for question in (one for group in survey.groups for one in group.questions):
            question.attributes = {
                (name, names.get(code) or code): value
                for (name, code), value in question.attributes.items()
            }
        self.into = Draft("limesurvey", Lss.label, languages)

    def draft(self) -> Draft:
        """Return what it asks."""
        about = Note("")
        into = self.into
        into.title = into.text(self._survey_text("surveyls_title"), about, limit=200)
        heading = self.into.note(_("Welcome text"), "")
        intro = into.joined(
            into.text(self._survey_text("surveyls_description"), heading),
            into.text(self._survey_text("surveyls_welcometext"), heading),
            by="\n\n",
        )
        into.intro = into.shortened(intro, heading)
        if not into.intro:
            into.report.notes.remove(heading)
        into.source = f"LimeSurvey, {self.survey.settings.get('sid', '')}".rstrip(", ")
        for group in self.survey.groups:
            self._take_group(group)
        self._rest()
        into.finish()
        return into

    def _survey_text(self, field: str) -> dict[str, str]:
        return {lang: row.get(field, "") for lang, row in self.survey.texts.items()}

    def _take_group(self, group: LimeSurveyGroup) -> None:
        name = next((row.get("group_name", "") for row in group.texts.values()), "")
        note = Note(_("Group: %(name)s") % {"name": name})
        title = self.into.text(
            {lang: row.get("group_name", "") for lang, row in group.texts.items()}, note, limit=200
        )
        intro = self.into.text(
            {lang: row.get("description", "") for lang, row in group.texts.items()}, note
        )
        condition = self._condition(note, group.row.get("grelevance", ""))
        if group.row.get("randomization_group"):
            note.changed(
                _(
                    "The random order of groups is not imported: groups are asked in the "
                    "written order."
                )
            )
        if note.remarks:
            self.into.report.notes.append(note)
        self.into.page(title, intro, condition)
        for question in group.questions:
            if self.survey.settings.get("format") == "S":
                self.into.page(title, None, condition)
            self._ask(question)

    def _ask(self, question: LimeSurveyQuestion) -> None:
        shown = question.texts.get(self.into.languages[0]) or next(
            iter(question.texts.values()), {}
        )
        note = self.into.note(question.title, shown.get("question", ""))
        with self.into.trying(note):
            if question.attribute("hidden") == "1":
                raise NotImportedError(_("It is hidden from respondents."))
            if question.type == "X":
                asked = LimeSurveyConversion(self.into, note, question)
                self.into.say(note, asked.texts_of(question))
                if self._condition(note, question.row.get("relevance", "")):
                    note.changed(_("Its condition is not imported: it is shown to everybody."))
            else:
                self._take_question(note, question)

    def _take_question(self, note: Note, question: LimeSurveyQuestion) -> None:
        condition = self._condition(note, question.row.get("relevance", ""))
        items = _items_of(LimeSurveyConversion(self.into, note, question))
        if condition is not None:
            items = [{"show_if": condition} | item for item in items]
        self.into.ask(note, items)
        for attribute, words in _UNSUPPORTED.items():
            if words and question.attribute(attribute) not in {"", "0", "N"}:
                note.changed(_("Not imported: %(what)s.") % {"what": words})
        if question.row.get("preg"):
            note.changed(_("Not imported: %(what)s.") % {"what": "validation"})
        if any(part.row.get("relevance", "") not in {"", "1"} for part in question.parts):
            note.changed(_("Conditions of single options are not imported: all are shown."))
        if self.survey.settings.get("assessments") == "Y" and has_scores(question.answers):
            note.changed(_("Its scores are not imported."))
        for row in question.texts.values():
            note_reversal(note, row.get("help", "")[:200])

    def _condition(self, note: Note, expression: str) -> dict[str, Any] | None:
        """Return `show_if` for comparisons of one question with answers, joined by "or"; anything
        else is noted.
        """
        if expression.strip() in {"", "1"}:
            return None
        found = [
            _COMPARED.match(part.strip())
            for part in re.split(r"\|\||\bor\b", expression.strip("() "))
        ]
        condition = None
        if all(found):
            condition = self.into.condition(
                (one["name"], one["one"] or one["two"] or one["three"] or "")
                for one in found
                if one is not None
            )
        if condition is None:
            note.changed(
                _("Its condition is not imported: it is shown to everybody (%(condition)s).")
                % {"condition": expression[:100]}
            )
        return condition

    def _rest(self) -> None:
        for table, words in _TABLES.items():
            if self.survey.others.get(table):
                self.into.leave_out(words, _("This site has no equivalent."))
        if self.survey.others.get("defaultvalues"):
            self.into.leave_out(
                "default values", _("Its default answer is not imported: no answer is preselected.")
            )
        for field in _TEXTS:
            for text in self._survey_text(field).values():
                if text.strip():
                    self.into.leave_out(field, _("This site has no equivalent."), text)
                    break


def _all_texts(survey: Survey) -> list[dict[str, Any]]:
    """Return every object of the survey that has a language for its key."""
    questions = [question for group in survey.groups for question in group.questions]
    every = [one for question in questions for one in (question, *question.parts)]
    return [
        survey.texts,
        *(group.texts for group in survey.groups),
        *(one.texts for one in every),
        *(answer.texts for one in every for answer in one.answers),
    ]


def _items_of(asked: LimeSurveyConversion) -> list[Item]:
    """Return what a question becomes.

    Raises:
        NotImportedError: it has no counterpart here.
    """
    converter = _TYPES.get(asked.question.type)
    if converter is None:
        kind = _NAMES.get(asked.question.type, asked.question.type)
        raise NotImportedError(
            _("Questions of the type %(kind)s are not supported.") % {"kind": kind}
        )
    return converter(asked)
