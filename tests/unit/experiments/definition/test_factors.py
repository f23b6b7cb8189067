"""Designs with factors: their cells are complete and distinct, and a participant gets the
conditions of one cell of the between factors.
"""

from collections import Counter
from itertools import pairwise, product

import msgspec
import pytest

from experiments.definition.factors import groups
from experiments.definition.problems import problems
from experiments.definition.schema import digest
from experiments.participation.assignment import cells
from surveys.document_forms.problem_text import sentences
from tests.support.studies.studies import STUDY, small_study

TASK = [{**STUDY["steps"][0], "repeat": True}, {**STUDY["steps"][1], "repeat": True}]


def factor(key, design, *levels):
    return {
        "key": key,
        "title": {"en": key},
        "design": design,
        "levels": [{"key": level, "title": {"en": level}} for level in levels],
    }


def crossed(*factors, order="balanced", access=lambda levels: "open", design=None):
    """A study with a condition for each cell of the factors."""
    names = [one["key"] for one in factors]
    conditions = [
        {
            **STUDY["conditions"][0],
            "key": "_".join(levels),
            "levels": dict(zip(names, levels, strict=True)),
            "access": access(levels),
        }
        for levels in product(*([level["key"] for level in one["levels"]] for one in factors))
    ]
    within = any(one["design"] == "within" for one in factors)
    return {
        **STUDY,
        "steps": TASK if within else STUDY["steps"],
        "factors": list(factors),
        "conditions": conditions,
        "allocation": {"design": design or ("within" if within else "between"), "order": order},
    }


def study_of(document):
    return small_study(**document)


DELAY = factor("delay", "within", "none", "some", "much")
HELPS = ("alone", "assisted")
HELP = factor("help", "between", *HELPS)


def test_within_a_participant_has_every_cell_in_a_latin_square_of_orders():
    study = study_of(crossed(DELAY, factor("help", "within", "alone", "assisted")))
    assert sentences(problems(study)) == []
    offered = cells(study)
    assert len(offered) == 6  # conditions, an even number: the square alone
    for place in range(6):
        assert len({cell.conditions[place] for cell in offered}) == 6
    following = Counter(pair for cell in offered for pair in pairwise(cell.conditions))
    assert set(following.values()) == {1}


def test_between_factors_alone_give_a_cell_a_condition():
    study = study_of(crossed({**DELAY, "design": "between"}, HELP))
    assert sentences(problems(study)) == []
    assert [cell.conditions for cell in cells(study)] == [(one.key,) for one in study.conditions]


def test_in_a_mixed_design_a_participant_keeps_one_level_of_the_between_factor():
    study = study_of(crossed(DELAY, HELP))
    assert sentences(problems(study)) == []
    offered = cells(study)
    assert len(offered) == 12  # for each kind of help three orders and their reverses
    for cell in offered:
        assert len({study.condition(key).levels["help"] for key in cell.conditions}) == 1
        assert {study.condition(key).levels["delay"] for key in cell.conditions} == {
            "none",
            "some",
            "much",
        }
    assert len({cell.key for cell in offered}) == 12


def test_without_factors_all_open_conditions_are_one_group():
    study = small_study()
    assert [[one.key for one in group] for group in groups(study, "open")] == [["all_open", "shut"]]


def test_a_study_without_factors_keeps_its_digest():
    document = msgspec.to_builtins(small_study())
    assert "factors" not in document
    assert digest(small_study(factors=[])) == digest(small_study())


def changed(document, n, **levels):
    conditions = list(document["conditions"])
    conditions[n] = {**conditions[n], "levels": {**conditions[n]["levels"], **levels}}
    return {**document, "conditions": conditions}


FULL = crossed(DELAY, HELP)
MISSING = (
    "No condition has delay much, help assisted; each cell of the factors needs exactly one"
    " condition."
)
DOUBLED = (
    "Condition much_assisted: it has the same levels as the condition much_alone; each cell of the"
    " factors needs exactly one condition."
)
APART = (
    "The assignment gives a participant every level of a within factor: all conditions of one"
    " participant must have the same access (open, or by invitation)."
)


@pytest.mark.parametrize(
    ("document", "told"),
    [
        (
            {**FULL, "conditions": FULL["conditions"][:-1]},
            [MISSING],
        ),
        (
            changed(FULL, 5, help="alone"),
            [
                DOUBLED,
                MISSING,
            ],
        ),
        (
            changed(FULL, 0, help="by_magic"),
            ["Condition none_alone: the factor help has no level by_magic."],
        ),
        (
            changed(FULL, 0, weather="rain"),
            ["Condition none_alone: there is no factor weather."],
        ),
        (
            crossed(DELAY, HELP, design="between"),
            ["The assignment must be within participants, because the factor delay is."],
        ),
        (
            crossed(
                DELAY, HELP, access=lambda levels: "invitation" if "none" in levels else "open"
            ),
            [APART],
        ),
        (
            crossed(factor("delay", "within", "a", "b", "c", "d", "e"), order="all"),
            ["5 conditions for each participant; at most 4 can be ordered."],
        ),
    ],
)
def test_missing_doubled_and_unknown_cells_are_problems(document, told):
    assert sentences(problems(study_of(document))) == told


def test_condition_without_a_level_and_factor_of_one_level_are_problems():
    one = crossed(factor("delay", "between", "none"))
    one["conditions"] = [*one["conditions"], {**STUDY["conditions"][1]}]
    assert sentences(problems(study_of(one))) == [
        "Factor delay: it needs at least 2 levels.",
        "Condition shut: choose its level of the factor delay.",
    ]


def test_invited_and_open_participants_may_have_levels_of_a_between_factor_each():
    study = study_of(
        crossed(DELAY, HELP, access=lambda levels: "invitation" if "alone" in levels else "open")
    )
    assert sentences(problems(study)) == []
    assert all("assisted" in key for cell in cells(study) for key in cell.conditions)
    assert all("alone" in key for cell in cells(study, "invitation") for key in cell.conditions)


def contrast(first, second):
    return {"title": {"en": "A contrast"}, "first": first, "second": second}


ALONE, ASSISTED = (tuple(f"{delay}_{one}" for delay in ("none", "some")) for one in HELPS)


@pytest.mark.parametrize(
    ("analysis", "is_refused"),
    [
        ({"test": "mixed", "effects": ["help"]}, False),
        ({"test": "mixed", "effects": ["help", "delay"]}, True),
        ({"contrasts": [contrast(ALONE, ASSISTED)]}, False),
        ({"contrasts": [contrast(ALONE[:1], ALONE[1:])]}, True),
        ({}, True),
    ],
)
def test_what_is_asked_once_is_compared_between_groups_alone(analysis, is_refused):
    document = crossed(factor("delay", "within", "none", "some"), HELP)
    one = {"key": "a", "title": {"en": "A"}, "measures": ["experience.q1"], **analysis}
    document |= {"steps": [TASK[0], STUDY["steps"][1]], "analyses": [one]}
    found = [one for one in sentences(problems(study_of(document))) if "only once" in one]
    assert bool(found) is is_refused
