"""The tables of a LimeSurvey survey structure (.lss), joined to groups, questions and answers.

The file is an export of database tables as XML (application/helpers/export_helper.php,
`surveyGetXMLStructure`, and `buildXMLFromQuery` in LimeSurvey's source). Up to version 3 a row of
`groups`, `questions`, `subquestions` and `answers` is there once for each language and holds the
text; since version 4 (database version 400 and later) the texts are in `group_l10ns`,
`question_l10ns` and `answer_l10ns`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from surveys.importing.draft import language_of, number_in

Row = Mapping[str, str]
Tables = Mapping[str, Sequence[Row]]


@dataclass
class LimeSurveyRow:
    """A survey with its groups in `parts`, a group with its questions, a question with its
    subquestions, or an answer option. `texts` has a row for each language, by its name here;
    `attributes` are by name and language, "" for those without one.
    """

    row: Row
    texts: dict[str, Row] = field(default_factory=dict)
    attributes: dict[tuple[str, str], str] = field(default_factory=dict)
    parts: list["LimeSurveyRow"] = field(default_factory=list)
    answers: list["LimeSurveyRow"] = field(default_factory=list)

    def get(self, column: str) -> str:
        return self.row.get(column, "")

    def text(self, column: str) -> dict[str, str]:
        return {language: row.get(column, "") for language, row in self.texts.items()}

    def attribute(self, name: str) -> str:
        return self.attributes.get((name, ""), "")

    def attribute_texts(self, name: str) -> dict[str, str]:
        return {lang: text for (one, lang), text in self.attributes.items() if one == name and lang}


def survey_of(tables: Tables) -> LimeSurveyRow:
    """Return the survey in the tables of a file; rows that belong to nothing are left out."""
    settings = next(iter(tables.get("surveys", ())), {})
    rows = tables.get("surveys_languagesettings", ())
    texts = {_language(row.get("surveyls_language", "")): row for row in rows}
    questions = _questions(tables)
    groups = _localized(tables, "groups", ["gid"], "group_l10ns", "gid")
    for group in groups:
        group.parts = [one for one in questions if one.row.get("gid") == group.get("gid")]
    groups.sort(key=lambda group: number_in(group.get("group_order")) or 0.0)
    return LimeSurveyRow(settings, texts, parts=groups)


def tables_of(root: Element) -> Tables:
    found = ((table.tag, table.iterfind("rows/row")) for table in root)
    return {tag: [{cell.tag: cell.text or "" for cell in row} for row in one] for tag, one in found}


def _language(code: str) -> str:
    return language_of(code) or code


def _localized(
    tables: Tables, table: str, keys: Sequence[str], texts: str, joined_by: str
) -> list[LimeSurveyRow]:
    """Return rows that differ in their keys, with texts by language from here and from `texts`."""
    others: dict[str, dict[str, Row]] = {}
    for row in tables.get(texts, ()):
        others.setdefault(row.get(joined_by, ""), {})[_language(row.get("language", ""))] = row
    found: dict[tuple[str, ...], LimeSurveyRow] = {}
    for row in tables.get(table, ()):
        own = LimeSurveyRow(row, dict(others.get(row.get(joined_by, ""), {})))
        own = found.setdefault(tuple(map(own.get, keys)), own)
        if row.get("language"):
            own.texts[_language(row["language"])] = row
    return list(found.values())


def _questions(tables: Tables) -> list[LimeSurveyRow]:
    found: dict[str, LimeSurveyRow] = {}
    for table in ("questions", "subquestions"):
        for one in _localized(tables, table, ["qid"], "question_l10ns", "qid"):
            found.setdefault(one.get("qid"), one)
    for row in tables.get("question_attributes", ()):
        if question := found.get(row.get("qid", "")):
            name = (row.get("attribute", ""), _language(row.get("language", "")))
            question.attributes[name] = row.get("value", "")
    answers = _localized(tables, "answers", ["qid", "scale_id", "code"], "answer_l10ns", "aid")
    for answer in sorted(answers, key=lambda one: number_in(one.get("sortorder")) or 0.0):
        if question := found.get(answer.get("qid")):
            question.answers.append(answer)
    in_order = sorted(found.values(), key=lambda one: number_in(one.get("question_order")) or 0.0)
    for one in in_order:
        if parent := found.get(one.row.get("parent_qid", "0")):
            parent.parts.append(one)
    return [one for one in in_order if one.row.get("parent_qid", "0") in {"0", ""}]
