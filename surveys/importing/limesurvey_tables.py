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

from surveys.importing.draft import language_of

Row = Mapping[str, str]
Texts = Mapping[str, Row]  # a row for each language, by its name here
Tables = Mapping[str, Sequence[Row]]


@dataclass
class LimeSurveyAnswer:
    """An answer option. `scale` tells the two scales of some arrays."""

    code: str
    scale: str
    score: str
    texts: Mapping[str, str]


@dataclass
class LimeSurveyQuestion:
    """A question or, in `parts`, one of its subquestions. `texts` has `question` and `help` by
    language; `attributes` are by name and language, "" for those without one.
    """

    row: Row
    texts: Texts
    attributes: dict[tuple[str, str], str] = field(default_factory=dict)
    parts: list["LimeSurveyQuestion"] = field(default_factory=list)
    answers: list[LimeSurveyAnswer] = field(default_factory=list)

    @property
    def type(self) -> str:
        return self.row.get("type", "")

    @property
    def title(self) -> str:
        return self.row.get("title", "")

    def attribute(self, name: str) -> str:
        """Return an attribute that has no language; "" when it is not set."""
        return self.attributes.get((name, ""), "")

    def attribute_texts(self, name: str) -> dict[str, str]:
        return {lang: text for (one, lang), text in self.attributes.items() if one == name and lang}


@dataclass
class LimeSurveyGroup:
    row: Row
    texts: Texts
    questions: list[LimeSurveyQuestion]


@dataclass
class Survey:
    """`settings` is the survey's row, `texts` its texts by language."""

    languages: list[str]
    settings: Row
    texts: Texts
    groups: list[LimeSurveyGroup]
    tables: Tables


def survey_of(root: Element) -> Survey:
    """Return what the tables of a file hold; rows that belong to nothing are left out."""
    tables: Tables = {
        table.tag: [
            {cell.tag: cell.text or "" for cell in row} for row in table.iterfind("rows/row")
        ]
        for table in root
    }
    settings = next(iter(tables.get("surveys", ())), {})
    named = [
        settings.get("language", ""),
        *(one.text or "" for one in root.iterfind("languages/language")),
    ]
    languages = list(dict.fromkeys(filter(None, map(language_of, named))))
    questions = _questions(tables)
    groups = [
        LimeSurveyGroup(
            row, texts, [one for one in questions if one.row.get("gid") == row.get("gid", "")]
        )
        for row, texts in _localized(tables, "groups", ["gid"], "group_l10ns", "gid")
    ]
    groups.sort(key=lambda group: _number(group.row.get("group_order")))
    texts = {
        _language(row.get("surveyls_language", "")): row
        for row in tables.get("surveys_languagesettings", ())
    }
    return Survey(languages or ["en"], settings, texts, groups, tables)


def _language(code: str) -> str:
    return language_of(code) or code


def _localized(
    tables: Tables, table: str, keys: Sequence[str], texts: str, joined_by: str
) -> list[tuple[Row, Texts]]:
    """Return each row of a table that differs in its keys, with its texts by language: rows of the
    same keys, and those of another table.
    """
    others: dict[str, dict[str, Row]] = {}
    for row in tables.get(texts, ()):
        others.setdefault(row.get(joined_by, ""), {})[_language(row.get("language", ""))] = row
    found: dict[tuple[str, ...], tuple[Row, dict[str, Row]]] = {}
    for row in tables.get(table, ()):
        key = tuple(row.get(one, "") for one in keys)
        _first, own = found.setdefault(key, (row, dict(others.get(row.get(joined_by, ""), {}))))
        if row.get("language"):
            own[_language(row["language"])] = row
    return list(found.values())


def _questions(tables: Tables) -> list[LimeSurveyQuestion]:
    found: dict[str, LimeSurveyQuestion] = {}
    for table in ("questions", "subquestions"):
        for row, texts in _localized(tables, table, ["qid"], "question_l10ns", "qid"):
            found.setdefault(row.get("qid", ""), LimeSurveyQuestion(row, texts))
    for row in tables.get("question_attributes", ()):
        if row.get("qid", "") in found:
            name = (row.get("attribute", ""), _language(row.get("language", "")))
            found[row["qid"]].attributes[name] = row.get("value", "")
    keys = ["qid", "scale_id", "code"]
    answers = _localized(tables, "answers", keys, "answer_l10ns", "aid")
    for row, texts in sorted(answers, key=lambda one: _number(one[0].get("sortorder"))):
        if row.get("qid", "") in found:
            labels = {language: text.get("answer", "") for language, text in texts.items()}
            scale, score = row.get("scale_id", "0"), row.get("assessment_value", "0")
            answer = LimeSurveyAnswer(row.get("code", ""), scale, score, labels)
            found[row["qid"]].answers.append(answer)
    in_order = sorted(found.values(), key=lambda one: _number(one.row.get("question_order")))
    for one in in_order:
        if parent := found.get(one.row.get("parent_qid", "0")):
            parent.parts.append(one)
    return [one for one in in_order if one.row.get("parent_qid", "0") in {"0", ""}]


def _number(text: str | None) -> float:
    try:
        return float(text or 0)
    except ValueError:
        return 0.0
