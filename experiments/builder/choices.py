"""What a form of the study builder offers: sites, robots, questionnaires, and the parts of a study
that others refer to.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec
from django.conf import settings
from django.utils.text import capfirst
from django.utils.translation import get_language
from django.utils.translation import gettext as _

from experiments import publishing
from experiments.builder.pages import AtHand
from experiments.definition.feasibility import too_fast
from experiments.definition.schema import Condition
from robots.api.floorplan import FloorPlan as Plan
from sessions.interfaces import INTERFACES
from surveys import questionnaires
from surveys.definition import language_for
from surveys.document_forms.fields import Offered
from surveys.document_forms.parts import Document
from surveys.documents import spoken
from surveys.models import Questionnaire

PICTURES = Path(settings.BASE_DIR) / "static" / "img" / "instructions"


def at_hand() -> AtHand:
    """Return the sites, and the series of robots that were heard of, or have a station there."""
    sites = publishing.sites()
    stations = {dock.type: None for plan in sites.values() for dock in plan.docks}
    return AtHand(
        sites=sites, robots=tuple({**dict.fromkeys(publishing.known_here().robots), **stations})
    )


def offered(whole: Document, part: Document) -> Offered:
    """Return what can be chosen in a form, by key of the field; doors, stations and mirrors are
    those of the part's own site.
    """
    here = at_hand()
    plan = here.sites.get(part.get("site", ""))
    doors = tuple(door.name for door in plan.doors) if plan is not None else ()
    return {
        "languages": tuple(code for code, _label in settings.LANGUAGES),
        "robot": here.robots,
        "site": tuple(here.sites),
        "doors": doors,
        "doors_closed": doors,
        "dock": (
            tuple(dock.name for dock in plan.docks if dock.type == part.get("robot"))
            if plan is not None
            else ()
        ),
        "mirror": tuple(mirror.name for mirror in plan.mirrors) if plan is not None else (),
        **_questionnaires(whole),
        "interface": INTERFACES,
        "PlaceMove.name": places(
            here.sites[site]
            for site in dict.fromkeys(one["site"] for one in whole["conditions"])
            if site in here.sites
        ),
        "analysis": tuple(one["key"] for one in whole["analyses"]),
        "condition": tuple(one["key"] for one in whole["conditions"]),
        "hypotheses": tuple(one["key"] for one in part.get("hypotheses", ())),
        **dict.fromkeys(
            ("first", "second", "conditions"), tuple(one["key"] for one in whole["conditions"])
        ),
        **{
            f"levels.{factor['key']}": tuple(level["key"] for level in factor.get("levels", ()))
            for factor in whole["factors"]
        },
        "picture": tuple(sorted(file.stem for file in PICTURES.glob("*.svg"))),
    }


def _questionnaires(whole: Document) -> dict[str, Mapping[str, str]]:
    """Return those that can be asked, by name and with their versions, called by their titles."""
    versions, titles = {}, {}
    for one in publishing.usable():
        title = spoken(one.title, language_for(one, get_language() or ""))
        titles[one.slug] = title
        words = _("%(title)s, version %(n)d") % {"title": title, "n": one.version}
        versions[f"{one.slug}:{one.version}"] = words
    asked = dict.fromkeys(step.get("questionnaire") for step in whole["steps"])
    statements = {slug: titles.get(slug, slug) for slug in asked if slug}
    return {"versions": versions, "questionnaire": titles, "statements": statements}


def questionnaire_titles() -> dict[tuple[str, int], str]:
    """Return what the questionnaires that are known here are called, by name and version."""
    shipped = {(one.slug, one.version): one.title for one in questionnaires.shipped().values()}
    rows = Questionnaire.objects.values_list("slug", "version", "definition")
    stored = {(slug, version): definition["title"] for slug, version, definition in rows}
    language = get_language() or ""
    return {name: spoken(title, language) for name, title in (shipped | stored).items()}


def speeds_refused(part: Document) -> dict[str, str]:
    """Return why speed limits of a condition cannot be kept, by their field in its form; what else
    is wrong with it is told elsewhere.
    """
    try:
        condition = msgspec.convert(part, Condition)
    except msgspec.ValidationError:
        return {}
    robot = publishing.known_here().robots.get(condition.robot)
    told = too_fast(condition, robot) if robot is not None else {}
    return {f"speed.{key}": capfirst(one.text(_)) for key, one in told.items()}


def places(plans: Iterable[Plan]) -> tuple[str, ...]:
    """Return the names of the places of sites."""
    return tuple(dict.fromkeys(place.name for plan in plans for place in plan.places))
