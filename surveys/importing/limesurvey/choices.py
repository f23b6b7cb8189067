"""Lists, multiple choice and rankings of a LimeSurvey file."""

from django.utils.translation import gettext as _

from surveys.documents import Text
from surveys.importing.draft import Item
from surveys.importing.limesurvey.question import LimeSurveyConversion, key_for, numbered
from surveys.importing.parts import flags, options, other_text, remember_options, word

OTHER = "-oth-"


def _other_label(asked: LimeSurveyConversion) -> Text:
    own = asked.draft.text(asked.question.attribute_texts("other_replace_text"), asked.note)
    return own or word("other", asked.draft, asked.note)


def single(asked: LimeSurveyConversion) -> list[Item]:
    """L, !, O: one of the answers; O has a comment."""
    labels = asked.answers()
    key = key_for(asked)
    if asked.question.row.get("other") == "Y":
        labels[OTHER] = _other_label(asked)
    return _single(asked, key, labels)


def _single(asked: LimeSurveyConversion, key: str, labels: dict[str, Text]) -> list[Item]:
    coded = {("other" if code == OTHER else code): label for code, label in labels.items()}
    item = {
        "kind": "single",
        "key": key,
        "text": asked.text(),
        "options": options(coded, asked.note),
        **asked.common(),
        **flags(order=asked.order("answer_order")),
    }
    remember_options(asked.draft, asked.question.title, coded, key)
    items = [item]
    if OTHER in labels:
        items.append(other_text(asked.draft, asked.note, key, "other", labels[OTHER]))
    if asked.question.type == "O":
        items.append(_comment(asked, key))
    return items


def _comment(asked: LimeSurveyConversion, key: str) -> Item:
    asked.note.changed(_("The comment becomes a separate question."))
    return {
        "kind": "text",
        "key": asked.draft.key(f"{key}_comment", asked.note),
        "text": word("comment", asked.draft, asked.note),
        "lines": 3,
    }


def fixed(asked: LimeSurveyConversion) -> list[Item]:
    """Y and G: answers that LimeSurvey does not write into the file."""
    names = {"Y": {"Y": "yes", "N": "no"}, "G": {"F": "female", "M": "male"}}
    labels = {
        code: word(name, asked.draft, asked.note)
        for code, name in names[asked.question.type].items()
    }
    return _single(asked, key_for(asked), labels)


def multiple(asked: LimeSurveyConversion) -> list[Item]:
    """M and P: any of the subquestions; P has a comment for each."""
    key = key_for(asked)
    parts = asked.parts()
    labels = {part.title: label for part, label in parts}
    if asked.question.row.get("other") == "Y":
        labels["other"] = _other_label(asked)
    alone = [code for code in asked.question.attribute("exclude_all_others").split(";") if code]
    bounds = {
        name: int(bound)
        for name, field in (("at_least", "min_answers"), ("at_most", "max_answers"))
        if (bound := asked.number(field))
    }
    found = options(labels, asked.note, alone)
    item = {
        "kind": "multiple",
        "key": key,
        "text": asked.text(),
        "options": found,
        **asked.common(),
        **bounds,
        **flags(order=asked.order("subquestion_order")),
    }
    values = {code: option["value"] for code, option in zip(labels, found, strict=False)}
    for part, _label in parts:
        name = f"{asked.question.title}_{part.title}"
        asked.draft.remember(name, "Y", key, values[part.title])
    items = [item]
    if asked.question.type == "P":
        items += [
            other_text(asked.draft, asked.note, key, values[code], label)
            for code, label in labels.items()
        ]
    elif "other" in labels:
        items.append(other_text(asked.draft, asked.note, key, values["other"], labels["other"]))
    return items


def ranking(asked: LimeSurveyConversion) -> list[Item]:
    """R: the answers in an order."""
    labels = asked.answers() or {part.title: label for part, label in asked.parts()}
    if asked.number("max_answers") or asked.question.attribute("max_subquestions"):
        asked.note.changed(_("Respondents rank all options, not only some."))
    return [
        {
            "kind": "ranking",
            "key": key_for(asked),
            "text": asked.text(),
            "options": options(labels, asked.note),
            **asked.common(),
            **flags(order=asked.order("answer_order")),
        }
    ]


def five_points(asked: LimeSurveyConversion) -> list[Item]:
    """5: one of the numbers from 1 to 5."""
    key = key_for(asked)
    for n in range(1, 6):
        asked.draft.remember(asked.question.title, str(n), key, n)
    return [
        {
            "kind": "likert",
            "key": key,
            "text": asked.text(),
            "scale": numbered(asked, 1, 5),
            **asked.common(),
        }
    ]
