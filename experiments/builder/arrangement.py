"""What follows from the design of a study: its conditions are the cells of its factors, with what
their levels set, and what participants do once for each condition is repeated. Pure.

The study builder applies it whenever it saves a study. What researchers wrote themselves is kept:
names and titles of conditions, and every setting that no level sets.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
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

MOST_LETTERS = 40  # of a short name
Document = dict[str, Any]
DesignCell = tuple[tuple[Factor, Level], ...]


@dataclass(frozen=True)
class Renamed:
    """New short names by the former ones; those of levels by the former name of their factor."""

    factors: Mapping[str, str] = field(default_factory=dict)
    levels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    conditions: Mapping[str, str] = field(default_factory=dict)
    analyses: Mapping[str, str] = field(default_factory=dict)
    hypotheses: Mapping[str, str] = field(default_factory=dict)

    def of(self, key: str, value: Any) -> Any:
        """Return what a field of a document has after the renaming."""
        match key:
            case "effect":
                return ":".join(self.factors.get(name, name) for name in value.split(":"))
            case "condition":
                return self.conditions.get(value, value)
            case "analysis":
                return self.analyses.get(value, value)
            case "effects":
                return [self.of("effect", one) for one in value]
            case "first" | "second" | "conditions":
                return [self.conditions.get(one, one) for one in value]
            case "hypotheses":
                return [self.hypotheses.get(one, one) for one in value]
            case "levels":
                return {
                    self.factors.get(factor, factor): self.levels.get(factor, {}).get(level, level)
                    for factor, level in value.items()
                }
        return value


def renamed(part: Any, names: Renamed) -> Any:
    """Return a document in which each reference has its new name. The parts that have the names
    keep theirs.
    """
    if isinstance(part, list | tuple):
        return [renamed(one, names) for one in part]
    if not isinstance(part, dict):
        return part
    return {key: _renamed(key, value, names) for key, value in part.items()}


def _renamed(key: str, value: Any, names: Renamed) -> Any:
    is_level_of_condition = key == "levels" and isinstance(value, dict)
    is_names = isinstance(value, list | tuple) and all(isinstance(one, str) for one in value)
    if is_level_of_condition or is_names or isinstance(value, str):
        return names.of(key, value)
    return renamed(value, names)


def arranged(study: StudyDefinition, former: StudyDefinition, blank: Condition) -> StudyDefinition:
    """Return a study with what follows from its design.

    Args:
        study: as it was changed; references have their new names already.
        former: before the change, from which it is known which names nobody wrote.
        blank: the first condition of a study without any.
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
    """Yield steps, of which the task and the questionnaires right after it are repeated."""
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
        key, titles = _automatic(study, cell)
        former_key, former_titles = written.get(own.key, ("", {}))
        if is_new or own.key == former_key:
            others = (one.key for one in study.conditions if is_new or one is not own)
            key = _free(key, (*others, *(one.key for one in made)))
        else:
            key = own.key
        if not is_new:
            keys[own.key] = key
        kept = {} if is_new else _written(own.title, former_titles)
        title = {language: kept.get(language, text) for language, text in titles.items()}
        levels = {factor.key: level.key for factor, level in cell}
        made.append(with_levels(replace(own, key=key, title=title, levels=levels), cell))
    places = {cell_of(one, study.factors): n for n, one in enumerate(study.conditions)}
    made.sort(key=lambda one: places.get(cell_of(one, study.factors), len(places)))
    names = Renamed(conditions={old: new for old, new in keys.items() if old != new})
    document = renamed(msgspec.to_builtins(replace(study, conditions=tuple(made))), names)
    found: StudyDefinition = msgspec.convert(document, StudyDefinition)
    return found


def _matched(
    study: StudyDefinition, cells: Iterable[DesignCell], blank: Condition
) -> Iterator[tuple[DesignCell, Condition, bool]]:
    """Yield each cell with its condition, and whether that is new: a copy of one that has the same
    levels of the other factors, or of the first.
    """
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
    """Return the short name and the titles of a cell that nobody named."""
    key = "_".join(level.key for _factor, level in cell)[:MOST_LETTERS].rstrip("_")
    titles = {
        language: ", ".join(filter(None, (spoken(level.title, language) for _one, level in cell)))
        for language in study.languages
    }
    return key, titles


def _written(title: Mapping[str, str], automatic: Mapping[str, str]) -> dict[str, str]:
    return {
        language: text
        for language, text in title.items()
        if text.strip() and text != automatic.get(language)
    }


def _free(key: str, taken: Iterable[str]) -> str:
    known, n, free = set(taken), 2, key
    while free in known:
        free, n = f"{key[: MOST_LETTERS - 4]}_{n}", n + 1
    return free
