"""Choices in forms of the study builder: sites, robots, questionnaires, parts of the study."""

from collections import ChainMap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import get_args

import msgspec
from django.conf import settings
from django.utils.text import capfirst
from django.utils.translation import get_language, gettext as _

from experiments import instruction_media, resources
from experiments.builder.design import shared_fields
from experiments.builder.labels import CHOICES
from experiments.builder.pages import AtHand
from experiments.builder.study_form import claim_of
from experiments.definition.analyses import AGE, DeclaredAnalysis
from experiments.definition.feasibility import too_fast
from experiments.definition.schema import Condition, Outcome, StudyDefinition
from experiments.models import Study as Row
from experiments.participation.steps.instructions import PICTURES
from robots.api.floorplan import FloorPlan as Plan
from sessions.interfaces import INTERFACES
from surveys import questionnaires
from surveys.definition import language_for
from surveys.document_forms.fields import Offered
from surveys.document_forms.parts import Document
from surveys.documents import spoken
from surveys.models import Questionnaire

DIRECTED = 2  # sides of a directed hypothesis
# Outcomes after which a participant may be replaced.
REFILLED = [one for one in get_args(Outcome) if one not in {"completed", "timed_out"}]
_MEASURING = {"analyses", "plan"}  # sections whose forms name measures


def at_hand() -> AtHand:
    """Return the sites, and the series of robots that published a factsheet or have a station."""
    sites = resources.sites()
    stations = (dock.type for plan in sites.values() for dock in plan.docks)
    return AtHand(sites, tuple(dict.fromkeys((*resources.robots_here(), *stations))))


def offered(row: Row, whole: Document, part: Document, section: str) -> Offered:
    """Return the choices by field. Doors and docks are those of the part's or all sites."""
    here, study = at_hand(), row.as_definition()
    language = get_language() or ""
    sites = [part["site"]] if "site" in part else [one["site"] for one in whole["conditions"]]
    plans = [here.sites[site] for site in dict.fromkeys(sites) if site in here.sites]
    doors = tuple(dict.fromkeys(door.name for plan in plans for door in plan.doors))
    docks = [dock.name for plan in plans for dock in plan.docks if dock.type == part.get("robot")]
    conditions = {one.key: spoken(one.title, language) or one.key for one in study.conditions}
    measures = resources.measures_here(study) if section in _MEASURING else {}
    pictures = [page.get("picture") or "" for page in part.get("leaves", ())]
    built_in = {name: name for name in sorted(PICTURES)}
    return {
        "languages": tuple(code for code, _label in settings.LANGUAGES),
        "robot": here.robots,
        "site": tuple(here.sites),
        "doors": doors,
        "doors_closed": doors,
        "dock": tuple(docks),
        "mirror": tuple(mirror.name for plan in plans for mirror in plan.mirrors),
        **_questionnaires(whole),
        "interface": INTERFACES,
        "PlaceMove.name": places(plans),
        **dict.fromkeys(("condition", "first", "second", "conditions"), conditions),
        "hypotheses": tuple(one["key"] for one in part.get("hypotheses", ())),
        "outcomes": {key: CHOICES["outcomes"][key] for key in REFILLED},
        "pictures": {**built_in, **instruction_media.titles(row.slug, pictures)},
        "shared": shared_fields(whole),
        "effects": effects(study, language),
        "claims": claims(study, language),
        "measures": measures,
        "measure": measures,
        "covariates": _covariates(study, language) if section == "analyses" else {},
    }


def _covariates(study: StudyDefinition, language: str) -> dict[str, str]:
    asked = {one.questionnaire: key for key, one in study.asked.items() if one.is_about_person}
    named = {AGE: _("Age")}
    for one in (one for one in resources.usable() if one.slug in asked):
        items = (item for item in one.questions() if not item.item.is_free_text)
        named |= {f"{asked[one.slug]}.{it.key}": spoken(it.text, language) for it in items}
    return named


def effects(study: StudyDefinition, language: str) -> dict[str, str]:
    titles = {one.key: spoken(one.title, language) or one.key for one in study.factors}
    crossed = (keys for n in range(1, len(titles) + 1) for keys in combinations(titles, n))
    named = {":".join(keys): " × ".join(titles[key] for key in keys) for keys in crossed}
    own = {"condition": _("Condition"), "period": _("Round"), "order": _("Order of conditions")}
    return named | own


def claims(study: StudyDefinition, language: str) -> dict[str, dict[str, str]]:
    """Return what hypotheses can expect, by analysis: a sentence for each direction."""
    names = ((spoken(one.title, language) or one.key, one) for one in study.analyses)
    return {name: dict(_claims(study, one, language)) for name, one in names}


