"""The analyses that a study declared are in its report: what was planted is found there, by the
test that was declared.
"""

import math

import msgspec
import numpy as np
import pytest
from scipy import stats

from experiments.analysis.dataset.records import (
    Dataset,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from experiments.analysis.documents.latex import as_latex
from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.milestones import Milestones
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.tables.declared import declared
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped
from experiments.participation.assignment import cells
from tests.support.analysis.study_dataset import questionnaires

PAPER = shipped()["exploration"]
ALONE, ASSISTED = "alone", "assisted"


def factor(key, design, *levels):
    names = [{"key": level, "title": {"en": level, "es": level}} for level in levels]
    return {"key": key, "title": {"en": key, "es": key}, "design": design, "levels": names}


def study_of(*analyses, between=()):
    """A study of delay and help, both within participants, but for the factors in `between`."""
    whole = msgspec.to_builtins(shipped()["assistance"])
    first = whole["conditions"][0]
    whole["factors"] = [
        factor("delay", "between" if "delay" in between else "within", "none", "long"),
        factor("help", "between" if "help" in between else "within", ALONE, ASSISTED),
    ]
    whole["conditions"] = [
        {**first, "key": f"{delay}_{help_}", "levels": {"delay": delay, "help": help_}}
        for delay in ("none", "long")
        for help_ in (ALONE, ASSISTED)
    ]
    whole["allocation"] = {"design": "between" if len(between) == 2 else "within"}
    whole["analyses"] = [{"title": {"en": "Delay", "es": "Retraso"}, **one} for one in analyses]
    return msgspec.convert(whole, StudyDefinition)


def driven(study, people, value, answer=None):
    """A dataset in which everybody drives the conditions of a cell, and its sessions measured."""
    offered = cells(study)
    participants, sessions, measured, responses = [], [], [], []
    for number in range(people):
        cell = offered[number % len(offered)]
        who = f"P{number:02d}"
        participants.append(ParticipantRecord(who, cell=cell.key))
        for place, key in enumerate(cell.conditions):
            one = SessionRecord(f"{who}-{key}", who, "giraff", condition=key, number=place + 1)
            sessions.append(one)
            values = {column.name: math.nan for column in METRICS}
            values["task_time"] = value(number, study.condition(key).levels, place)
            measured.append(Measured(one, Milestones(), values, (), np.empty((0, 2))))
            if answer is not None:
                said = {"q2": answer(number, study.condition(key).levels)}
                responses.append(
                    ResponseRecord(f"{one.id}-q", "experience", who, said, session=one.id)
                )
    dataset = Dataset(
        study,
        participants=tuple(participants),
        sessions=tuple(sessions),
        responses=tuple(responses),
        questionnaires=questionnaires("experience"),
    )
    return dataset, measured


def rows(table, *heads):
    return [tuple(row[table.head.index(head)].text for head in heads) for row in table.rows]


def value(table, row, head):
    return table.rows[row][table.head.index(head)].value


CONTRAST = {
    "title": {"en": "long - none", "es": "largo - nada"},
    "first": ["long_alone", "long_assisted"],
    "second": ["none_alone", "none_assisted"],
}


def test_a_contrast_of_a_main_effect_is_a_paired_test_of_each_participants_means():
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 1.0, (16, 4))
    study = study_of({"key": "delay", "measures": ["task_time"], "contrasts": [CONTRAST]})
    keys = [one.key for one in study.conditions]
    at = lambda number, levels: noise[number, keys.index(f"{levels['delay']}_{levels['help']}")]
    dataset, measured = driven(study, 16, lambda n, levels, place: at(n, levels))
    (table,) = declared(dataset, measured)
    expected = stats.ttest_rel(noise[:, 2:].mean(axis=1), noise[:, :2].mean(axis=1))
    assert table.name == "analysis-delay"
    assert rows(table, "Measure", "Contrast", "Test") == [("task_time", "long - none", "paired t")]
    assert value(table, 0, "p") == pytest.approx(expected.pvalue)
    assert value(table, 0, "n tested") == 16


def test_between_participants_the_same_contrast_compares_groups():
    rng = np.random.default_rng(2)
    study = study_of(
        {"key": "delay", "measures": ["task_time"], "contrasts": [CONTRAST]}, between=("delay",)
    )
    dataset, measured = driven(study, 20, lambda n, levels, place: rng.normal())
    (table,) = declared(dataset, measured)
    assert rows(table, "Test", "n tested") == [("Welch t", "20")]


