"""What is wrong with a questionnaire (surveys/problems.py), in the words of the editor's pages and
sorted by the page on which it is mended. A sentence without such words is told as it is.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from django.utils.translation import gettext
from django.utils.translation import gettext_lazy as _

from surveys.document_forms.fields import language_name
from surveys.document_forms.parts import Document
from surveys.editor.draft import EditorPlace
from surveys.editor.labels import GUIDE

_MISSING = re.compile(r"(?P<place>.+) has no text in (?P<language>\S+)\.")
_OF_SCALE = re.compile(r"(?:The scale|The values of the scale|scale) (?P<key>[a-z]\w*)")
_OF_PART = re.compile(r"(?:[Pp]age |topic )?(?P<key>[a-z][a-z0-9_]*)(?:[.:]| is reversed| has no)")
_LISTED = re.compile(r"(?P<name>\w+)\[(?P<n>\d+)\]")

WORDS: Mapping[str, Any] = {
    r"Page \S+ has no items\.": _("This page has no questions. Add one."),
    r"there is no scale .*": _("Choose a scale."),
    r"there are no options\.": _("Add the options."),
    r"The option \S+ appears .*": _("Two options have the same name in the data."),
    r"the grid has no rows\.": _("Add the statements."),
    r"at_least and at_most do not .*": _("There are too few options for these limits."),
    r"the minimum is greater .*": _("The minimum is greater than the maximum."),
    r"its maximum must be above .*": _(
        "The maximum must be above the minimum by a multiple of the step."
    ),
    r"the earliest day is after .*": _("The earliest day is after the latest day."),
    r".* is not a date: .*": _("Write a day as year-month-day, or today."),
    r"\d+ options are ranked; .*": _("A ranking needs 2 to 20 options."),
    r"an option that is ranked .*": _("An option of a ranking can't exclude the others."),
    r"show_if must name .*": _("Choose when it is shown, or remove the condition."),
    r"show_if needs item .*": _("Choose both an earlier question and answers to it."),
    r"show_if names .*": _("The condition refers to a question that does not come earlier."),
    r"show_if expects .*": _("The condition expects an answer that the question doesn't offer."),
    r"show_if compares .*": _("Only the answer to a number question has a minimum or maximum."),
    r"The scale \S+ has \d+ points; .*": _("A scale needs 2 to 11 points."),
    r"The values of the scale .*": _("The values must increase from point to point."),
    r"The scale \S+ must name .*": _("Label the first and the last point."),
    r"there is no statement .*": _("A topic has a question that it can't use."),
    r"scoring topics needs at least .*": _("A mean of each topic needs topics. Add them."),
    r"scoring topics needs statements .*": _("The questions of a topic need the same scale."),
    r"scoring likert .*": _("A mean of all statements needs statements on one scale."),
    r"scoring sus needs .*": _("The SUS needs ten statements on a scale from 1 to 5."),
    r"scoring sus reverses .*": _("The SUS reverses its statements itself."),
    r"scoring tlx_raw .*": _("The raw NASA-TLX needs six sliders from 0 to 100."),
    r"\S+ is reversed, but .*": _("It is reversed, but no score uses it."),
    r"a scale with unequal .*": _("A scale that isn't symmetric can't be reversed."),
}
ABOUT = EditorPlace("about")


def told(found: Iterable[str], whole: Document) -> dict[EditorPlace, list[str]]:
    """Return what is said of each problem, by the place where it is mended; of the languages of a
    text that are missing together.
    """
    places = _places(whole)
    said: dict[EditorPlace, dict[str, list[str]]] = defaultdict(dict)
    for problem in found:
        place = _place_of(problem, places)
        missing = _MISSING.fullmatch(problem)
        if missing is None:
            said[place][_in_words(problem)] = []
        else:
            name = _name_of(missing["place"], whole)
            said[place].setdefault(name, []).append(language_name(missing["language"]))
    return {
        place: [_missing(name, languages) if languages else name for name, languages in one.items()]
        for place, one in said.items()
    }


def _missing(name: str, languages: list[str]) -> str:
    words = {"text": name, "languages": ", ".join(languages)}
    return gettext("%(text)s (%(languages)s) is missing.") % words


def _places(whole: Document) -> dict[str, EditorPlace]:
    found = {page["key"]: EditorPlace("pages", page["key"]) for page in whole["pages"]}
    for item in (item for page in whole["pages"] for item in page["items"]):
        place = EditorPlace("questions", item["key"])
        found |= dict.fromkeys([item["key"], *(row["key"] for row in item.get("rows", ()))], place)
    return found


def _place_of(problem: str, places: Mapping[str, EditorPlace]) -> EditorPlace:
    if scale := _OF_SCALE.match(problem):
        return EditorPlace("scales", scale["key"])
    about = _OF_PART.match(problem)
    return places.get(about["key"], ABOUT) if about is not None else ABOUT


def _in_words(problem: str) -> str:
    bare = re.sub(r"^(page |topic )?[a-z][a-z0-9_]*: ", "", problem)
    return next(
        (str(words) for pattern, words in WORDS.items() if re.fullmatch(pattern, bare)), bare
    )


def _name_of(place: str, whole: Document) -> str:
    """Return what a text is called: of a part of a list, with its number there."""
    head, _point, path = place.partition(".")
    if place.startswith("scale "):
        return gettext("Label of point %(value)s") % {
            "value": place.rpartition(", ")[2].split(".")[0]
        }
    names = [_segment(name) for name in path.split(".")]
    for name in ("rows", "topics"):
        parts = [whole, *(item for page in whole["pages"] for item in page["items"])]
        lists = (part.get(name, ()) for part in parts)
        n = next((n for one in lists for n, row in enumerate(one, 1) if row["key"] == head), None)
        names = [f"{GUIDE.item(name)} {n}", *names] if n is not None else names
    return " · ".join(names)


def _segment(name: str) -> str:
    found = _LISTED.fullmatch(name)
    return f"{GUIDE.item(found['name'])} {int(found['n']) + 1}" if found else str(GUIDE.label(name))
