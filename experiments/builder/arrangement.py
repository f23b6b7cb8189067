"""What follows from the design of a study, whenever the builder saves it: the conditions are the
cells of the factors, and steps for each condition are repeated. Names, titles and settings that
researchers entered are kept. Pure.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product, takewhile
from typing import Any

import msgspec
from msgspec.structs import replace

from experiments.definition.design import Factor, Level
from experiments.definition.factors import MOST_CELLS, cell_of, levels_of, with_levels
from experiments.definition.schema import AnyStep, Condition, StudyDefinition
from experiments.definition.step import AskingStep
from experiments.definition.steps.task import TaskStep
from surveys.documents import spoken

MOST_LETTERS = 40  # of a key
Document = dict[str, Any]
DesignCell = tuple[tuple[Factor, Level], ...]


@dataclass(frozen=True)
class Renamed:
    """New keys by the former ones; those of levels by the former key of their factor."""

    factors: Mapping[str, str] = field(default_factory=dict)
    levels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    conditions: Mapping[str, str] = field(default_factory=dict)
    analyses: Mapping[str, str] = field(default_factory=dict)
    hypotheses: Mapping[str, str] = field(default_factory=dict)

    def of(self, key: str, value: Any) -> Any:
        match key:
            case "effect":
                return ":".join(self.factors.get(name, name) for name in value.split(":"))
            case "effects":
                return [self.of("effect", one) for one in value]
            case "levels" if isinstance(value, dict):
                return {
                    self.factors.get(factor, factor): self.levels.get(factor, {}).get(level, level)
                    for factor, level in value.items()
                }
            case "condition" | "first" | "second" | "conditions":
                new = self.conditions
            case "analysis":
                new = self.analyses
            case "hypotheses":
                new = self.hypotheses
            case _:
                return value
        return [new.get(one, one) for one in value] if is_list(value) else new.get(value, value)


def is_list(value: Any) -> bool:
    return isinstance(value, list | tuple)


def renamed(part: Any, names: Renamed, key: str = "") -> Any:
    """Return a document (the field `key` of another) with the new names in its references only."""
    if isinstance(part, dict) and key != "levels":
        return {name: renamed(value, names, name) for name, value in part.items()}
    if is_list(part) and not all(isinstance(one, str) for one in part):
        return [renamed(one, names) for one in part]
    return names.of(key, part)


def arranged(study: StudyDefinition, former: StudyDefinition, blank: Condition) -> StudyDefinition:
    """Return a changed study, whose references have their new names already, with what follows from
    its design. `former` tells which names were generated; `blank` is the first condition of a study
    without any.
    """
    if study.factors:
        is_within = any(factor.design == "within" for factor in study.factors)
        design = replace(study.allocation, design="within" if is_within else "between")
        study = _with_cells(replace(study, allocation=design), former, blank)
    task = study.task
    if study.allocation.design == "within" and task is not None and not task.repeat:
        study = replace(study, steps=tuple(_repeated(study.steps)))
    return study


def _repeated(steps: Sequence[AnyStep]) -> Iterator[AnyStep]:
    """Yield the steps, with the task and the questionnaires right after it repeated."""
    task = next(n for n, step in enumerate(steps) if isinstance(step, TaskStep))
    after = takewhile(lambda one: isinstance(one, AskingStep) and one.may_repeat, steps[task + 1 :])
    last = task + len(list(after))
    for n, step in enumerate(steps):
        yield replace(step, repeat=True) if task <= n <= last else step


def _with_cells(
    study: StudyDefinition, former: StudyDefinition, blank: Condition
) -> StudyDefinition:
    cells = list(product(*([(one, level) for level in one.levels] for one in study.factors)))
    if not 0 < len(cells) <= MOST_CELLS:
        return study
    written = {one.key: _automatic(former, levels_of(former, one)) for one in former.conditions}
    made: list[Condition] = []
    keys: dict[str, str] = {}
    for cell, own, is_new in _matched(study, cells, blank):
        key, title = _automatic(study, cell)
        former_key, former_titles = ("", {}) if is_new else written.get(own.key, ("", {}))
        if is_new or own.key == former_key:
            others = [one.key for one in study.conditions if is_new or one is not own]
            key = free_key(key, (*others, *(one.key for one in made)))
        else:
            key = own.key
        if not is_new:
            keys[own.key] = key
            for name in title:
                text = own.title.get(name, "")
                if text.strip() and text != former_titles.get(name):
                    title[name] = text
        levels = {factor.key: level.key for factor, level in cell}
        made.append(with_levels(replace(own, key=key, title=title, levels=levels), cell))
    places = {cell_of(one, study.factors): n for n, one in enumerate(study.conditions)}
    made.sort(key=lambda one: places.get(cell_of(one, study.factors), len(places)))
    document = msgspec.to_builtins(replace(study, conditions=tuple(made)))
    return msgspec.convert(renamed(document, Renamed(conditions=keys)), StudyDefinition)


def _matched(
    study: StudyDefinition, cells: Iterable[DesignCell], blank: Condition
) -> Iterator[tuple[DesignCell, Condition, bool]]:
    """Yield each cell with its condition; a new one (True) is a copy of one with shared levels."""
    left = list(study.conditions)
    for cell in cells:
        wanted = {factor.key: level.key for factor, level in cell}

        def fits(one: Condition, wanted: Mapping[str, str] = wanted) -> bool:
            levels = {factor.key: level.key for factor, level in levels_of(study, one)}
            return levels.items() <= wanted.items()

        own = next((one for one in left if one.levels == wanted), None)
        own = own or next((one for one in left if fits(one)), None)
        if own is not None:
            left.remove(own)
            yield cell, own, False
        else:
            like = [*filter(fits, study.conditions), *study.conditions, blank]
            yield cell, like[0], True


def _automatic(
    study: StudyDefinition, cell: Sequence[tuple[Factor, Level]]
) -> tuple[str, dict[str, str]]:
    key = "_".join(level.key for _factor, level in cell)[:MOST_LETTERS].rstrip("_")
    titles = {
        language: ", ".join(filter(None, (spoken(level.title, language) for _one, level in cell)))
        for language in study.languages
    }
    return key, titles


def free_key(key: str, taken: Collection[str]) -> str:
    """Return a key that is not taken: this one, or with the first free number after it."""
    numbered = (f"{key[: MOST_LETTERS - 4]}_{n}" for n in range(2, len(taken) + 3))
    return key if key not in taken else next(name for name in numbered if name not in taken)
