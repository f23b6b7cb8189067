"""The labels of the editor's forms, and the scales that it offers."""

from collections.abc import Mapping, Sequence
from typing import Any

from django.conf import settings
from django.utils.translation import gettext, gettext_lazy as _, override

from surveys.definition import Definition, Page
from surveys.document_forms.guide import FormGuide
from surveys.document_forms.part_form import PartForm
from surveys.document_forms.parts import Document
from surveys.questions import TYPES

LABELS = {
    "title": _("Title"),
    "intro": _("Introduction"),
    "source": _("Source"),
    "licence": _("Licence"),
    "languages": _("Languages"),
    "template": _("Template: its texts are not filled in"),
    "scoring": _("Score"),
    "topics": _("Topics"),
    "text": _("Text"),
    "QuestionTopic.text": _("Name"),
    "QuestionTopic.items": _("Questions"),
    "hint": _("Hint"),
    "required": _("An answer is required"),
    "prefer_not": _("Offer “Prefer not to answer”"),
    "not_applicable": _("Offer “Does not apply”"),
    "show_if": _("Show only in some cases"),
    "ItemCondition.item": _("Earlier question"),
    "ItemCondition.one_of": _("One of these answers"),
    "ItemCondition.at_least": _("Answer of at least"),
    "ItemCondition.at_most": _("Answer of at most"),
    "robot": _("Robots"),
    "outcome": _("After these outcomes"),
    "order": _("Order"),
    "scale": _("Scale"),
    "reverse": _("Score it from the other end of the scale"),
    "options": _("Options"),
    "label": _("Label"),
    "alone": _("Excludes all other options"),
    "points": _("Points"),
    "ScalePoint.value": _("Value in the data"),
    "key": _("Name in the data"),
    "value": _("Name in the data"),
}

HINTS = {
    "languages": _(
        "Every text is required in each language. Removing a language deletes its texts."
    ),
    "source": _("Where the questions come from, such as the article to cite."),
    "licence": _("Terms of use of the questions."),
    "template": _("A template can't be used in a study."),
    "topics": _("Questions whose answers are reported together."),
    "show_if": _("If you set several of these, all must hold."),
    "ItemCondition.item": _("Choose one and save to see its answers here."),
    "robot": _("Names or series, separated by commas. Leave blank for all."),
    "key": _("Lower-case letters, digits and underscores. Used in the data."),
    "points": _("Only the first and the last point need a label."),
    "scale": _("You can add others on the page of the questionnaire."),
}

ITEMS = {"options": _("Option"), "rows": _("Statement"), "points": _("Point"), "topics": _("Topic")}

CHOICES = {
    "order": {"fixed": _("as written"), "shuffled": _("random for each respondent")},
    "scoring": {
        "none": _("no score"),
        "likert": _("mean of all statements"),
        "topics": _("mean of each topic"),
        "sus": _("System Usability Scale (SUS)"),
        "tlx_raw": _("raw NASA Task Load Index"),
    },
    "outcome": {
        "completed": _("completed"),
        "timed_out": _("timed out"),
        "connection_refused": _("connection refused"),
        "cancelled": _("cancelled"),
        "stopped_by_operator": _("stopped by operator"),
        "robot_fault": _("robot fault"),
        "connection_lost": _("connection lost"),
    },
}

LAST = ("required", "prefer_not", "not_applicable", "show_if")
GUIDE = FormGuide(
    {key: text for one in TYPES.values() for key, text in one.labels.items()} | LABELS,
    HINTS
    | {f"{one.__name__}.{key}": text for one in TYPES.values() for key, text in one.hints.items()},
    ITEMS,
    CHOICES,
    # Questions and scales have pages of their own.
    hidden={Definition: frozenset({"scales", "pages"}), Page: frozenset({"items"})},
    details=frozenset({"key", "Option.value", "Option.alone"}),
    last=frozenset(LAST),
    long=frozenset({"intro", "source", *(f"{cls.__name__}.text" for cls in TYPES.values())}),
    spaced=frozenset({"robot", "is"}),
)


class EditorForm(PartForm):
    guide = GUIDE


def kind_name(kind: str) -> Any:
    return TYPES[kind].plain_name or kind.replace("_", " ").capitalize()


_DISAGREE, _AGREE = _("Disagree"), _("Agree")
_ENDS = (_("Strongly disagree"), _("Strongly agree"))
_NEITHER = _("Neither agree nor disagree")
READY: Mapping[str, tuple[Any, Sequence[Any]]] = {
    "agreement_5": (_("Agreement, 5 points"), (_ENDS[0], _DISAGREE, _NEITHER, _AGREE, _ENDS[1])),
    "agreement_7": (
        _("Agreement, 7 points"),
        (
            *(_ENDS[0], _DISAGREE, _("Somewhat disagree"), _NEITHER),
            *(_("Somewhat agree"), _AGREE, _ENDS[1]),
        ),
    ),
}


def ready_points(
    name: str, languages: Sequence[str], former: Sequence[Document] = ()
) -> list[Document]:
    """Return the points of an offered scale; of a `former` one, label only unlabelled languages."""
    labels, known = READY[name][1], {code for code, _label in settings.LANGUAGES}
    new = ({"value": n} for n in range(1, len(labels) + 1))
    points: list[dict[str, Any]] = [{"label": {}} | one for one in former or new]
    given = {language for point in points for language in point["label"]}
    for language in languages if len(points) == len(labels) else ():
        if language.partition("-")[0] in known and language not in given:
            with override(language):
                for point, label in zip(points, labels, strict=True):
                    point["label"] = {**point["label"], language: str(label)}
    return points


def scale_name(points: Sequence[Document], text_of: Any) -> str:
    ends = [text_of(point.get("label", {})) or str(point["value"]) for point in points]
    words = {"first": ends[0] if ends else "", "last": ends[-1] if ends else "", "n": len(points)}
    return gettext("%(first)s … %(last)s (%(n)d points)") % words
