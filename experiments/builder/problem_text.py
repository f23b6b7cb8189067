"""What is wrong with a study, as its builder tells it: a text that is missing is named as the page
names it, once for all languages in which it is missing. Other problems are sentences already.
"""

import itertools
import re
from collections.abc import Iterable

from django.utils.translation import gettext as _

from experiments.builder.labels import GUIDE
from experiments.builder.pages import parts_in
from surveys.document_forms.fields import language_name
from surveys.document_forms.parts import Document
from surveys.documents import text_in

_MISSING = re.compile(r"(?P<place>\S+) has no text in (?P<language>\S+)\.")
_LISTED = re.compile(r"(?P<key>\w+)\[(?P<n>\d+)\]")


def in_words(found: Iterable[str], whole: Document) -> dict[str, str]:
    """Return each problem of a study with what is said of it, in order; of those about one text the
    first stands for all.
    """
    told: dict[str, str] = {}
    missing: dict[str, tuple[str, list[str]]] = {}
    for problem in found:
        about = _MISSING.fullmatch(problem)
        if about is None:
            told[problem] = problem
            continue
        first, languages = missing.setdefault(about["place"], (problem, []))
        languages.append(language_name(about["language"]))
        told[first] = _("%(text)s (%(languages)s) is missing.") % {
            "text": _name_of(about["place"], whole),
            "languages": ", ".join(languages),
        }
    return told


def _name_of(place: str, whole: Document) -> str:
    """Return what a text is called: the part of the study, and what it is of that part."""
    head, *path = place.split(".")
    names = []
    if head == "study" and (found := _LISTED.fullmatch(path[0])) and found["key"] in whole:
        names.append(title_of(whole[found["key"]][int(found["n"])], whole))
        path = path[1:]
    elif head != "study":
        parts = (
            part
            for section in ("steps", "factors", "conditions", "analyses", "stages")
            for part in parts_in(whole, section)
        )
        lines = (step for stage in parts_in(whole, "stages") for step in stage.get("steps", ()))
        parts = itertools.chain(parts, lines)
        names.append(next((title_of(one, whole) for one in parts if one["key"] == head), head))
    return " · ".join([*names, *(_segment(one) for one in path)])


def _segment(name: str) -> str:
    """Return what one step of a path is called; checkpoints are counted from 0, the station."""
    found = _LISTED.fullmatch(name)
    if found is None:
        return str(GUIDE.label(name))
    n = int(found["n"]) + (found["key"] != "checkpoints")
    return f"{GUIDE.item(found['key'])} {n}"


def title_of(part: Document, whole: Document) -> str:
    """Return what a step, condition or course is called, in the first language that has it."""
    return (
        text_in(part.get("title", {}), whole["languages"])
        or part.get("name")
        or part.get("code")
        or part.get("key")
        or _("%(robot)s at %(site)s")
        % {
            "robot": part.get("robot", ""),
            "site": part.get("site", ""),
        }
    )
