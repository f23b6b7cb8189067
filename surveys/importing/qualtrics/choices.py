"""Multiple choice and rank order of a Qualtrics file."""

import re
from collections.abc import Mapping

from django.utils.translation import gettext as _

from surveys.documents import Text
from surveys.importing.draft import Item
from surveys.importing.parts import flags, option_values, options, other_text
from surveys.importing.qualtrics.question import (
    QualtricsConversion,
    by_id,
    is_set,
    no_counterpart,
    note_choices,
    whole,
)
from surveys.importing.report import Note, NotImportedError

SINGLE = frozenset({"SAVR", "SAHR", "SACOL", "DL", "SB"})
MULTIPLE = frozenset({"MAVR", "MAHR", "MACOL", "MSB"})


def choice(asked: QualtricsConversion) -> list[Item]:
    """MC: one or several of some options, or the eleven points of a Net Promoter Score."""
    if asked.selector == "NPS":
        return _nps(asked)
    if asked.selector not in SINGLE | MULTIPLE:
        raise NotImportedError(no_counterpart(asked))
    note_choices(asked)
    labels = asked.labels()
    codes = _codes(asked, labels)
    choices = by_id(asked.payload.get("Choices"))
    several = asked.selector in MULTIPLE
    alone = {codes[one] for one in labels if several and is_set(choices[one], "ExclusiveAnswer")}
    key = asked.draft.key(asked.name, asked.note)
    item: Item = {
        "kind": "multiple" if several else "single",
        "key": key,
        "text": asked.text(),
        "options": options({codes[one]: label for one, label in labels.items()}, asked.note, alone),
        **flags(required=asked.is_required, order=asked.order()),
        **(_bounds(asked) if several else {}),
    }
    values = option_values([codes[one] for one in labels], Note(asked.name))
    items = [item]
    for one in (one for one, label in labels.items() if label):
        value = values[codes[one]]
        asked.draft.remember(asked.id, one, key, value)
        if is_set(choices[one], "TextEntry"):
            items.append(other_text(asked.draft, asked.note, key, value, labels[one]))
    return items


def _codes(asked: QualtricsConversion, labels: Mapping[str, Text]) -> dict[str, str]:
    """Return what is stored for each choice: its recode value, or its id where these repeat."""
    codes = asked.codes(labels)
    if len(set(codes.values())) < len(codes):
        asked.note.changed(_("Several options share a recode value, so their ids are stored."))
        return {one: one for one in labels}
    return codes


def _bounds(asked: QualtricsConversion) -> dict[str, int]:
    least = whole(asked.settings.get("MinChoices"), 0)
    most = whole(asked.settings.get("MaxChoices"), 0)
    return flags(at_least=least, at_most=most)


def _nps(asked: QualtricsConversion) -> list[Item]:
    numbers = [int(one) for one in asked.labels() if re.fullmatch(r"[0-9]{1,9}", one)]
    named = [label for label in asked.labels("ColumnLabels", "").values() if label]
    first, last = (named[0], named[-1]) if len(named) > 1 else ({}, {})
    ends = (
        {
            numbers[0]: first or asked.draft.same(str(numbers[0])),
            numbers[-1]: last or asked.draft.same(str(numbers[-1])),
        }
        if numbers
        else {}
    )
    return [
        {
            "kind": "likert",
            "key": asked.draft.key(asked.name, asked.note),
            "text": asked.text(),
            "scale": asked.draft.scale([(n, ends.get(n, {})) for n in numbers]),
            **flags(required=asked.is_required),
        }
    ]


def ranking(asked: QualtricsConversion) -> list[Item]:
    """RO: options to put into an order."""
    note_choices(asked)
    labels = asked.labels()
    choices = by_id(asked.payload.get("Choices"))
    if any(is_set(choices[one], "TextEntry") for one in labels):
        asked.note.changed(_("The text entry of an option is not imported."))
    codes = asked.codes(labels)
    by_code = {codes[one]: label for one, label in labels.items()}
    return [
        {
            "kind": "ranking",
            "key": asked.draft.key(asked.name, asked.note),
            "text": asked.text(),
            "options": options(by_code, asked.note),
            **flags(required=asked.is_required, order=asked.order()),
        }
    ]
