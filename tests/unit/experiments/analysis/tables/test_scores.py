"""Every scored questionnaire has its tables and its figure: raw TLX, SUS, and one of a researcher's
own with reverse-coded items, in a study with two conditions and two robots.
"""

import functools
from itertools import product

import msgspec
import numpy as np
import pytest
from scipy import stats

from experiments.analysis.documents.latex import as_latex
from experiments.analysis.figures.drawing import as_svg
from experiments.analysis.metrics.sessions import measure_all
from experiments.analysis.report import report
from experiments.analysis.statistics.internal_consistency import cronbach, mcdonald
from experiments.analysis.tables.measures import StudyMeasures
from experiments.analysis.tables.paper_tables import table_4, table_5
from experiments.analysis.tables.scale_reliability import reliability_table
from experiments.analysis.tables.scores import score_tables
from experiments.dataset.records import (
    Dataset,
    ResponseRecord,
    RobotRecord,
    SessionRecord,
)
from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped
from experiments.research.analysis_topics import topic_of
from tests.support.analysis.study_dataset import questionnaires
from tests.support.analysis.tables import cells, row_of, rows, value
from tests.support.studies.questionnaires import defined, item

PEOPLE = 24
ROBOTS = tuple(
    RobotRecord(name=name, title=name.title(), series=name) for name in ("giraff", "rhodon")
)
FIVE = [{"value": n, "label": {"en": f"{n}"}} for n in range(1, 6)]
ITEMS = ("kind", "rude", "nice", "alive", "still", "quick")
REVERSED = ("rude", "still")


def impression(scoring="topics"):
    """A questionnaire like Godspeed: two scales of three items, one of each reversed."""
    items = [item("likert", key, **({"reverse": True} if key in REVERSED else {})) for key in ITEMS]
    topics = [
        {"key": "liking", "text": {"en": "Likeability"}, "items": list(ITEMS[:3])},
        {"key": "animacy", "text": {"en": "Animacy"}, "items": list(ITEMS[3:])},
    ]
    more = {"slug": "impression", "scales": {"agree": FIVE}, "scoring": scoring}
    return defined(items, topics=topics, **more)


def study_of(design="within"):
    """A study that asks all of them after each drive, with and without assistance."""
    whole = msgspec.to_builtins(shipped()["assistance"])
    asked = [step for step in whole["steps"] if step.get("questionnaire") == "tlx"]
    whole["steps"] = [
        {**asked[0], "key": slug, "questionnaire": slug} for slug in ("tlx", "sus", "impression")
    ]
    whole["allocation"] = {"design": design}
    whole["analysis"] = {"statements": "impression"}
    return msgspec.convert(whole, StudyDefinition)


