"""Arrays of a LimeSurvey file: subquestions on scales, or a cell for each row and column."""

from collections.abc import Mapping

from django.utils.translation import gettext as _

from surveys.documents import Text
from surveys.importing.draft import Item
from surveys.importing.limesurvey.question import LimeSurveyConversion, by_part, key_for, numbered
from surveys.importing.parts import flags, options, scale, word

WORDED = {"C": ("yes", "uncertain", "no"), "E": ("increase", "same", "decrease")}
CODES = {"yes": "Y", "uncertain": "U", "no": "N", "increase": "I", "same": "S", "decrease": "D"}


def array(asked: LimeSurveyConversion) -> list[Item]:
    """A, B, C, E, F, H: subquestions on one scale."""
    kind = asked.question.type
    if kind in {"A", "B"}:
        most = 5 if kind == "A" else 10
        values = {str(n): n for n in range(1, most + 1)}
        return [_grid(asked, numbered(asked, 1, most), values, {})]
    if kind in WORDED:
        found = {CODES[one]: word(one, asked.draft, asked.note) for one in WORDED[kind]}
    else:
        found = asked.answers()
    if kind == "H":
        asked.note.changed(_("Its columns become rows."))
    return _on_scale(asked, found)


def _on_scale(asked: LimeSurveyConversion, answers: Mapping[str, Text]) -> list[Item]:
    if len(answers) > 11:
        asked.note.changed(
            _("A scale can have at most 11 points, so each row becomes a list of options.")
        )
        found = options(answers, asked.note)
        return by_part(
            asked,
            lambda _part: {"kind": "single", "options": found},
            _("Each row becomes a separate question."),
        )
    points = {code: (code, label) for code, label in answers.items()}
    name, values, reasons = scale(asked.draft, asked.note, points)
    return [_grid(asked, name, values, reasons)]


def _grid(
    asked: LimeSurveyConversion,
    name: str,
    values: Mapping[str, int],
    reasons: Mapping[str, bool],
    ending: str = "",
    heading: Text | None = None,
) -> Item:
    rows = []
    for part, label in asked.parts():
        key = asked.draft.key(f"{asked.question.title}_{part.title}{ending}", asked.note)
        rows.append({"key": key, "text": label})
        for code, value in values.items():
            source = f"{asked.question.title}_{part.title}{ending}"
            asked.draft.remember(source, code, key, value)
    return {
        "kind": "grid",
        "key": asked.draft.key(asked.question.title + ending, asked.note),
        "text": asked.draft.joined(asked.text(), heading or {}, by=" – "),
        "scale": name,
        "rows": rows,
        **asked.common(),
        **flags(order=asked.order("subquestion_order")),
        **reasons,
    }


def two_scales(asked: LimeSurveyConversion) -> list[Item]:
    """1: subquestions on two scales."""
    asked.note.changed(_("Its two scales become two questions."))
    items = []
    for scale_id, letter in (("0", "A"), ("1", "B")):
        labels = asked.answers(scale_id)
        points = {code: (code, label) for code, label in labels.items()}
        name, values, reasons = scale(asked.draft, asked.note, points)
        heading = asked.draft.text(
            asked.question.attribute_texts(f"dualscale_header{letter}"), asked.note
        )
        items.append(_grid(asked, name, values, reasons, f"_{scale_id}", heading))
    return items


def cells(asked: LimeSurveyConversion) -> list[Item]:
    """: and ;: a number, a tick or a text for each row and column."""
    columns = asked.parts("1")
    text, common = asked.text(), asked.common()
    ticks = asked.question.attribute("multiflexible_checkbox") == "1"
    if asked.question.type == ":" and ticks:
        asked.note.changed(_("Each row becomes a separate question."))
        found = options({column.title: label for column, label in columns}, asked.note)
        return [
            {
                "kind": "multiple",
                "key": key_for(asked, row),
                "text": asked.draft.joined(text, label, by=" – "),
                "options": found,
                **common,
            }
            for row, label in asked.parts()
        ]
    asked.note.changed(_("Each cell becomes a separate question."))
    content: Item = {"kind": "text"}
    if asked.question.type == ":":
        bounds = {
            "minimum": asked.number("multiflexible_min"),
            "maximum": asked.number("multiflexible_max"),
        }
        content = {"kind": "number", **{n: b for n, b in bounds.items() if b is not None}}
    return [
        {
            "key": asked.draft.key(
                f"{asked.question.title}_{row.title}_{column.title}", asked.note
            ),
            "text": asked.draft.joined(text, label, column_label, by=" – "),
            **common,
            **content,
        }
        for row, label in asked.parts()
        for column, column_label in columns
    ]
