"""Matrices of a Qualtrics file: statements on a scale, choices or texts by row."""

from collections.abc import Iterator

from django.utils.translation import gettext as _

from surveys.documents import Text
from surveys.importing.draft import Item
from surveys.importing.parts import flags, options, scale
from surveys.importing.qualtrics.question import (
    QualtricsConversion,
    by_id,
    is_set,
    mapping,
    no_counterpart,
    note_choices,
)
from surveys.importing.report import NotImportedError


def matrix(asked: QualtricsConversion) -> list[Item]:
    """Matrix: statements on a scale, choices or texts by row."""
    if asked.selector == "TE":
        return _cells(asked)
    if asked.selector == "Bipolar":
        return _bipolar(asked)
    if asked.selector != "Likert":
        raise NotImportedError(no_counterpart(asked))
    note_choices(asked)
    if asked.sub_selector == "MultipleAnswer":
        return _choices_by_row(asked, "multiple")
    answers = asked.labels("Answers", "AnswerOrder")
    if len(answers) > 11:
        asked.note.changed(
            _("A scale can have at most 11 points, so each row becomes a list of options.")
        )
        return _choices_by_row(asked, "single")
    if asked.sub_selector not in {"", "SingleAnswer"}:
        asked.note.changed(_("It becomes statements on a scale."))
    codes = asked.codes(answers)
    name, values, reasons = scale(
        asked.draft, asked.note, {one: (codes[one], label) for one, label in answers.items()}
    )
    key = asked.draft.key(asked.name, asked.note)
    rows: list[Item] = [{"key": own, "text": label} for _one, own, label in _rows(asked)]
    for one, value in values.items():
        if len(rows) == 1:
            asked.draft.remember(asked.id, one, rows[0]["key"], value)
    return [
        {
            "kind": "grid",
            "key": key,
            "text": asked.text(),
            "scale": name,
            "rows": rows,
            **flags(required=asked.is_required, order=asked.order(), **reasons),
        }
    ]


def _rows(asked: QualtricsConversion) -> Iterator[tuple[str, str, Text]]:
    """Yield the id, key and text of each row."""
    tags = mapping(asked.payload.get("ChoiceDataExportTags"))
    choices = by_id(asked.payload.get("Choices"))
    for one, label in asked.labels().items():
        if is_set(choices[one], "TextEntry"):
            asked.note.changed(_("The text entry in a row is not imported."))
        if not label:
            asked.note.changed(_("A row without a text is not imported."))
            continue
        yield one, asked.draft.key(str(tags.get(one) or f"{asked.name}_{one}"), asked.note), label


def _choices_by_row(asked: QualtricsConversion, kind: str) -> list[Item]:
    asked.note.changed(_("Each row becomes a separate question."))
    answers = asked.labels("Answers", "AnswerOrder")
    codes = asked.codes(answers)
    if len(set(codes.values())) < len(codes):
        codes = {one: one for one in answers}
    found = options({codes[one]: label for one, label in answers.items()}, asked.note)
    text = asked.text()
    required = asked.is_required
    return [
        {
            "kind": kind,
            "key": own,
            "text": asked.draft.joined(text, label, by=" – "),
            "options": found,
            **flags(required=required),
        }
        for _one, own, label in _rows(asked)
    ]


def _cells(asked: QualtricsConversion) -> list[Item]:
    asked.note.changed(_("Each cell becomes a separate question."))
    answers = asked.labels("Answers", "AnswerOrder") or {"": {}}
    text, required = asked.text(), asked.is_required
    lines = 1 if asked.sub_selector in {"", "Short", "Medium", "Long"} else 4
    return [
        {
            "kind": "text",
            "key": asked.draft.key(f"{own}_{column}", asked.note) if column else own,
            "text": asked.draft.joined(text, label, answer, by=" – "),
            "lines": lines,
            **flags(required=required),
        }
        for _one, own, label in list(_rows(asked))
        for column, answer in answers.items()
    ]


def _bipolar(asked: QualtricsConversion) -> list[Item]:
    """Rows with words at both ends, written "left:right"."""
    asked.note.changed(_("Each row becomes a separate question with its own end labels."))
    answers = asked.labels("Answers", "AnswerOrder")
    text, required = asked.text(), asked.is_required
    items = []
    for _one, own, label in _rows(asked):
        left = {lang: words.partition(":")[0].strip() for lang, words in label.items()}
        right = {lang: words.partition(":")[2].strip() for lang, words in label.items()}
        ends = {1: left, len(answers): right}
        points = [
            (n, ends[n] if n in ends and all(ends[n].values()) else {})
            for n in range(1, len(answers) + 1)
        ]
        items.append(
            {
                "kind": "likert",
                "key": own,
                "text": asked.draft.joined(text, label, by=" – "),
                "scale": asked.draft.scale(points),
                **flags(required=required),
            }
        )
    return items
