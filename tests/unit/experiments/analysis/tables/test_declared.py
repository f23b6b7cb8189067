"""The analyses that a study declared are in its report: what was planted is found there, by the
test that was declared.
"""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy import stats

from experiments.analysis.documents.latex import as_latex
from experiments.analysis.tables.declared import declared
from experiments.dataset.records import (
    Dataset,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped
from experiments.participation.assignment import cells
from tests.support.analysis.study_dataset import questionnaires
from tests.support.analysis.tables import measured, rows, value

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


def drives_of(study, people, value, answer=None, ages=None):
    """A dataset in which everybody drives the conditions of a cell, and its sessions measured:
    `value` is a task time or all metrics that are known. A drive is completed unless it says not.
    """
    offered = cells(study)
    participants, drives, responses = [], [], []
    for number in range(people):
        cell = offered[number % len(offered)]
        who = f"P{number:02d}"
        age = math.nan if ages is None else ages[number]
        participants.append(ParticipantRecord(who, cell=cell.key, age=age))
        for place, key in enumerate(cell.conditions):
            known = value(number, study.condition(key).levels, place)
            known = known if isinstance(known, dict) else {"task_time": known}
            values = {"completed": 1.0} | known
            outcome = "completed" if values["completed"] else "timed_out"
            about = {"condition": key, "number": place + 1, "outcome": outcome}
            one = SessionRecord(f"{who}-{key}", who, "giraff", **about)
            drives.append(measured(one, **values))
            if answer is not None:
                given = {"q2": answer(number, study.condition(key).levels)}
                asked = ResponseRecord(f"{one.id}-q", "experience", who, given, session=one.id)
                responses.append(asked)
    dataset = Dataset(
        study,
        participants=tuple(participants),
        sessions=tuple(drive.session for drive in drives),
        responses=tuple(responses),
        questionnaires=questionnaires("experience"),
    )
    return dataset, drives


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
    dataset, drives = drives_of(study, 16, lambda n, levels, place: at(n, levels))
    (table,) = declared(dataset, drives)
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
    dataset, drives = drives_of(study, 20, lambda n, levels, place: rng.normal())
    (table,) = declared(dataset, drives)
    assert rows(table, "Test", "n tested") == [("Welch t", "20")]


def test_likert_items_are_tested_by_ranks_and_all_pairs_are_one_family():
    rng = np.random.default_rng(3)
    study = study_of(
        {"key": "said", "measures": ["experience.q2"], "test": "ranks", "post_hoc": True}
    )
    answer = lambda n, levels: int(rng.integers(-2, 1)) + 2 * (levels["help"] == ASSISTED)
    dataset, drives = drives_of(study, 24, lambda *_: 1.0, answer)
    (table,) = declared(dataset, drives)
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
    model = {"key": "model", "measures": ["task_time"], "test": "mixed", "coding": "sum"}
    model |= {"effects": ["delay", "help", "delay:help", "period", "order"]}

    def time(number, levels, place):
        effect = 15.0 * (levels["delay"] == "long") - 5.0 * place
        return 200.0 + own[number] + effect + rng.normal(0.0, 6.0)

    dataset, drives = drives_of(study_of(model), 32, time)
    table, coefficients = declared(dataset, drives)
    found = {row[1].text: row[table.head.index("p (Holm)")].value for row in table.rows}
    assert list(found) == ["delay", "help", "delay:help", "period", "order"]
    assert {name for name, p in found.items() if p < 0.05} == {"delay", "period"}
    assert value(table, 0, "Participants") == 32
    assert value(table, 0, "Observations") == 128
    found = {row[1].text: row[2].value for row in coefficients.rows}
    assert value(table, 0, "Difference") == pytest.approx(2.0 * found["delay none"])
    assert found["delay none"] == pytest.approx(-7.5, abs=1.5)
    assert found["SD participants"] == pytest.approx(20.0, rel=0.3)
    assert 0.8 < found["ICC"] < 1.0


def test_remarks_explain_models_that_cannot_be_fitted_and_unknown_measures():
    model = {"key": "model", "measures": ["task_time", "task_tim"]}
    model |= {"test": "mixed", "effects": ["delay"]}
    means = {"key": "means", "measures": ["task_tim"], "contrasts": [CONTRAST]}
    dataset, drives = drives_of(study_of(model, means), 2, lambda *_: 1.0)
    table, _, compared = declared(dataset, drives)
    assert rows(table, "Remark") == [("fewer than three participants",), ("no such measure",)]
    assert rows(compared, "Remark") == [("no such measure",)]


def test_the_papers_study_compares_doors_within_a_robot():
    rng = np.random.default_rng(5)
    dataset, drives = drives_of(PAPER, 30, lambda *_: rng.normal(300.0, 30.0))
    tables = {one.name: one for one in declared(dataset, drives)}
    table = tables["analysis-doors-driving"]
    tests = rows(table, "Measure", "Contrast", "Test", "n tested")
    task_time = [row for row in tests if row[0] == "task_time"]
    assert task_time[:2] == [
        ("task_time", "Giraff: laboratory door closed − all doors open", "Welch t", "20"),
        ("task_time", "Giraff: living room door closed − all doors open", "Welch t", "20"),
    ]
    assert all(row[2:] == ("–", "0") for row in task_time[2:])  # no invitations to Rhodon
    for one in PAPER.analyses:
        for contrast in one.contrasts:
            robots = {PAPER.condition(key).robot for key in (*contrast.first, *contrast.second)}
            assert len(robots) == 1


def crossing(coding="treatment", **more):
    model = {"key": "model", "measures": ["task_time"], "test": "mixed"}
    effects = ["delay", "help", "delay:help"]
    return study_of({**model, "effects": effects, "coding": coding, **more})


def test_a_main_effect_averages_over_the_other_factor_with_any_printed_coding():
    """A pure interaction: delay takes 10 s more alone, and 10 s less with help."""
    rng = np.random.default_rng(6)
    noise = rng.normal(0.0, 3.0, (20, 4))
    keys = [one.key for one in study_of().conditions]

    def time(number, levels, _place):
        at = keys.index(f"{levels['delay']}_{levels['help']}")
        return 100.0 + noise[number, at] + (10.0, -10.0, -10.0, 10.0)[at]

    codings = ("treatment", "sum")
    found = {coding: declared(*drives_of(crossing(coding), 20, time)) for coding in codings}
    none, long = noise[:, :2].mean(axis=1), noise[:, 2:].mean(axis=1)  # the planted effects cancel
    for table, _ in found.values():
        assert value(table, 0, "p") == pytest.approx(stats.ttest_rel(none, long).pvalue)
        assert value(table, 0, "Difference") == pytest.approx((none - long).mean())
        assert value(table, 2, "p") < 0.001
        assert value(table, 2, "Difference") is None
    coefficients = {
        coding: {row[1].text: row[2].value for row in table.rows}
        for coding, (_, table) in found.items()
    }
    assert coefficients["treatment"]["delay long"] == pytest.approx(-20.0, abs=4.0)
    assert coefficients["sum"]["delay none"] == pytest.approx(0.0, abs=2.0)


def test_covariates_are_in_the_model_and_in_no_family():
    rng = np.random.default_rng(7)
    ages = [*rng.integers(20, 60, 23).astype(float), math.nan]
    study = crossing(effects=["delay"], covariates=["age"])

    def time(number, levels, _place):
        age = ages[number] if number < 23 else 40.0
        return 3.0 * age + 5.0 * (levels["delay"] == "long") + rng.normal()

    dataset, drives = drives_of(study, 24, time, ages=ages)
    table, coefficients = declared(dataset, drives)
    assert rows(table, "Effect", "Participants", "Remark") == [
        ("delay", "23", "participants without a covariate: 1"),
        ("age", "23", "participants without a covariate: 1"),
    ]
    assert value(table, 0, "p (Holm)") == value(table, 0, "p")
    assert value(table, 1, "p (Holm)") is None
    slope = next(row for row in coefficients.rows if row[1].text == "age")
    assert slope[2].value == pytest.approx(3.0, abs=0.2)


def test_an_answer_of_the_registration_is_a_covariate_with_its_levels():
    rng = np.random.default_rng(8)
    study = crossing(effects=["delay"], covariates=["ict.gender", "ict.games"])
    time = lambda n, levels, _: 100.0 + 50.0 * (n % 2) + rng.normal(0.0, 1.0)
    dataset, drives = drives_of(study, 20, time)
    given = [{"gender": ("woman", "man")[n % 2], "games": n % 5} for n in range(20)]
    registered = tuple(
        ResponseRecord(f"r{n}", "ict", f"P{n:02d}", values) for n, values in enumerate(given)
    )
    dataset = replace(dataset, responses=registered, questionnaires=questionnaires("ict"))
    table, coefficients = declared(dataset, drives)
    assert rows(table, "Effect", "df") == [("delay", "1"), ("ict.gender", "1"), ("ict.games", "1")]
    assert value(table, 1, "p") < 0.001
    found = {row[1].text: row[2].value for row in coefficients.rows}
    assert found["ict.gender man"] == pytest.approx(50.0, abs=2.0)
    assert found["ict.games"] == pytest.approx(0.0, abs=1.0)


def test_between_participants_a_model_has_covariates_as_well():
    rng = np.random.default_rng(9)
    ages = rng.integers(20, 60, 40).astype(float)
    model = {"key": "model", "measures": ["task_time"], "test": "mixed", "effects": ["delay"]}
    study = study_of({**model, "covariates": ["age"]}, between=("delay", "help"))
    time = lambda n, levels, _: ages[n] + 6.0 * (levels["delay"] == "long") + rng.normal()
    dataset, drives = drives_of(study, 40, time, ages=list(ages))
    table, _ = declared(dataset, drives)
    assert value(table, 0, "Observations") == 40
    assert value(table, 0, "Difference") == pytest.approx(-6.0, abs=1.0)
    assert value(table, 0, "p") < 0.001


def outcome(completed, seconds, stops=3.0):
    found = {"completed": float(completed), "total_time": seconds, "seen": 1.0, "stops": stops}
    return found | ({"task_time": seconds} if completed else {})


def test_an_answer_given_once_is_one_value_of_a_participant_for_their_group():
    model = {"key": "said", "measures": ["experience.q2"], "test": "mixed", "effects": ["delay"]}
    sides = {"key": "sides", "measures": ["experience.q2"], "contrasts": [CONTRAST]}
    study = study_of(model, sides, between=("delay",))
    once = [msgspec.structs.replace(it, repeat=it.key != "experience") for it in study.steps]
    study = msgspec.structs.replace(study, steps=tuple(once))
    dataset, drives = drives_of(study, 20, lambda *_: 1.0)
    rng = np.random.default_rng(8)
    given = {one.id: int(rng.integers(-2, 3)) for one in dataset.participants}
    once = tuple(
        ResponseRecord(f"r{who}", "experience", who, {"q2": n}) for who, n in given.items()
    )
    found, _, contrast = declared(replace(dataset, responses=once), drives)
    assert rows(found, "Participants", "Observations") == [("20", "20")]
    groups = [
        [given[one.id] for one in dataset.participants if one.cell.startswith(name)]
        for name in ("long", "none")
    ]
    assert value(contrast, 0, "p") == pytest.approx(
        stats.ttest_ind(*groups, equal_var=False).pvalue
    )


def test_success_is_a_proportion_that_is_tested_between_and_within():
    plain = {"measures": ["completed"], "test": "proportions"}
    pair = {"title": {"en": "a"}, "first": ["long_alone"], "second": ["none_alone"]}
    study = study_of({"key": "one", "contrasts": [pair], **plain}, {"key": "all", **plain})
    succeeds = lambda n, levels, _: outcome(levels["delay"] == "none" or n % 2 == 0, 100.0)
    one, every = declared(*drives_of(study, 24, succeeds))
    assert rows(one, "Test", "n tested", "first: mean", "second: mean") == [
        ("McNemar mid-p", "24", "0.500", "1.000")
    ]
    assert value(one, 0, "Difference") == pytest.approx(-0.5)
    assert rows(every, "Contrast", "Test") == [("all", "Cochran Q")]
    between = study_of({"key": "one", "contrasts": [pair], **plain}, between=("delay", "help"))
    (table,) = declared(*drives_of(between, 40, succeeds))
    assert rows(table, "Test", "n tested") == [("N−1 χ²", "20")]


def test_success_in_sets_of_conditions_is_a_logistic_regression_by_participants():
    study = study_of(
        {"key": "d", "measures": ["completed"], "test": "proportions", "contrasts": [CONTRAST]}
    )
    rng = np.random.default_rng(10)
    chance = {"none": 0.9, "long": 0.5}
    drive = lambda n, levels, _: outcome(rng.random() < chance[levels["delay"]], 100.0)
    (table,) = declared(*drives_of(study, 30, drive))
    assert rows(table, "Test", "Effect", "n tested") == [("score F (logistic)", "odds ratio", "30")]
    assert value(table, 0, "Size") < 1.0
    assert value(table, 0, "p") < 0.05


def test_times_that_never_came_are_censored():
    study = study_of(
        {"key": "d", "measures": ["task_time"], "test": "times", "contrasts": [CONTRAST]},
        between=("delay", "help"),
    )
    rng = np.random.default_rng(12)

    def drive(_number, levels, _place):
        seconds = rng.exponential(100.0 if levels["delay"] == "none" else 400.0)
        return outcome(seconds < 300.0, min(seconds, 300.0))

    (table,) = declared(*drives_of(study, 60, drive))
    assert rows(table, "Test", "Effect", "n tested") == [("log-rank χ²", "hazard ratio", "60")]
    assert value(table, 0, "p") < 0.01
    assert value(table, 0, "Size") > 1.0  # times of the first side are longer
    assert value(table, 0, "first: mean") is None
    assert value(table, 0, "second: median") == pytest.approx(70.0, abs=35.0)


def test_stops_of_a_session_that_was_cut_short_are_a_rate():
    study = study_of(
        {"key": "d", "measures": ["stops"], "test": "counts", "contrasts": [CONTRAST]},
        {"key": "m", "measures": ["stops"], "contrasts": [CONTRAST]},
    )

    def drive(number, levels, _place):
        more = number % 3 - 1.0
        if levels["delay"] == "long":  # cut short after one minute instead of five
            return outcome(completed=False, seconds=60.0, stops=2.0 + more)
        return outcome(completed=True, seconds=300.0, stops=10.0 + 3.0 * more)

    counts, means = declared(*drives_of(study, 24, drive))
    assert value(counts, 0, "Size") == pytest.approx(1.0)
    assert value(counts, 0, "p") > 0.05
    assert any("per minute" in note for note in counts.notes)
    assert value(means, 0, "first: mean") == pytest.approx(2.0)
    assert value(means, 0, "second: mean") == pytest.approx(2.0)
    assert any("per minute" in note for note in means.notes)


def test_a_model_of_counts_has_the_effects_of_its_factors():
    study = study_of(
        {"key": "c", "measures": ["stops"], "test": "counts", "effects": ["delay", "help"]}
    )
    rng = np.random.default_rng(14)
    stops = lambda levels: rng.poisson(8.0 if levels["delay"] == "long" else 4.0)
    drive = lambda n, levels, _: outcome(True, 120.0, stops(levels))
    table, coefficients = declared(*drives_of(study, 24, drive))
    score = "score F (Poisson)"
    assert rows(table, "Effect", "Test") == [("delay", score), ("help", score)]
    assert value(table, 0, "Difference") == pytest.approx(-math.log(2.0), abs=0.3)
    assert value(table, 0, "p (Holm)") < 0.001
    assert coefficients.rows[0][1].text == "(intercept)"


def test_remark_explains_a_test_that_does_not_fit_the_measure():
    study = study_of(
        {"key": "d", "measures": ["speed"], "test": "counts", "contrasts": [CONTRAST]},
        {"key": "m", "measures": ["stops"], "test": "times", "effects": ["delay"]},
    )
    contrast, model, _ = declared(*drives_of(study, 12, lambda *_: outcome(True, 100.0)))
    assert rows(contrast, "Remark") == [("not one of counts",)]
    assert rows(model, "Remark") == [("not one of times",)]


def test_a_study_without_declared_analyses_has_none_of_these_tables():
    assert declared(Dataset(shipped()["assistance"]), []) == ()
    assert DeclaredAnalysis(key="a", title={}).test == "means"


def test_its_notes_are_latex_that_needs_no_package():
    study = study_of({"key": "delay", "measures": ["task_time"], "contrasts": [CONTRAST]})
    (table,) = declared(Dataset(study), [])
    assert as_latex(table).isascii()
