"""The design page: factors, what levels set, what conditions share, assignment, and a table."""

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

import msgspec
from django.conf import settings
from django.utils.text import capfirst
from django.utils.translation import get_language, gettext as _, ngettext, override

from experiments.builder.arrangement import MOST_LETTERS, Renamed, free_key
from experiments.builder.labels import GUIDE
from experiments.definition.design import Factor, Level
from experiments.definition.factors import (
    SETTING_NAMES,
    SETTINGS,
    conditions_together,
    levels_of,
    setting_of,
)
from experiments.definition.schema import Allocation, Condition, StudyDefinition
from experiments.participation.assignment import cells
from surveys.document_forms.parts import Document
from surveys.documents import DocumentPart, ascii_name, spoken, text_in

# Generated keys, which follow the title.
_AUTOMATIC = re.compile(r"(factor|level)_\d+")
_OWN_PAGE = frozenset({"key", "title", "levels", "access"})  # of a condition: never shared
_SHORT = {"video_delay": "delay", "video_loss": "loss", "video_jitter": "jitter"}
_EVERYWHERE = frozenset({"robot", "site", "controllers"})  # every condition sets these
NEW_LEVELS = 2


class StudyDesign(DocumentPart, frozen=True, kw_only=True):
    """The document of the page; `shared` has the settings that are the same in all conditions."""

    factors: tuple[Factor, ...] = ()
    shared: Condition
    allocation: Allocation = Allocation()


def design_of(whole: Document) -> Document:
    fields, first = shared_fields(whole), next(iter(whole["conditions"]), dict[str, Any]())
    shared = {key: value for key, value in first.items() if key in fields}
    allocation = whole.get("allocation", {})
    return {"factors": whole["factors"], "shared": shared, "allocation": allocation}


def shared_fields(whole: Document) -> tuple[str, ...]:
    """Return the fields of conditions that no factor changes and in which all are the same."""
    conditions = whole["conditions"]
    names = (name for factor in whole["factors"] for name in factor.get("changes", ()))
    own = _OWN_PAGE.union(SETTINGS[name][0] for name in names)
    fields = [name for name in Condition.__struct_encode_fields__ if conditions and name not in own]
    values = {name: [one.get(name) for one in conditions] for name in fields}
    return tuple(name for name, of_all in values.items() if of_all == of_all[:1] * len(of_all))


def with_design(whole: Document, design: Document) -> Document:
    fields, shared = shared_fields(whole), design.get("shared", {})
    own = {"factors": design.get("factors", []), "allocation": design.get("allocation", {})}
    own["conditions"] = [
        {key: value for key, value in one.items() if key not in fields} | shared
        for one in whole["conditions"]
    ]
    return whole | own


def set_by_levels(study: StudyDefinition, key: str) -> dict[str, str]:
    """Return the fields that levels set ("network.video.delay") with the titles of the levels."""
    condition = study.condition(key)
    own = levels_of(study, condition) if condition is not None else []
    titles = {name: shown(level) for factor, level in own for name in factor.changes}
    return {".".join(SETTINGS[name]): title for name, title in titles.items()}


def shown(part: Condition | Factor | Level) -> str:
    """Return the title of a part in the language of the page, or its key."""
    return spoken(part.title, get_language() or "") or part.key


def restore(part: Document, former: Document, fields: Iterable[str]) -> None:
    """Give fields of a part their former values: browsers do not send disabled fields."""
    for field in fields:
        *path, key = field.split(".")
        here, before = part, former
        for step in path:
            here[step] = here.get(step) or {}
            here, before = here[step], before.get(step) or {}
        here.pop(key, None)
        here |= {key: before[key]} if key in before else {}