def write_claims(study: StudyDefinition, plan: Document) -> None:
    """Write the missing texts of hypotheses from their choices."""
    named = ChainMap(*resources.measures_here(study).values())
    sentences = ChainMap(*claims(study, study.languages[0]).values())
    for one in plan.get("hypotheses", ()):
        claim = sentences.get(claim_of(one), "")
        analysis = next((it for it in study.analyses if it.key == one.get("analysis")), None)
        if claim and analysis is not None and not one.get("text"):
            keys = one.get("measures") or analysis.measures
            one["text"] = f"{', '.join(named.get(key, key) for key in keys)} – {claim}."


def write_contrasts(study: StudyDefinition, analysis: Document) -> None:
    """Write the missing titles of contrasts: the conditions of both sides."""
    for one in analysis.get("contrasts", ()):
        for language in study.languages:
            sides = [_side(study, one.get(name, ()), language) for name in ("first", "second")]
            if all(sides) and not one.get("title", {}).get(language):
                one["title"] = {**one.get("title", {}), language: " – ".join(sides)}


def _claims(
    study: StudyDefinition, one: DeclaredAnalysis, language: str
) -> Iterator[tuple[str, str]]:
    words = effects(study, language)
    if one.is_model:
        for effect in one.effects:
            # an effect that depends on another factor has no direction
            directed = [] if one.interacts(effect) else study.factors
            levels = [level for it in directed if it.key == effect for level in it.levels]
            sides = [spoken(level.title, language) for level in levels]
            last = effect.replace(":", ".")
            yield from _directions(words.get(effect, effect), sides, f":{one.key}::{last}")
    elif not one.contrasts:
        yield f"different:{one.key}::", _("it differs between the conditions")
    for n, contrast in enumerate(one.contrasts, start=1):
        sides = [_side(study, keys, language) for keys in (contrast.first, contrast.second)]
        title = spoken(contrast.title, language) or f"{n}"
        yield from _directions(title, sides, f":{one.key}:{n}:")


def _side(study: StudyDefinition, keys: Iterable[str], language: str) -> str:
    found = [study.condition(key) for key in keys]
    return " + ".join(spoken(one.title, language) for one in found if one is not None)


def _directions(title: str, sides: Sequence[str], rest: str) -> Iterator[tuple[str, str]]:
    named = {"title": title, "first": sides[0], "second": sides[-1]} if sides else {"title": title}
    if len(sides) == DIRECTED:
        yield f"greater{rest}", _("%(title)s: greater with %(first)s than with %(second)s") % named
        yield f"less{rest}", _("%(title)s: smaller with %(first)s than with %(second)s") % named
        yield f"different{rest}", _("%(title)s: different with %(first)s and %(second)s") % named
    elif "." in rest:
        yield f"different{rest}", _("%(title)s: the effect of one depends on the other") % named
    else:
        yield f"different{rest}", _("%(title)s: a difference") % named


def _questionnaires(whole: Document) -> dict[str, Mapping[str, str]]:
    versions, titles = {}, {}
    for one in resources.usable():
        title = spoken(one.title, language_for(one, get_language() or ""))
        title = titles[one.slug] = questionnaires.listed_title(one.slug, title)
        words = _("%(title)s, version %(n)d") % {"title": title, "n": one.version}
        versions[f"{one.slug}:{one.version}"] = words
    asked = dict.fromkeys(step.get("questionnaire") for step in whole["steps"])
    statements = {slug: titles.get(slug, slug) for slug in asked if slug}
    versions = dict(sorted(versions.items(), key=lambda one: one[1].lower()))
    return {"versions": versions, "questionnaire": titles, "statements": statements}


def questionnaire_titles() -> dict[tuple[str, int], str]:
    titles = {key: one.title for key, one in resources.shipped_questionnaires().items()}
    rows = Questionnaire.objects.values_list("slug", "version", "definition")
    titles |= {(slug, version): definition["title"] for slug, version, definition in rows}
    words = {key: spoken(title, get_language() or "") for key, title in titles.items()}
    return {key: questionnaires.listed_title(key[0], title) for key, title in words.items()}


def speeds_refused(part: Document) -> dict[str, str]:
    """Return why speed limits of a condition are too high, by their field in its form."""
    try:
        condition = msgspec.convert(part, Condition)
    except msgspec.ValidationError:
        return {}
    robot = resources.robots_here().get(condition.robot)
    found = too_fast(condition, robot) if robot is not None else {}
    return {f"speed.{key}": capfirst(one.text(_)) for key, one in found.items()}


def places(plans: Iterable[Plan]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(place.name for plan in plans for place in plan.places))
