"""The questions of a Qualtrics file, by type and selector, as questions of this site.

Types and selectors as Qualtrics writes them; what they look like was read in the public files that
surveys/importing/formats/qsf.py names. A type without an entry in `TYPES` has no counterpart.
"""

from collections.abc import Callable

from django.utils.translation import gettext as _

from surveys.importing.draft import Item
from surveys.importing.qualtrics.choices import choice, ranking
from surveys.importing.qualtrics.entries import slider, text_entry
from surveys.importing.qualtrics.matrices import matrix
from surveys.importing.qualtrics.question import QualtricsConversion, by_id, mapping, no_counterpart
from surveys.importing.report import NotImportedError


def columns_of(asked: QualtricsConversion) -> list[Item]:
    """SBS: several matrices with the same rows, one a column."""
    asked.note.changed(_("Each column becomes a separate question."))
    columns = by_id(asked.payload.get("AdditionalQuestions"))
    rows = {name: asked.payload.get(name) for name in ("Choices", "ChoiceOrder")}
    items: list[Item] = []
    for one, column in columns.items():
        inner = QualtricsConversion(asked.draft, asked.note, {**mapping(column), **rows})
        inner.name = f"{asked.name}_{one}"
        converter = TYPES.get(inner.kind)
        if converter is None or converter is columns_of:
            raise NotImportedError(no_counterpart(inner))
        made = converter(inner)
        text = asked.text()
        items += [
            {**item, "text": asked.draft.joined(text, item["text"], by=" – ")} for item in made
        ]
    return items


TYPES: dict[str, Callable[[QualtricsConversion], list[Item]]] = {
    "MC": choice,
    "Matrix": matrix,
    "TE": text_entry,
    "Slider": slider,
    "RO": ranking,
    "SBS": columns_of,
}


def items_of(asked: QualtricsConversion) -> list[Item]:
    """Return what a question becomes.

    Raises:
        NotImportedError: it has no counterpart here.
    """
    converter = TYPES.get(asked.kind)
    if converter is None:
        raise NotImportedError(no_counterpart(asked))
    return converter(asked)