def new_factor(factors: list[Document], setting: str, languages: Iterable[str]) -> Document:
    """Return a factor with two levels that changes a setting ("": none), within if the last is."""
    taken = [one["key"] for one in factors]
    factor: Document = {"key": _next("factor", taken), "title": {}}
    if setting:
        factor = {"key": free_key(_SHORT.get(setting, setting), taken), "title": {}}
        factor["changes"] = [setting]
        for language in languages:
            with _translated(language):
                factor["title"][language] = capfirst(_(SETTING_NAMES[setting]))
    if factors and "design" in factors[-1]:
        factor["design"] = factors[-1]["design"]
    return factor | {"levels": [{"key": f"level_{n + 1}", "title": {}} for n in range(NEW_LEVELS)]}


def _translated(language: str) -> override:
    """Translate into a language of the site; into English for others."""
    return override(language if language in dict(settings.LANGUAGES) else "en")


def new_level(levels: list[Document]) -> Document:
    return {"key": _next("level", [one["key"] for one in levels]), "title": {}}


def _next(word: str, taken: Collection[str]) -> str:
    return next(name for n in range(1, len(taken) + 2) if (name := f"{word}_{n}") not in taken)


def complete(design: Document, former: Document, languages: Collection[str]) -> None:
    """Fill in what was left blank: values of new levels from the first condition, titles from the
    values, and keys from the titles. Generated titles and keys follow a change.
    """
    known = {factor["key"]: factor for factor in former["factors"]}
    for factor in design.get("factors", ()):
        before = known.get(factor.get("was", ""), {})
        levels = {level["key"]: level for level in before.get("levels", ())}
        changes = factor.get("changes", [])
        for level in factor.get("levels", ()):
            level["sets"] = _values(changes, level.get("sets", {}), former)
            _title(level, changes, levels.get(level.get("was", ""), {}), languages)
    _name(design.get("factors", []), known, "factor", languages)


def _values(changes: Iterable[str], sets: Document, former: Document) -> Document:
    first = msgspec.convert(former["conditions"][0], Condition) if former["conditions"] else None
    values = {name: sets.get(name) for name in changes}
    for name in (name for name, value in values.items() if value is None):
        if first is not None:
            values[name] = msgspec.to_builtins(setting_of(first, name))
        if values[name] is None and SETTINGS[name][0] == "network":
            values[name] = 0.0
    return {name: value for name, value in values.items() if value is not None}


def _title(
    level: Document, changes: Iterable[str], before: Document, languages: Iterable[str]
) -> None:
    for language in languages:
        with _translated(language):
            text = values_text(changes, level["sets"])
            former = values_text(changes, before.get("sets", {}))
        if text and level.get("title", {}).get(language, "") in {"", former}:
            level["title"] = {**level.get("title", {}), language: text}


def _name(
    parts: list[Document], known: Mapping[str, Document], word: str, languages: Collection[str]
) -> None:
    """Give keys to factors, or to the levels of one (`word` is then its key)."""
    for n, part in enumerate(parts):
        key, was = part.get("key", ""), part.get("was", "")
        former = known.get(was, {})
        stem = _stem(former, languages, word)
        is_from_title = key == was and bool(stem) and re.fullmatch(rf"{stem}(_\d+)?", key)
        if not key or _AUTOMATIC.fullmatch(key) or is_from_title:
            taken = [one.get("key", "") for one in parts[:n] + parts[n + 1 :]]
            stem = _stem(part, languages, word)
            part["key"] = free_key(stem, taken) if stem else key or _next(word, taken)
        levels = {level["key"]: level for level in former.get("levels", ())}
        _name(part.get("levels", []), levels, part["key"], languages)


def _stem(part: Document, languages: Iterable[str], before: str) -> str:
    """Return a key by the value or title: "300 ms" of a delay is "delay_300_ms"; "" for none."""
    values = [one for one in part.get("sets", {}).values() if isinstance(one, str)]
    text = next(iter(values), "") or text_in(part.get("title", {}), languages)
    words = ascii_name(text)
    name = words if not words or words[0].isalpha() else f"{before}_{words}"
    return name[:MOST_LETTERS].rstrip("_")


