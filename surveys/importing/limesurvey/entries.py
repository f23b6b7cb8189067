"""Texts, numbers and days of a LimeSurvey file."""

from django.utils.translation import gettext as _

from surveys.importing.draft import Item
from surveys.importing.limesurvey.question import LimeSurveyConversion, by_part, key_for
from surveys.importing.parts import flags

LINES = {"S": 1, "T": 5, "U": 15}


def free_text(asked: LimeSurveyConversion) -> list[Item]:
    """S, T, U: a text, or a number where only numbers are allowed."""
    if asked.question.attribute("numbers_only") == "1":
        return number(asked)
    most = asked.number("maximum_chars") or 0
    lines = LINES[asked.question.type]
    length = int(most) if 1 <= most <= 5000 else (1000 if lines == 1 else 5000)
    return [
        {
            "kind": "text",
            "key": key_for(asked),
            "text": asked.text(),
            "lines": lines,
            "max_length": length,
            **asked.common(),
        }
    ]


def texts(asked: LimeSurveyConversion) -> list[Item]:
    """Q: several texts."""
    return by_part(
        asked, lambda _part: {"kind": "text"}, _("Each line becomes a separate question.")
    )


def _number_fields(asked: LimeSurveyConversion) -> Item:
    suffix = asked.draft.text(asked.question.attribute_texts("suffix"), asked.note)
    if any(asked.question.attribute_texts("prefix").values()):
        asked.note.changed(_("The text before the number is not imported."))
    bounds = {
        "minimum": asked.number("min_num_value_n"),
        "maximum": asked.number("max_num_value_n"),
    }
    whole = asked.question.attribute("num_value_int_only") == "1"
    return {
        "kind": "number",
        **{name: bound for name, bound in bounds.items() if bound is not None},
        **flags(whole=whole, unit=suffix),
    }


def number(asked: LimeSurveyConversion) -> list[Item]:
    """N: a number."""
    fields = _number_fields(asked)
    return [{"key": key_for(asked), "text": asked.text(), **asked.common(), **fields}]


def numbers(asked: LimeSurveyConversion) -> list[Item]:
    """K: several numbers, or sliders."""
    if asked.question.attribute("slider_layout") == "1":
        return _sliders(asked)
    for rule in ("min_num_value", "max_num_value", "equals_num_value"):
        if asked.question.attribute(rule):
            asked.note.changed(
                _("Its rule %(rule)s is not checked.")
                % {"rule": f"{rule} = {asked.question.attribute(rule)}"}
            )
    fields = _number_fields(asked)
    return by_part(asked, lambda _part: fields, _("Each line becomes a separate question."))


def _sliders(asked: LimeSurveyConversion) -> list[Item]:
    least, most = asked.number("slider_min"), asked.number("slider_max")
    low, high = int(least or 0), int(100 if most is None else most)
    step = asked.number("slider_accuracy") or 1
    if step != int(step):
        asked.note.changed(_("It accepts only whole numbers."))
    separator = asked.question.attribute("slider_separator") or "|"
    asked.note.changed(_("Each slider becomes a separate question."))
    text, common = asked.text(), asked.common()
    items = []
    for part, label in asked.parts():
        words = {lang: [*one.split(separator), "", ""] for lang, one in label.items()}
        ends = [{lang: parts[n].strip() for lang, parts in words.items()} for n in (0, 1, 2)]
        items.append(
            {
                "kind": "slider",
                "key": key_for(asked, part),
                "text": asked.draft.joined(text, ends[0], by=" – "),
                "minimum": low,
                "maximum": high,
                "step": max(int(step), 1),
                "low": ends[1] if all(ends[1].values()) else asked.draft.same(str(low)),
                "high": ends[2] if all(ends[2].values()) else asked.draft.same(str(high)),
                **common,
            }
        )
    return items


def day(asked: LimeSurveyConversion) -> list[Item]:
    """D: a day."""
    if any(sign in asked.question.attribute("date_format") for sign in ("H", "M:")):
        asked.note.changed(_("It asks for the date, not the time."))
    bounds = {}
    for name, field in (("earliest", "date_min"), ("latest", "date_max")):
        value = asked.question.attribute(field).strip("\"'").lower()
        if value in {"now", "today"}:
            bounds[name] = "today"
        elif len(value) >= 10 and value[:10].replace("-", "").isdigit():
            bounds[name] = value[:10]
        elif value:
            asked.note.changed(_("Its rule %(rule)s is not checked.") % {"rule": field})
    return [
        {"kind": "date", "key": key_for(asked), "text": asked.text(), **asked.common(), **bounds}
    ]
