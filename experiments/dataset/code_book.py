"""The description of a dataset (`dataset_description.json`): its title, its authors, and every
column of every file with unit, range and levels, from the columns by which the files are written.

It is a Dataset of schema.org as JSON-LD, as Psych-DS requires, with words of schema.org alone: a
range is `minValue` and `maxValue`, and each level is a PropertyValue in `valueReference`.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

from experiments.dataset.columns import TIMES, Column, Tables, declared
from experiments.dataset.levels import MISSING, Levels
from experiments.dataset.records import TABLES, AnswerRecord, Dataset
from experiments.dataset.states import NETWORK, STATES
from experiments.definition.publication import json_ld
from surveys.definition import Definition
from surveys.documents import spoken
from surveys.item import Question
from surveys.scoring import ScoredScale, WideTable, scales_of

LAYOUTS = {name: declared(kind) for name, kind in TABLES.items()}
LAYOUTS |= {"states": STATES, "network": NETWORK}


def description(
    dataset: Dataset, more: Tables | None = None, without: Collection[str] = ()
) -> dict[str, Any]:
    """Return the description of a dataset. `more` are the columns of tables that are written in
    addition to those of a dataset, `without` the tables that are not written because they would be
    empty.
    """
    study = dataset.study
    return {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": study.title.get("en") or next(iter(study.title.values()), study.slug),
        "description": f"Records of the study {study.slug}, version {study.version}. {TIMES}",
        "version": str(study.version),
        "schemaVersion": "Psych-DS 1.5.0",
        **json_ld(dataset.publication),
        "variableMeasured": [
            _variable(file, column)
            for file, layout in layouts(dataset, more or {})
            if file not in without
            for column in layout
        ],
    }


def _variable(file: str, column: Column) -> dict[str, Any]:
    divided = f"; several words are separated by {column.divider}" if column.divider else ""
    renamed = f"; in earlier releases {column.was}" if column.was else ""
    found: dict[str, Any] = {
        "@type": "PropertyValue",
        "name": column.name,
        "unitText": column.unit,
        "description": f"{file}: {column.meaning}{renamed}{divided}",
    }
    bounds = {"minValue": column.least, "maxValue": column.greatest}
    found |= {name: value for name, value in bounds.items() if value is not None}
    if column.levels:
        found["valueReference"] = [
            {"@type": "PropertyValue", "value": value}
            | ({"description": meaning} if meaning else {})
            for value, meaning in column.levels.items()
        ]
    return found


def layouts(dataset: Dataset, more: Tables) -> Iterator[tuple[str, Sequence[Column]]]:
    """Yield every table by name, with its columns; `more` takes precedence over LAYOUTS."""
    named = _named(dataset)
    for name, layout in {**LAYOUTS, **more}.items():
        yield name, [replace(one, levels=named.get(one.name, one.levels)) for one in layout]
    for slug in sorted({one.slug for one in dataset.questionnaires}):
        versions = [one for one in dataset.questionnaires if one.slug == slug]
        asking = (one for one in dataset.study.questionnaire_steps if one.questionnaire == slug)
        steps = {one.key: named["step"][one.key] for one in asking}
        yield slug, list(_wide(versions, dataset.language, steps))


def _named(dataset: Dataset) -> Mapping[str, Levels]:
    """Return the levels of the columns whose words are the study's own."""
    study, say = dataset.study, dataset.say
    steps = {one.key: f"{one.kind}: {say(one.title)}" for one in study.steps}
    steps |= {
        one.key: f"{one.kind}, {study.when(one)}: {say(one.title)}"
        for one in study.questionnaire_steps
    }
    conditions = {one.key: say(one.title) for one in study.conditions}
    doors = chain.from_iterable(plan.doors for plan in dataset.plans.values())
    closed = dict.fromkeys(chain.from_iterable(one.doors_closed for one in study.conditions), "")
    return {
        "condition": conditions,
        "cell": conditions,
        "first_cell": conditions,
        "doors_closed": closed | {door.name: door.title for door in doors},
        "step": steps,
        "reached": steps,
        "site": dict.fromkeys([*dataset.plans, *(one.site for one in study.courses)], ""),
        "robot": {one.name: one.title for one in dataset.robots},
        "questionnaire": {one.slug: say(one.title) for one in dataset.questionnaires},
    }


# The columns about a response before its answers, which are fields of AnswerRecord.
ABOUT_RESPONSE = ("response", "version", "participant", "session", "finished", "step")


def _wide(versions: Sequence[Definition], language: str, steps: Levels) -> Iterator[Column]:
    """Yield the columns of a table with a line a response, which one of `steps` asked."""
    known = {column.name: column for column in declared(AnswerRecord)}
    known["step"] = replace(known["step"], levels=steps)
    for one in versions:
        for question in one.questions():
            known |= {column.name: column for column in _asked(one, question, language)}
        for scale in scales_of(one):
            low, high = scale.bounds
            meaning = _scored(one, scale, language)
            known[scale.name] = Column(scale.name, "", meaning, least=low, greatest=high)
    for name in (*ABOUT_RESPONSE, *WideTable(versions).head):
        yield known.get(name) or Column(name, "", "score")


def _scored(definition: Definition, scale: ScoredScale, language: str) -> str:
    about = spoken(scale.label, language) or spoken(definition.title, language)
    low, high = scale.bounds
    turned: dict[float, list[str]] = {}
    ends: dict[str, list[str]] = {}
    for key in scale.items:
        question = definition.question(key)
        if question is None or not question.score_values:
            continue
        if key in definition.reversed:
            turned.setdefault(question.from_other_end(0), []).append(key)
        end = spoken(question.ends[0 if key in definition.reversed else 1], language)
        ends.setdefault(end, []).append(key)
    nearer = "; ".join(
        f"to “{end}” in {', '.join(keys)}" if len(ends) > 1 else f"to “{end}”"
        for end, keys in ends.items()
    )
    parts = [f"score of: {about} – {scale.formula}"]
    parts += [f"{', '.join(keys)} counted as {total:g} − answer" for total, keys in turned.items()]
    return "; ".join([*parts, f"from {low:g} to {high:g}", f"higher is nearer {nearer}"])


def _asked(definition: Definition, question: Question, language: str) -> Iterator[Column]:
    text, item = spoken(question.text, language), question.item
    if question.key in definition.reversed:
        text += " (reverse-coded: stored as answered, scores count it from the other end)"
    names = item.columns(question.key)
    for name, label in names.items():
        about = spoken(label, language)
        column = Column(name, "", f"{text} – {about}" if about else text)
        yield _bounded(column, question, language) if len(names) == 1 else column
    why = f"why there is no answer to: {text}"
    yield Column(f"{question.key}_missing", "", why, levels=MISSING)


def _bounded(column: Column, question: Question, language: str) -> Column:
    labelled = question.item.labelled_values(question.points)
    levels = {str(value): spoken(label, language) for value, label in labelled}
    values, meaning = question.score_values, column.meaning
    least, greatest = (values[0], values[-1]) if values else (None, None)
    low, high = (spoken(end, language) for end in question.ends)
    if low and not levels:
        meaning += f" ({least}: {low}; {greatest}: {high})"
    divider = "|" if levels and question.item.takes_several else ""
    bounded = replace(column, least=least, greatest=greatest)
    return replace(bounded, meaning=meaning, levels=levels, divider=divider)
