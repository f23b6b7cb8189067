"""The tables of a LimeSurvey survey structure (.lss), joined to groups, questions and answers.

The file is an export of database tables as XML (application/helpers/export_helper.php,
`surveyGetXMLStructure`, and `buildXMLFromQuery` in LimeSurvey's source). Up to version 3 a row of
`groups`, `questions`, `subquestions` and `answers` is there once for each language and holds the
text; since version 4 (database version 400 and later) the texts are in `group_l10ns`,
`question_l10ns` and `answer_l10ns`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

Row = Mapping[str, str]
Texts = dict[str, dict[str, str]]


@dataclass
class LimeSurveyAnswer:
    """An answer option. `texts` is by language; `scale` tells the two scales of some arrays."""

    code: str
    scale: str
    score: str
    texts: dict[str, str]


@dataclass
class LimeSurveyQuestion:
    """A question or, in `parts`, one of its subquestions. `texts` has `question` and `help` by
    language; `attributes` are by name and language, "" for those without one.
    """

    qid: str
    type: str
    title: str
    row: Row
    texts: Texts
    attributes: dict[tuple[str, str], str] = field(default_factory=dict)
    parts: list["LimeSurveyQuestion"] = field(default_factory=list)
    answers: list[LimeSurveyAnswer] = field(default_factory=list)

    def attribute(self, name: str) -> str:
        """Return an attribute that has no language; "" when it is not set."""
        return self.attributes.get((name, ""), "")

    def attribute_texts(self, name: str) -> dict[str, str]:
        """Return an attribute by language."""
        return {lang: text for (one, lang), text in self.attributes.items() if one == name and lang}


@dataclass
class LimeSurveyGroup:
    """Questions that stand together."""

    gid: str
    row: Row
    texts: Texts
    questions: list[LimeSurveyQuestion]


@dataclass
class Survey:
    """All of them. `settings` is the survey's row, `texts` its texts by language."""

    languages: list[str]
    settings: Row
    texts: Texts
    groups: list[LimeSurveyGroup]
    others: dict[str, int]


def survey_of(root: Element) -> Survey:
    """Return what the tables of a file hold; rows that belong to nothing are left out."""
    tables = {table.tag: _rows(table) for table in root if table.find("rows") is not None}
    settings = next(iter(tables.get("surveys", ())), {})
    first = settings.get("language", "")
    named = [one.text or "" for one in root.findall("languages/language")]
    languages = list(dict.fromkeys([first, *named] if first else named))
    questions = _questions(tables)
    groups = [
        LimeSurveyGroup(gid, row, texts, [one for one in questions if one.row.get("gid") == gid])
        for gid, (row, texts) in _localized(tables, "groups", "gid", "group_l10ns").items()
    ]
    groups.sort(key=lambda group: _number(group.row.get("group_order")))
    texts = {
        row.get("surveyls_language", ""): dict(row)
        for row in tables.get("surveys_languagesettings", ())
    }
    others = {name: len(rows) for name, rows in tables.items() if rows}
    return Survey(languages, settings, texts, groups, others)


def has_scores(answers: list[LimeSurveyAnswer]) -> bool:
    """Tell whether any answer has a score."""
    return any(answer.score not in {"", "0"} for answer in answers)


def _rows(table: Element) -> list[Row]:
    return [{cell.tag: cell.text or "" for cell in row} for row in table.findall("rows/row")]


def _localized(
    tables: Mapping[str, list[Row]], table: str, key: str, texts: str
) -> dict[str, tuple[Row, Texts]]:
    """Return each row of a table by its key, with its texts by language."""
    rows: dict[str, tuple[Row, Texts]] = {}
    for row in tables.get(table, ()):
        _first, found = rows.setdefault(row.get(key, ""), (row, {}))
        if row.get("language"):
            found[row["language"]] = dict(row)
    for row in tables.get(texts, ()):
        if row.get(key, "") in rows:
            rows[row[key]][1][row.get("language", "")] = dict(row)
    return rows


def _questions(tables: Mapping[str, list[Row]]) -> list[LimeSurveyQuestion]:
    found: dict[str, LimeSurveyQuestion] = {}
    for table in ("questions", "subquestions"):
        for qid, (row, texts) in _localized(tables, table, "qid", "question_l10ns").items():
            found.setdefault(
                qid, LimeSurveyQuestion(qid, row.get("type", ""), row.get("title", ""), row, texts)
            )
    for row in tables.get("question_attributes", ()):
        if row.get("qid", "") in found:
            name = (row.get("attribute", ""), row.get("language", ""))
            found[row["qid"]].attributes[name] = row.get("value", "")
    _add_answers(tables, found)
    in_order = sorted(found.values(), key=lambda one: _number(one.row.get("question_order")))
    for one in in_order:
        parent = found.get(one.row.get("parent_qid", "0"))
        if parent is not None:
            parent.parts.append(one)
    return [one for one in in_order if one.row.get("parent_qid", "0") in {"0", ""}]


def _add_answers(
    tables: Mapping[str, list[Row]], questions: Mapping[str, LimeSurveyQuestion]
) -> None:
    rows: dict[tuple[str, str, str], tuple[Row, dict[str, str]]] = {}
    texts: dict[str, dict[str, str]] = {}
    for row in tables.get("answer_l10ns", ()):
        texts.setdefault(row.get("aid", ""), {})[row.get("language", "")] = row.get("answer", "")
    for row in tables.get("answers", ()):
        key = (row.get("qid", ""), row.get("scale_id", "0"), row.get("code", ""))
        _first, found = rows.setdefault(key, (row, dict(texts.get(row.get("aid", ""), {}))))
        if row.get("language"):
            found[row["language"]] = row.get("answer", "")
    for (qid, scale, code), (row, found) in sorted(
        rows.items(), key=lambda one: _number(one[1][0].get("sortorder"))
    ):
        if qid in questions:
            answer = LimeSurveyAnswer(code, scale, row.get("assessment_value", "0"), found)
            questions[qid].answers.append(answer)


def _number(text: str | None) -> float:
    try:
        return float(text or 0)
    except ValueError:
        return 0.0
