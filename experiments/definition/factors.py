"""Crossed factors: which conditions one participant may have, what levels set in a condition, and
the problems of a design. A condition is a cell: it has one level of each factor.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain, product
from typing import Any, NamedTuple, get_args

from msgspec.structs import replace

from experiments.definition.design import Factor, Level, Setting
from experiments.definition.schema import Condition, Impairment, StudyDefinition
from experiments.definition.step import AskingStep
from surveys.documents import Problem, ProblemPlace, duplicates, gettext_noop as _, within

LEAST_LEVELS = 2
MOST_PERMUTED = 4  # conditions of which all orders are made: 24
MOST_ORDERED = 9  # conditions of one participant, in balanced or fixed order
MOST_CELLS = 24  # conditions of a study
# The path of each setting in a condition.
SETTINGS: dict[str, tuple[str, ...]] = {name: (name,) for name in get_args(Setting)}
SETTINGS |= {name: ("speed", name) for name in ("linear", "angular")}
for _direction, _name in product(("video", "control"), ("delay", "jitter", "loss")):
    SETTINGS[f"{_direction}_{_name}"] = ("network", _direction, _name)
SETTING_NAMES: Mapping[str, str] = {
    "video_delay": _("delay of the video"),
    "video_jitter": _("jitter of the video"),
    "video_loss": _("packet loss of the video"),
    "control_delay": _("delay of the commands"),
    "control_jitter": _("jitter of the commands"),
    "control_loss": _("packet loss of the commands"),
    "assist": _("assistance"),
    "interface": _("interface"),
    "controllers": _("input devices"),
    "actions": _("actions the robot may be given"),
    "control_way": _("command channel"),
    "linear": _("speed limit"),
    "angular": _("limit of the turning speed"),
    "doors_closed": _("closed doors"),
    "robot": _("robot"),
    "site": _("site"),
}


def setting_of(condition: Condition, name: str) -> Any:
    value: Any = condition
    for step in SETTINGS[name]:
        value = getattr(Impairment() if value is None else value, step)
    return value


def levels_of(study: StudyDefinition, condition: Condition) -> list[tuple[Factor, Level]]:
    """Return the levels of a condition, in the order of the factors, without unknown ones."""
    own = condition.levels
    known = ((factor, level) for factor in study.factors for level in factor.levels)
    return [(factor, level) for factor, level in known if level.key == own.get(factor.key)]


def with_levels(condition: Condition, cell: Iterable[tuple[Factor, Level]]) -> Condition:
    for factor, level in cell:
        for name in factor.changes:
            value = getattr(level.sets, name)
            if value is not None:
                condition = _with(condition, SETTINGS[name], value)
    return condition


def _with(part: Any, path: Sequence[str], value: Any) -> Any:
    name, *rest = path
    if rest:
        inner = getattr(part, name)
        value = _with(Impairment() if inner is None else inner, rest, value)
    return replace(part, **{name: None if value == Impairment() else value})


def groups(study: StudyDefinition, access: str) -> tuple[tuple[Condition, ...], ...]:
    """Group conditions of an access; a participant has one (between) or all (within) of one."""
    found: dict[tuple[str, ...], list[Condition]] = {}
    for condition in study.conditions:
        if condition.access == access:
            found.setdefault(_between_cell(study, condition), []).append(condition)
    return tuple(tuple(one) for one in found.values())


def conditions_together(study: StudyDefinition) -> list[tuple[str, ...]]:
    """Return the keys of the conditions that one participant does, for each kind of participant."""
    parts = [*groups(study, "open"), *groups(study, "invitation")]
    if study.allocation.design == "within":
        return [tuple(one.key for one in group) for group in parts]
    return [(one.key,) for group in parts for one in group]


def participants_do_several(study: StudyDefinition) -> bool:
    return any(len(keys) > 1 for keys in conditions_together(study))


def steps_about_drive(study: StudyDefinition) -> frozenset[str]:
    """Return the keys of the steps that belong to the drive of their round. A questionnaire that
    participants answer once, though they do several conditions, is about none of these.
    """
    is_once = participants_do_several(study)
    return frozenset(
        step.key
        for step in study.steps
        if step.repeat
        or step == study.task
        or (isinstance(step, AskingStep) and not (step.is_about_person or is_once))
    )


class SideLayout(NamedTuple):
    """How participants are on the sides of a comparison, by the design of the study alone, so that
    returning and leaving do not change the test. `is_paired`: some have all sides; None: some have
    several, but none has all. `is_single`: none has several conditions of a side.
    """

    is_paired: bool | None
    is_single: bool


def layout_of(study: StudyDefinition, sides: Iterable[Collection[str]]) -> SideLayout:
    sides = list(sides)
    had = [
        [len(set(keys).intersection(side)) for side in sides] for keys in conditions_together(study)
    ]
    is_apart = all(sum(map(bool, counts)) <= 1 for counts in had)
    is_paired = None if not is_apart and not any(map(all, had)) else not is_apart
    return SideLayout(is_paired, all(n <= 1 for counts in had for n in counts))


def problems(study: StudyDefinition) -> Iterator[Problem]:
    keys = (factor.key for factor in study.factors)
    yield from within(duplicates(_("Factor"), keys), ProblemPlace("factors"))
    changed = Counter[str](name for factor in study.factors for name in factor.changes)
    for n, factor in enumerate(study.factors):
        place = ProblemPlace("factors", n)
        yield from within(_of_factor(factor, changed), place, _("Factor"), factor.key)
    count = math.prod(len(factor.levels) for factor in study.factors)
    if count > MOST_CELLS:
        words = _("The factors have %(n)d cells; at most %(most)d are allowed.")
        yield Problem(words, {"n": count, "most": MOST_CELLS}, place=ProblemPlace("design"))
    else:
        wrong = (
            of_condition(n, one, _of_levels(study, one)) for n, one in enumerate(study.conditions)
        )
        yield from list(chain.from_iterable(wrong)) or _of_cells(study)
    yield from within(_of_design(study), ProblemPlace("design"))


def _of_factor(factor: Factor, changed: Mapping[str, int]) -> Iterator[Problem]:
    if len(factor.levels) < LEAST_LEVELS:
        yield Problem(_("it needs at least %(n)d levels."), {"n": LEAST_LEVELS})
    yield from duplicates(_("Level"), (level.key for level in factor.levels))
    for name in factor.changes:
        if changed[name] > 1:
            words = _("another factor changes the same setting: %(setting)s.")
            yield Problem(words, {"setting": SETTING_NAMES[name]})
    for level in factor.levels:
        for name in SETTINGS:
            is_set, named = getattr(level.sets, name) is not None, SETTING_NAMES[name]
            if is_set and name not in factor.changes:
                words = _("the level %(level)s sets what the factor does not change: %(setting)s.")
            elif not is_set and name in factor.changes:
                words = _("the level %(level)s does not set what the factor changes: %(setting)s.")
            else:
                continue
            yield Problem(words, {"level": level.key, "setting": named})


def of_condition(n: int, condition: Condition, found: Iterable[Problem]) -> Iterator[Problem]:
    """Yield problems as those of the condition with a number."""
    return within(found, ProblemPlace("conditions", n), _("Condition"), condition.key)


def _of_levels(study: StudyDefinition, condition: Condition) -> Iterator[Problem]:
    known = {factor.key: [level.key for level in factor.levels] for factor in study.factors}
    for key, levels in known.items():
        own = condition.levels.get(key, "")
        if not own:
            yield Problem(_("choose its level of the factor %(key)s."), {"key": key})
        elif own not in levels:
            words = _("the factor %(key)s has no level %(level)s.")
            yield Problem(words, {"key": key, "level": own})
    for key in condition.levels:
        if key not in known:
            yield Problem(_("there is no factor %(key)s."), {"key": key})
    wanted = with_levels(condition, levels_of(study, condition))
    for name in SETTINGS:
        if setting_of(condition, name) != setting_of(wanted, name):
            words = _("it differs from what its levels set: %(setting)s.")
            yield Problem(words, {"setting": SETTING_NAMES[name]})


def _of_cells(study: StudyDefinition) -> Iterator[Problem]:
    if not study.factors:
        return
    wanted = product(*([(one.key, level.key) for level in one.levels] for one in study.factors))
    first: dict[tuple[tuple[str, str], ...], str] = {}
    for n, condition in enumerate(study.conditions):
        cell = cell_of(condition, study.factors)
        if cell in first:
            words = _(
                "it has the same levels as the condition %(key)s; each cell of the factors needs "
                "exactly one condition."
            )
            yield from of_condition(n, condition, [Problem(words, {"key": first[cell]})])
        first.setdefault(cell, condition.key)
    for cell in wanted:
        if cell not in first:
            words = _(
                "No condition has %(levels)s; each cell of the factors needs exactly one condition."
            )
            named = {"levels": ", ".join(f"{factor} {level}" for factor, level in cell)}
            yield Problem(words, named, place=ProblemPlace("conditions"))


def cell_of(condition: Condition, factors: Sequence[Factor]) -> tuple[tuple[str, str], ...]:
    return tuple((factor.key, condition.levels.get(factor.key, "")) for factor in factors)


def _of_design(study: StudyDefinition) -> Iterator[Problem]:
    inside = [factor.key for factor in study.factors if factor.design == "within"]
    is_within = study.allocation.design == "within"
    if inside and not is_within:
        words = _("The assignment must be within participants, because the factor %(key)s is.")
        yield Problem(words, {"key": inside[0]})
    if study.factors and is_within and not inside:
        yield Problem(_("The assignment must be between participants, because all factors are."))
    if not is_within:
        return
    most = MOST_PERMUTED if study.allocation.order == "all" else MOST_ORDERED
    for keys in conditions_together(study):
        if len(keys) > most:
            words = _("%(n)d conditions for each participant; at most %(most)d can be ordered.")
            yield Problem(words, {"n": len(keys), "most": most})
    # A participant does every level of a within factor: those conditions need the same access.
    cells = Counter(_between_cell(study, one) for one in study.conditions)
    accesses = {(_between_cell(study, one), one.access) for one in study.conditions}
    if inside and len(accesses) > len(cells):
        words = _(
            "The assignment gives a participant every level of a within factor: all conditions of "
            "one participant must have the same access (open, or by invitation)."
        )
        yield Problem(words)


def _between_cell(study: StudyDefinition, condition: Condition) -> tuple[str, ...]:
    apart = (factor.key for factor in study.factors if factor.design == "between")
    return tuple(condition.levels.get(key, "") for key in apart)
