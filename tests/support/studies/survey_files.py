"""Files of other survey systems for tests, as short as they can be and in the shapes of real ones.

The files are written by hand. Their shapes were checked against public files: those of QSF
against the sample surveys of ctesta01/QualtricsTools, the test data of fflewddur/sp and the data of
sumtxt/qsf; those of LSS against LimeSurvey's own test surveys (old shape, a row for each language)
and amaltawfik/lssdoc (new shape, texts in tables of their own); those of REDCap against
vubiostat/redcapAPI and ReproNim/reproschema-py.
"""

import csv
import io
import json
from xml.sax.saxutils import escape

from surveys.definition import Definition, to_json
from surveys.importing.reading import read
from surveys.importing.report import ImportOutcome
from surveys.item import ScalePoint

# --- results of an import -------------------------------------------------------------------------


def definition_of(document: bytes) -> Definition:
    return read(document).definition("test", 1)


def items(document: bytes) -> list[dict]:
    pages = json.loads(to_json(definition_of(document)))["pages"]
    return [item for page in pages for item in page["items"]]


def points_of(document: bytes) -> tuple[ScalePoint, ...]:
    """Return the points of the questionnaire's only scale."""
    (points,) = definition_of(document).scales.values()
    return points


def remarks(document: bytes, name: str) -> str:
    draft = read(document)
    (note,) = [one for one in draft.report.notes if one.name == name]
    return " ".join(note.remarks)


def outcomes(document: bytes) -> dict[str, ImportOutcome]:
    return {note.name: note.outcome for note in read(document).report.notes}


# --- Qualtrics ------------------------------------------------------------------------------------


def displays(*texts: str, **by_id: dict) -> dict:
    """Return choices with ids from 1."""
    return {str(n): {"Display": text} for n, text in enumerate(texts, start=1)} | by_id


def payload(qid: str, kind: str, selector: str, sub: str | None = None, **more) -> dict:
    return {
        "QuestionID": qid,
        "DataExportTag": more.pop("tag", qid),
        "QuestionText": more.pop("text", f"Text of {qid}"),
        "QuestionType": kind,
        "Selector": selector,
        "SubSelector": sub,
        "Configuration": {"QuestionDescriptionOption": "UseText"},
        "Validation": {"Settings": {"ForceResponse": "OFF", "Type": "None"}},
        "Language": [],
        **more,
    }


def qsf_document(*payloads: dict, blocks=None, flow=None, extra=(), **entry) -> dict:
    """Return a survey with these questions in one block, unless `blocks` says otherwise."""
    ids = [{"Type": "Question", "QuestionID": one["QuestionID"]} for one in payloads]
    blocks = blocks or [{"Type": "Default", "ID": "BL_1", "BlockElements": ids}]
    flow = flow or [{"Type": "Block", "ID": block["ID"]} for block in blocks]
    questions = [
        {"Element": "SQ", "PrimaryAttribute": one["QuestionID"], "Payload": one} for one in payloads
    ]
    about = {"SurveyID": "SV_1", "SurveyName": "A survey", "SurveyLanguage": "EN", **entry}
    return {
        "SurveyEntry": about,
        "SurveyElements": [
            {"Element": "BL", "PrimaryAttribute": "Survey Blocks", "Payload": blocks},
            {"Element": "FL", "Payload": {"Type": "Root", "Flow": flow}},
            *questions,
            *extra,
        ],
    }


def qsf(*payloads: dict, **more) -> bytes:
    return json.dumps(qsf_document(*payloads, **more)).encode()


# --- LimeSurvey -----------------------------------------------------------------------------------


def _table(name: str, rows: list[dict]) -> str:
    def cell(key: str, value: str) -> str:
        return f"<{key}><![CDATA[{value}]]></{key}>" if value != "" else f"<{key}/>"

    written = "".join(
        f"<row>{''.join(cell(key, str(value)) for key, value in row.items())}</row>" for row in rows
    )
    return f"<{name}><fields><fieldname>x</fieldname></fields><rows>{written}</rows></{name}>"


def lime(
    letter: str, title: str, parts=(), answers=(), attributes=None, gid=1, texts=None, **row
) -> dict:
    """Return a question. `parts` are (code, text) or (code, text, scale) of subquestions, `answers`
    likewise; a text may be an object of languages.
    """
    return {
        "type": letter,
        "title": title,
        "parts": [tuple(part) if len(part) == 3 else (*part, 0) for part in parts],
        "answers": [tuple(one) if len(one) == 3 else (*one, 0) for one in answers],
        "attributes": attributes or {},
        "gid": gid,
        "texts": texts or f"Text of {title}",
        "row": {"mandatory": "N", "other": "N", "relevance": "1", **row},
    }