def renaming(design: Document) -> Renamed:
    """Return which factors and levels have new keys; removes the former keys from the design."""
    factors, levels = {}, {}
    for factor in design.get("factors", ()):
        own = {level.pop("was", ""): level["key"] for level in factor.get("levels", ())}
        if was := factor.pop("was", ""):
            factors[was], levels[was] = factor["key"], own
    return Renamed(factors=factors, levels=levels)


def values_text(changes: Iterable[str], sets: Mapping[str, Any]) -> str:
    known = (name for name in changes if sets.get(name) is not None)
    return ", ".join(setting_text(name, sets[name]) for name in known)


def setting_text(name: str, value: Any) -> str:
    """Return the value of a setting with its unit, or in words."""
    if isinstance(value, list | tuple):
        nothing = {"doors_closed": _("all doors open"), "actions": _("no actions")}
        words = ", ".join(str(GUIDE.word(name, one)) for one in value)
        return words or nothing.get(name, _("no device"))
    if isinstance(value, str):
        return str(GUIDE.word(name, value))
    match name.rpartition("_")[2]:
        case "delay" | "jitter":
            return f"{1000.0 * value:g} ms"
        case "loss":
            return f"{100.0 * value:g} %"
        case "linear":
            return f"{value:g} m/s"
        case "angular":
            return f"{math.degrees(value):.4g} °/s"
    return str(value)


def condition_facts(condition: Document, *, but: Collection[str] = ()) -> Iterator[str]:
    """Yield the settings of a condition, without defaults and the settings `but`, in words."""
    own = msgspec.convert(condition, Condition)
    usual = Condition(key="a", title={}, robot="", site="", controllers=())
    for name in SETTINGS:
        value = setting_of(own, name)
        if name not in {*_EVERYWHERE, *but} and value != setting_of(usual, name):
            yield f"{_(SETTING_NAMES[name])}: {setting_text(name, value)}"


def design_table(study: StudyDefinition) -> dict[str, Any]:
    """Return the conditions as a table with a column for each factor, and counts as `facts`."""
    changed = {name for factor in study.factors for name in factor.changes}
    rows: list[Document] = []
    for n, one in enumerate(study.conditions):
        levels = [_level_text(factor, level) for factor, level in levels_of(study, one)]
        facts = list(condition_facts(msgspec.to_builtins(one), but=changed))
        rows.append({"n": n, "title": shown(one), "key": one.key, "levels": levels, "facts": facts})
    heads = [shown(factor) for factor in study.factors]
    return {"heads": heads, "rows": rows, "facts": list(_numbers(study))}


def _level_text(factor: Factor, level: Level) -> str:
    """Return the title of a level, with what it sets unless the title contains it."""
    title = shown(level)
    values = values_text(factor.changes, msgspec.to_builtins(level.sets))
    return title if not values or values in title else f"{title} ({values})"


def _numbers(study: StudyDefinition) -> Iterator[str]:
    together = conditions_together(study)
    if not together:
        return
    n, most = len(study.conditions), max(map(len, together))
    yield ngettext("%(n)d condition", "%(n)d conditions", n) % {"n": n}
    yield ngettext("each participant does %(n)d", "each participant does %(n)d", most) % {"n": most}
    count = len(cells(study, "open")) + len(cells(study, "invitation"))
    if most > 1:
        words = ngettext("%(n)d order of conditions", "%(n)d orders of conditions", count)
        yield words % {"n": count}
    quota, planned = study.allocation.quota, study.plan.participants if study.plan else None
    if quota is not None:
        words = _("%(quota)d participants in each: %(total)d participants needed")
        yield words % {"quota": quota, "total": quota * count}
    elif count > 1:
        yield _("participants needed: %(n)d, or a multiple of it") % {"n": count}
    if planned is not None and planned % count:
        words = _("the plan has %(n)d participants, which is not a multiple of %(cells)d")
        yield words % {"n": planned, "cells": count}