def answers(rng, better):
    """What one person answers after one drive."""
    own = rng.normal(better, 1.0)
    point = lambda sign: int(np.clip(round(3.0 + sign * own + rng.normal(0.0, 0.7)), 1, 5))
    return {
        "tlx": {
            key: int(np.clip(50 - 15 * own + rng.normal(0, 10), 0, 100) // 5 * 5)
            for key in ("mental", "physical", "temporal", "performance", "effort", "frustration")
        },
        "sus": {f"sus{n}": point(1 if n % 2 else -1) for n in range(1, 11)},
        "impression": {key: point(-1 if key in REVERSED else 1) for key in ITEMS},
    }


def dataset_of(study, *, robots=("giraff", "giraff"), questionnaire=None, hidden=None):
    """Everybody drives both conditions, each on its robot, or one of them between participants;
    `hidden` is an item that is not asked after the second.
    """
    rng = np.random.default_rng(7)
    sessions, responses = [], []
    keys = [one.key for one in study.conditions]
    for number in range(PEOPLE):
        own = keys if study.allocation.design == "within" else [keys[number % 2]]
        for key in own:
            place = keys.index(key)
            robot = robots[place] if isinstance(robots[place], str) else robots[place][number % 2]
            about = {"condition": key, "number": place + 1, "outcome": "completed"}
            one = SessionRecord(f"{number}-{key}", f"P{number:02d}", robot, **about)
            sessions.append(one)
            for slug, values in answers(rng, 0.8 * place).items():
                asked = {"session": one.id, "missing": {}}
                if place and hidden in values:
                    del values[hidden]
                    asked["missing"] = {hidden: "not_asked"}
                name = f"{one.id}-{slug}"
                responses.append(ResponseRecord(name, slug, one.participant, values, **asked))
    return Dataset(
        study,
        robots=ROBOTS,
        sessions=tuple(sessions),
        responses=tuple(responses),
        questionnaires=(*questionnaires("tlx", "sus"), questionnaire or impression()),
    )


@functools.cache
def printed():
    dataset = dataset_of(study_of())
    measured = {one.session.id: one for one in measure_all(dataset)}
    found = report(dataset, measured, dataset)
    return dataset, {table.name: table for table in found.tables}, found.figures


def tables_of(dataset):
    return {table.name: table for table in (*score_tables(dataset), reliability_table(dataset))}


def sus_scores(dataset, key):
    """The SUS of each participant after a condition, by the words of its author."""
    return [
        2.5 * sum(v - 1 if n % 2 else 5 - v for n, v in enumerate(one.values.values(), start=1))
        for one in dataset.responses
        if one.questionnaire == "sus" and one.session.endswith(f"-{key}")
    ]


@pytest.mark.slow
def test_the_report_has_tables_and_a_figure_for_every_scored_questionnaire():
    _, tables, figures = printed()
    wanted = {f"{kind}-{slug}" for kind in ("scores", "score-tests") for slug in ("tlx", "sus")}
    assert {*wanted, "scores-impression", "score-tests-impression", "reliability"} <= set(tables)
    drawn = [one.name for one in figures if one.name.startswith("figure-scores-")]
    assert drawn == ["figure-scores-tlx", "figure-scores-sus", "figure-scores-impression"]
    for name in (*wanted, "reliability", *drawn):
        assert topic_of(name).key == "questionnaires"
    for name in ("scores-tlx", "score-tests-sus", "reliability"):
        assert as_latex(tables[name]).isascii()


def test_scores_are_those_of_the_rule_by_condition():
    dataset, tables, _ = printed()
    for key in ("alone", "assisted"):
        found = row_of(tables["scores-sus"], Condition=key)
        given = sus_scores(dataset, key)
        assert found["Scale"].text == "SUS"
        assert found["n"].value == PEOPLE
        assert found["Mean"].value == pytest.approx(np.mean(given))
        assert found["SD"].value == pytest.approx(np.std(given, ddof=1))
        assert found["Median"].value == np.median(given)
        slack = stats.t.ppf(0.975, PEOPLE - 1) * np.std(given, ddof=1) / np.sqrt(PEOPLE)
        assert found["CI95: from"].value == pytest.approx(np.mean(given) - slack)
        assert (found["Least"].value, found["Greatest"].value) == (0.0, 100.0)
        assert len(found["Mean"].sessions) == PEOPLE
    scales = dict.fromkeys(label for (label,) in rows(tables["scores-tlx"], "Scale"))
    demands = [f"{one} demand" for one in ("Mental", "Physical", "Temporal")]
    expected = ["Raw TLX", *demands, "Performance", "Effort", "Frustration"]
    assert [label.split(":")[0] for label in scales] == expected


def test_within_participants_scores_are_compared_by_pairs_in_one_family():
    dataset, tables, _ = printed()
    table = tables["score-tests-sus"]
    expected = stats.ttest_rel(sus_scores(dataset, "alone"), sus_scores(dataset, "assisted"))
    assert rows(table, "Test") == [("paired t",)]
    assert value(table, 0, "p") == pytest.approx(expected.pvalue)


def test_each_topic_is_a_scale_and_its_reversed_items_count_from_the_other_end():
    dataset, tables, _ = printed()
    table = tables["scores-impression"]
    scales = product(("Likeability", "Animacy"), ("alone", "assisted"))
    assert rows(table, "Scale", "Condition") == list(scales)
    found = row_of(table, Scale="Likeability", Condition="alone")
    assert found["Mean"].value == pytest.approx(liking_alone(dataset).mean())
    notes = " ".join(table.notes)
    assert "Reverse-coded, and counted from the other end: rude, still." in notes
    assert "no score pools them" in notes


def liking_alone(dataset):
    """The items of likeability, coded, after the first drive: (participants, items)."""
    answers = [
        one.values
        for one in dataset.responses
        if one.questionnaire == "impression" and one.session.endswith("-alone")
    ]
    return np.array([(one["kind"], 6 - one["rude"], one["nice"]) for one in answers], np.float64)


def test_reliability_is_that_of_the_coded_items_in_each_condition():
    dataset, tables, _ = printed()
    table = tables["reliability"]
    found = row_of(table, Questionnaire="impression", Scale="Likeability", Condition="alone")
    items = liking_alone(dataset)
    assert found["α"].value == pytest.approx(cronbach(items).value)
    assert found["α"].value > 0.6
    assert found["ω"].value == pytest.approx(mcdonald(items)[0].value)
    assert found["n"].value == PEOPLE
    assert rows(table, "Questionnaire", "Scale", "Items")[::2] == [
        ("tlx", "Raw TLX", "6"),
        ("sus", "SUS", "10"),
        ("impression", "Likeability", "3"),
        ("impression", "Animacy", "3"),
    ]


def test_an_item_that_should_have_been_reversed_is_named():
    forgotten = msgspec.to_builtins(impression())
    for one in forgotten["pages"][0]["items"]:
        one.pop("reverse", None)
    dataset = dataset_of(study_of(), questionnaire=msgspec.convert(forgotten, type(impression())))
    table = tables_of(dataset)["reliability"]
    found = row_of(table, Questionnaire="impression", Scale="Likeability", Condition="alone")
    assert "rude correlates −" in found["Remark"].text
    assert found["α"].value < 0.5


def test_robots_have_rows_of_their_own_and_notes_name_pooled_robots():
    dataset = dataset_of(study_of(), robots=("giraff", ("giraff", "rhodon")))
    tables = tables_of(dataset)
    assert rows(tables["scores-sus"], "Condition", "Robot", "n") == [
        ("alone", "giraff", "24"),
        ("assisted", "giraff", "12"),
        ("assisted", "rhodon", "12"),
    ]
    notes = " ".join(tables["score-tests-sus"].notes)
    assert "With assistance pools the robots giraff, rhodon." in notes
    assert "Conditions use different robots" in notes
    between = dataset_of(study_of("between"))
    table = tables_of(between)["reliability"]
    assert ("sus", "all", "24") in rows(table, "Questionnaire", "Condition", "n")
    assert "all: participants of all conditions and robots, pooled." in table.notes


def test_scores_of_different_items_are_not_compared():
    dataset = dataset_of(study_of(), hidden="nice")
    tables = tables_of(dataset)
    only = "nice only in Without assistance (giraff)"
    remarks = rows(tables["score-tests-impression"], "Remark")
    assert remarks == [(f"not the same items: {only}",), ("",)]
    notes = " ".join(tables["scores-impression"].notes)
    assert f"Likeability is not of the same items in all rows: {only}." in notes
    found = row_of(tables["reliability"], Scale="Likeability", Condition="assisted")
    assert found["Items"].value == 2
    assert found["Remark"].text == "without nice, not asked; no ω: fewer than three items"


def test_a_figure_has_a_panel_for_each_scale_with_the_means_of_the_table():
    _, tables, figures = printed()
    (figure,) = (one for one in figures if one.name == "figure-scores-impression")
    assert [axes.get_title("left") for axes in figure.figure.axes] == ["Likeability", "Animacy"]
    svg = as_svg(figure).decode()
    assert all(f'id="{gid}"' in svg for gid in figure.behind)
    means = product(("animacy", "liking"), ("alone", "assisted"))
    assert sorted(figure.behind) == [f"mean-{scale}-{key}-giraff" for scale, key in means]
    lines = {line.get_gid(): line for line in figure.figure.axes[0].lines}
    wanted = row_of(tables["scores-impression"], Scale="Likeability", Condition="alone")["Mean"]
    assert lines["mean-liking-alone-giraff"].get_xdata()[0] == wanted.value


def test_table_5_counts_reversed_statements_from_the_other_end_with_a_note():
    dataset = dataset_of(study_of(), questionnaire=impression("likert"))
    table = table_5(dataset)
    labels = [label for (label,) in rows(table, "")]
    assert labels[0] == "Overall"
    assert "RUDE (reversed)" in labels
    assert "KIND" in labels
    assert any(note.startswith("reversed: answers are counted") for note in table.notes)
    given = [6 - one.values["rude"] for one in dataset.responses if "rude" in one.values]
    first = given[::2]  # the first response of a participant counts
    found = cells(table, table.rows[labels.index("RUDE (reversed)")])
    assert found["Mean"].value == pytest.approx(np.mean(first))
    assert ("RUDE (reversed)",) in rows(table_4(dataset), "")
    assert "score-tests-impression" not in tables_of(dataset)  # the table `answers` has these tests


def test_a_declared_analysis_measures_the_score_and_no_whole_that_is_not_one_scale():
    dataset, _, _ = printed()
    data = StudyMeasures(dataset, [])
    values = data.means("sus.overall", "alone").values
    assert sorted(values.values()) == sorted(sus_scores(dataset, "alone"))
    assert data.unknown("means", "tlx.overall") == ""
    assert data.unknown("means", "impression.liking") == ""
    assert data.unknown("means", "impression.overall") == "no such measure"
    reversed_ = data.means("impression.rude", "alone").values
    raw = {one.participant: one.values["rude"] for one in dataset.responses[2::6]}
    assert reversed_ == {who: 6 - value for who, value in raw.items()}
