"""Text entries and sliders of a Qualtrics file."""

from typing import Any

from django.utils.translation import gettext as _

from surveys.importing.draft import Item
from surveys.importing.parts import flags
from surveys.importing.qualtrics.question import (
    QualtricsConversion,
    form_rows,
    mapping,
    no_counterpart,
    whole,
)
from surveys.importing.report import NotImportedError

TEXT_LINES = {"SL": 1, "ML": 4, "ESTB": 8}
# Rules for a text that are not checked here, as Qualtrics names them and in words.
UNCHECKED = {
    "ValidEmail": "e-mail",
    "ValidPhone": "phone",
    "ValidZip": "ZIP",
    "ValidUSState": "state",
    "ValidTextOnly": "letters",
}


def text_entry(asked: QualtricsConversion) -> list[Item]:
    """TE: a text, a number or a date on one line or several, or a form of several lines."""
    if asked.selector == "PW":
        raise NotImportedError(_("Questions for passwords are not supported."))
    if asked.selector == "FORM":
        asked.note.changed(_("Each line of the form becomes a separate question."))
        text, required = asked.text(), asked.is_required
        return [
            {
                "kind": "text",
                "key": own,
                "text": asked.draft.joined(text, label, by=" – "),
                **flags(required=required),
            }
            for _one, own, label in form_rows(asked)
        ]
    if asked.selector not in TEXT_LINES:
        raise NotImportedError(no_counterpart(asked))
    key = asked.draft.key(asked.name, asked.note)
    common = {"key": key, "text": asked.text(), **flags(required=asked.is_required)}
    return [common | _content(asked)]


def _content(asked: QualtricsConversion) -> Item:
    content = mapping(asked.settings.get("ValidNumber"))
    wanted = str(asked.settings.get("ContentType") or "")
    if asked.settings.get("Type") == "ContentType" and wanted == "ValidNumber":
        bounds = {
            name: float(content[field])
            for name, field in (("minimum", "Min"), ("maximum", "Max"))
            if _is_number(content.get(field))
        }
        is_whole = str(content.get("NumDecimals")) == "0"
        return {"kind": "number", **bounds, **flags(whole=is_whole)}
    if asked.settings.get("Type") == "ContentType" and wanted == "ValidDate":
        return {"kind": "date"}
    if wanted and asked.settings.get("Type") == "ContentType":
        asked.note.changed(
            _("Its format (%(rule)s) is not checked.") % {"rule": UNCHECKED.get(wanted, wanted)}
        )
    lines = TEXT_LINES[asked.selector]
    most = whole(asked.settings.get("MaxChars") or asked.settings.get("TotalChars"), 0)
    length = most if 1 <= most <= 5000 else (1000 if lines == 1 else 5000)
    return {"kind": "text", "lines": lines, "max_length": length}


def _is_number(value: Any) -> bool:
    try:
        return abs(float(value)) < 1e12
    except (TypeError, ValueError):
        return False


def slider(asked: QualtricsConversion) -> list[Item]:
    """Slider: one slider a choice, between the ends of all."""
    least = whole(asked.configuration.get("CSSliderMin"), 0)
    most = whole(asked.configuration.get("CSSliderMax"), 100)
    step = 1
    parts = whole(asked.configuration.get("GridLines"), 0)
    if str(asked.configuration.get("SnapToGrid")).lower() == "true" and parts > 0:
        step = (most - least) // parts if (most - least) % parts == 0 else 1
    if whole(asked.configuration.get("NumDecimals"), 0) > 0:
        asked.note.changed(_("It accepts only whole numbers."))
    if asked.selector == "STAR":
        asked.note.changed(_("The stars become a slider."))
    ends = [label for label in asked.labels("Labels", "").values() if label]
    if len(ends) > 2:
        asked.note.changed(_("Labels between the two ends are not imported."))
    low, high = (ends[0], ends[-1]) if len(ends) > 1 else (None, None)
    text, required = asked.text(), asked.is_required
    rows = [(own, label) for _one, own, label in form_rows(asked)] or [
        (asked.draft.key(asked.name, asked.note), {})
    ]
    if len(rows) > 1:
        asked.note.changed(_("Each slider becomes a separate question."))
    lacks = str(asked.configuration.get("NotApplicable")).lower() == "true"
    return [
        {
            "kind": "slider",
            "key": own,
            "text": asked.draft.joined(text, label, by=" – "),
            "minimum": least,
            "maximum": most,
            "step": step,
            "low": low or asked.draft.same(str(least)),
            "high": high or asked.draft.same(str(most)),
            **flags(required=required, not_applicable=lacks),
        }
        for own, label in rows
    ]
