"""The code book explains every column: scores by their definitions, words by the enumerations in
the code, times by clock, event and unit.
"""

from typing import get_args

import pytest

from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.milestones import ENDED, STARTED
from experiments.dataset.code_book import description
from experiments.dataset.levels import END_REASONS, WITHHELD, Kind, explained
from experiments.dataset.records import Dataset
from experiments.definition.conditions import ASPECTS
from experiments.definition.design import ControlWay
from experiments.definition.schema import Outcome
from experiments.definition.shipped import shipped
from robots.api import docked, messages
from sessions.devices import SYSTEMS
from sessions.leases.fault_side import Side
from surveys.answers import Missing
from surveys.questionnaires import shipped as instruments
from surveys.scoring import scales_of, scores
from tests.support.analysis.study_dataset import questionnaires


def entries(dataset):
    """The columns by table and name."""
    return {
        (table, one["name"]): one | {"description": meaning}
        for one in description(dataset)["variableMeasured"]
        for table, _, meaning in (one["description"].partition(": "),)
    }


@pytest.fixture(scope="module")
def book():
    asked = questionnaires("tlx", "sus", "godspeed", "experience", "ict")
    return entries(Dataset(shipped()["exploration"], questionnaires=asked))


# --- scores ---------------------------------------------------------------------------------------


def test_the_sus_is_told_with_formula_range_and_direction(book):
    told = book["sus", "sus"]
    assert (told["minValue"], told["maxValue"]) == (0.0, 100.0)
    assert told["description"] == (
        "score of: Using the system – 2.5 × the sum of (answer − 1) of sus1, sus2, sus3, sus4,"
        " sus5, sus6, sus7, sus8, sus9, sus10; empty where one is missing; sus2, sus4, sus6, sus8,"
        " sus10 counted as 6 − answer; from 0 to 100; higher is nearer to “Strongly agree” in sus1,"
        " sus3, sus5, sus7, sus9; to “Strongly disagree” in sus2, sus4, sus6, sus8, sus10"
    )
    answers = [2, 4, 3, 1, 5, 2, 4, 4, 3, 1]
    turned = [6 - value if n % 2 else value for n, value in enumerate(answers)]
    given = {f"sus{n}": value for n, value in enumerate(answers, start=1)}
    assert scores(instruments()["sus"], given) == {"sus": 2.5 * sum(one - 1 for one in turned)}


def test_the_tlx_is_told_with_the_ends_of_its_items(book):
    told = book["tlx", "tlx_raw"]["description"]
    assert "mean of the answers to mental, physical, temporal, performance, effort, frustr" in told
    assert told.endswith(
        "without weights; empty where one is missing; from 0 to 100; higher is nearer to “Very"
        " high” in mental, physical, temporal, effort, frustration; to “Failure” in performance"
    )
    assert book["tlx", "performance"]["description"].endswith("(0: Perfect; 100: Failure)")


def test_every_score_of_every_shipped_scale_says_how_it_is_made(book):
    for definition in questionnaires("godspeed", "experience", "tlx", "sus"):
        for scale in scales_of(definition):
            told = book[definition.slug, scale.name]["description"]
            assert scale.formula in told
            assert f"from {scale.bounds[0]:g} to {scale.bounds[1]:g}; higher is nearer to" in told
    assert "likeability" in book["godspeed", "score_likeability"]["description"].lower()


# --- words ----------------------------------------------------------------------------------------


def levels(entry):
    return {one["value"]: one.get("description", "") for one in entry["valueReference"]}


@pytest.mark.parametrize(
    ("table", "name", "words"),
    [
        ("participants", "kind", get_args(Kind)),
        ("sessions", "kind", get_args(Kind)),
        ("sessions", "outcome", get_args(Outcome)),
        ("sessions", "assist", get_args(messages.AssistLevel)),
        ("sessions", "control_way", get_args(ControlWay)),
        ("sessions", "fault_side", [word for word in get_args(Side) if word]),
        ("sessions", "began_docked", ("0", "1")),
        ("sessions", "mismatch", ASPECTS),
        ("answers", "missing", (*Missing, WITHHELD)),
        ("states", "mode", ("0", "1", "2", "3", "4")),
        ("ict", "gender_missing", (*Missing, WITHHELD)),
    ],
)
def test_a_coded_column_lists_the_words_of_its_enumeration_with_what_each_means(
    book, table, name, words
):
    told = levels(book[table, name])
    assert list(told) == list(words)
    assert all(told.values())


def test_the_numbers_of_modes_are_those_of_the_robot_api(book):
    assert tuple(levels(book["states", "mode"]).values()) == get_args(messages.Mode)


def test_every_reason_is_explained_and_the_devices_are_those_that_are_told_apart(book):
    assert levels(book["sessions", "reason"]) == END_REASONS
    assert all(END_REASONS.values())
    assert set(levels(book["sessions", "os"])) == {*SYSTEMS, "other"}
    assert "other" in levels(book["sessions", "browser"])


def test_what_the_study_names_is_listed_with_its_titles(book):
    study = shipped()["exploration"]
    conditions = levels(book["sessions", "condition"])
    assert conditions == {one.key: one.title["en"] for one in study.conditions}
    assert list(levels(book["pages", "step"])) == [one.key for one in study.steps]
    assert levels(book["answers", "questionnaire"])["sus"] == "Using the system"


def test_a_column_whose_cells_hold_several_words_lists_each_and_what_divides_them(book):
    study = shipped()["exploration"]
    keys = [one.key for one in study.conditions]
    assert list(levels(book["participants", "cell"])) == keys
    assert set(levels(book["sessions", "doors_closed"])) == {
        door for one in study.conditions for door in one.doors_closed
    }
    for (table, name), divider in {
        ("participants", "cell"): "-",
        ("sessions", "doors_closed"): "|",
        ("sessions", "mismatch"): "|",
    }.items():
        told = book[table, name]["description"]
        assert told.endswith(f"; several words are separated by {divider}")


def test_a_word_without_a_meaning_is_an_error():
    with pytest.raises(KeyError, match="robot"):
        explained(("", "visitor", "robot"), {"visitor": "left"})


# --- times ----------------------------------------------------------------------------------------

CLOCKS = ("server's", "robot's clock", "page's clock")
# Times of a session that are an instant, or a duration between two that are named.
INSTANTS = [
    *(("sessions", name) for name in ("first_frame", "first_motion", "ended")),
    *(("states", name) for name in ("stamp", "received")),
    ("events", "stamp"),
    ("network", "stamp"),
]


def test_every_instant_names_its_clock_its_unit_and_where_it_counts_from(book):
    for place in INSTANTS:
        told = book[place]
        assert told["unitText"] == "s"
        assert "since the grant" in told["description"], place
        assert any(clock in told["description"] for clock in CLOCKS), place


def test_the_description_says_where_times_begin_and_the_metrics_between_which_events_they_are():
    about = description(Dataset(shipped()["exploration"]), {"metrics": METRICS})
    assert "count from the moment at which the server granted the robot" in about["description"]
    told = {one["name"]: one["description"] for one in about["variableMeasured"]}
    for name in ("total_time", "time_to_motion", "task_time", "docking_time"):
        assert told[name].endswith("by the server's clock")
    assert STARTED in told["task_time"]
    assert "its event docked" in told["task_time"]
    assert STARTED in told["total_time"]
    assert ENDED in told["total_time"]


def test_docked_is_told_with_the_seconds_of_its_rule(book):
    assert f"for {docked.DOCKED.seconds:g} s" in book["states", "docked"]["description"]