def lss(*questions: dict, languages=("en",), groups=("First",), more="", settings=None) -> bytes:
    """Return a survey structure in the shape of LimeSurvey 4 and later."""
    rows, subs, l10n, answers, answer_l10n, attributes = [], [], [], [], [], []
    qid = aid = 100

    def say(into: list, key: dict, field: str, text) -> None:
        for lang in languages:
            value = text.get(lang, "") if isinstance(text, dict) else text
            into.append({**key, field: value, "help": "", "language": lang})

    for order, one in enumerate(questions, start=1):
        qid += 1
        own = qid
        common = {"qid": own, "parent_qid": 0, "gid": one["gid"], "type": one["type"]}
        rows.append({**common, "title": one["title"], "question_order": order, **one["row"]})
        say(l10n, {"qid": own}, "question", one["texts"])
        for place, (code, text, scale) in enumerate(one["parts"]):
            qid += 1
            sub = {"qid": qid, "parent_qid": own, "gid": one["gid"], "type": "T", "title": code}
            subs.append({**sub, "scale_id": scale, "question_order": place, "relevance": "1"})
            say(l10n, {"qid": qid}, "question", text)
        for place, (code, text, scale) in enumerate(one["answers"]):
            aid += 1
            answers.append(
                {"aid": aid, "qid": own, "code": code, "scale_id": scale, "sortorder": place}
            )
            say(answer_l10n, {"aid": aid}, "answer", text)
        for name, value in one["attributes"].items():
            for lang in languages if isinstance(value, dict) else ("",):
                text = value[lang] if isinstance(value, dict) else value
                attributes.append({"qid": own, "attribute": name, "value": text, "language": lang})
    group_rows = [{"gid": n, "group_order": n} for n in range(1, len(groups) + 1)]
    group_l10n = [
        {"gid": n, "group_name": name, "description": "", "language": lang}
        for n, name in enumerate(groups, start=1)
        for lang in languages
    ]
    titles = [
        {"surveyls_language": lang, "surveyls_title": f"Survey in {lang}"} for lang in languages
    ]
    about = {"sid": 7, "language": languages[0], "format": "G", **(settings or {})}
    tables = {
        "answers": answers,
        "answer_l10ns": answer_l10n,
        "groups": group_rows,
        "group_l10ns": group_l10n,
        "questions": rows,
        "subquestions": subs,
        "question_l10ns": l10n,
        "question_attributes": attributes,
        "surveys": [about],
        "surveys_languagesettings": titles,
    }
    return lss_of(tables, languages, more)


def lss_of(tables: dict[str, list[dict]], languages=("en",), more="", version=640) -> bytes:
    """Return a file with these tables."""
    named = "".join(f"<language>{escape(lang)}</language>" for lang in languages)
    written = "".join(_table(name, rows) for name, rows in tables.items() if rows)
    return (
        '<?xml version="1.0" encoding="UTF-8"?><document>'
        "<LimeSurveyDocType>Survey</LimeSurveyDocType>"
        f"<DBVersion>{version}</DBVersion><languages>{named}</languages>{written}{more}</document>"
    ).encode()


# --- REDCap ---------------------------------------------------------------------------------------

REDCAP_HEADINGS = {
    "name": "Variable / Field Name",
    "form": "Form Name",
    "header": "Section Header",
    "kind": "Field Type",
    "label": "Field Label",
    "choices": "Choices, Calculations, OR Slider Labels",
    "note": "Field Note",
    "rule": "Text Validation Type OR Show Slider Number",
    "least": "Text Validation Min",
    "most": "Text Validation Max",
    "identifier": "Identifier?",
    "branching": "Branching Logic (Show field only if...)",
    "required": "Required Field?",
    "alignment": "Custom Alignment",
    "number": "Question Number (surveys only)",
    "matrix": "Matrix Group Name",
    "ranking": "Matrix Ranking?",
    "annotation": "Field Annotation",
}


def field(name: str, kind: str, **more: str) -> dict[str, str]:
    """Return a row of a dictionary."""
    row = {"name": name, "form": "form_one", "kind": kind, "label": f"Text of {name}"} | more
    return {REDCAP_HEADINGS[key]: value for key, value in row.items()}


def redcap(*rows: dict[str, str], delimiter: str = ",", headings=None) -> bytes:
    """Return a dictionary; the field that names the record comes first, as in every one."""
    out = io.StringIO()
    writer = csv.DictWriter(
        out, headings or REDCAP_HEADINGS.values(), delimiter=delimiter, restval=""
    )
    writer.writeheader()
    writer.writerows([field("record_id", "text"), *rows])
    return out.getvalue().encode()