def test_likert_items_are_tested_by_ranks_and_all_pairs_are_one_family():
    rng = np.random.default_rng(3)
    study = study_of(
        {"key": "said", "measures": ["experience.q2"], "test": "ranks", "post_hoc": True}
    )
    answer = lambda n, levels: int(rng.integers(-2, 1)) + 2 * (levels["help"] == ASSISTED)
    dataset, measured = driven(study, 24, lambda *_: 1.0, answer)
    (table,) = declared(dataset, measured)
    assert rows(table, "Contrast", "Test")[0] == ("all", "Friedman χ²")
    tests = rows(table, "Test")[1:]
    assert tests == [("Wilcoxon signed rank",)] * 6
    assert value(table, 0, "p") < 0.001
    pairs = range(1, 7)
    least = min(value(table, row, "p") for row in pairs)
    assert min(value(table, row, "p (Holm)") for row in pairs) == pytest.approx(6 * least)


def test_a_mixed_model_finds_the_effect_that_was_planted_and_no_other():
    rng = np.random.default_rng(11)
    own = rng.normal(0.0, 20.0, 32)
    model = {
        "key": "model",
        "measures": ["task_time"],
        "test": "mixed",
        "effects": ["delay", "help", "delay:help", "period", "order"],
        "coding": "sum",
    }
    dataset, measured = driven(
        study_of(model),
        32,
        lambda n, levels, place: (
            200.0 + own[n] + 15.0 * (levels["delay"] == "long") - 5.0 * place + rng.normal(0.0, 6.0)
        ),
    )
    table, coefficients = declared(dataset, measured)
    found = {row[1].text: row[table.head.index("p (Holm)")].value for row in table.rows}
    assert list(found) == ["delay", "help", "delay:help", "period", "order"]
    assert {name for name, p in found.items() if p < 0.05} == {"delay", "period"}
    assert value(table, 0, "Participants") == 32
    assert value(table, 0, "Observations") == 128
    told = {row[1].text: row[2].value for row in coefficients.rows}
    (df,) = {row[7].value for row in coefficients.rows if row[1].text in ("(intercept)", "help no")}
    assert df == value(table, 1, "df 2")
    assert any(
        "The intercept itself has the larger of the two" in note for note in coefficients.notes
    )
    assert told["delay none"] == pytest.approx(-7.5, abs=1.5)
    assert told["SD participants"] == pytest.approx(20.0, rel=0.3)
    assert 0.8 < told["ICC"] < 1.0


def test_a_model_that_cannot_be_fitted_says_why_and_a_misspelt_measure_is_told():
    model = {
        "key": "model",
        "measures": ["task_time", "task_tim"],
        "test": "mixed",
        "effects": ["delay"],
    }
    means = {"key": "means", "measures": ["task_tim"], "contrasts": [CONTRAST]}
    dataset, measured = driven(study_of(model, means), 2, lambda *_: 1.0)
    table, _, compared = declared(dataset, measured)
    assert rows(table, "Remark") == [("fewer than three participants",), ("no such measure",)]
    assert rows(compared, "Remark") == [("no such measure",)]


def test_the_papers_study_compares_doors_within_a_robot():
    rng = np.random.default_rng(5)
    dataset, measured = driven(PAPER, 30, lambda *_: rng.normal(300.0, 30.0))
    tables = {one.name: one for one in declared(dataset, measured)}
    table = tables["analysis-doors-driving"]
    task_time = [
        row
        for row in rows(table, "Measure", "Contrast", "Test", "n tested")
        if row[0] == "task_time"
    ]
    assert task_time[:2] == [
        ("task_time", "Giraff: laboratory door closed − all doors open", "Welch t", "20"),
        ("task_time", "Giraff: living room door closed − all doors open", "Welch t", "20"),
    ]
    assert all(row[2:] == ("–", "0") for row in task_time[2:])  # nobody was invited to Rhodon
    for one in PAPER.analyses:
        for contrast in one.contrasts:
            robots = {PAPER.condition(key).robot for key in (*contrast.first, *contrast.second)}
            assert len(robots) == 1


def test_a_study_without_declared_analyses_has_none_of_these_tables():
    assert declared(Dataset(shipped()["assistance"]), []) == ()
    assert DeclaredAnalysis(key="a", title={}).test == "means"


def test_its_notes_are_latex_that_needs_no_package():
    study = study_of({"key": "delay", "measures": ["task_time"], "contrasts": [CONTRAST]})
    (table,) = declared(Dataset(study), [])
    assert as_latex(table).isascii()
