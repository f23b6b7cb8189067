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


def test_code_book_has_formula_range_and_direction_of_the_sus(book):
    entry = book["sus", "sus"]
    assert (entry["minValue"], entry["maxValue"]) == (0.0, 100.0)
    assert entry["description"] == (
        "score of: Using the system – 2.5 × the sum of (answer − 1) of sus1, sus2, sus3, sus4,"
        " sus5, sus6, sus7, sus8, sus9, sus10; empty where one is missing; sus2, sus4, sus6, sus8,"
        " sus10 counted as 6 − answer; from 0 to 100; higher is nearer to “Strongly agree” in sus1,"
        " sus3, sus5, sus7, sus9; to “Strongly disagree” in sus2, sus4, sus6, sus8, sus10"
    )
    answers = [2, 4, 3, 1, 5, 2, 4, 4, 3, 1]
    turned = [6 - value if n % 2 else value for n, value in enumerate(answers)]
    given = {f"sus{n}": value for n, value in enumerate(answers, start=1)}
    assert scores(instruments()["sus"], given) == {"sus": 2.5 * sum(one - 1 for one in turned)}


def test_code_book_has_the_ends_of_the_items_of_the_tlx(book):
    entry = book["tlx", "tlx_raw"]["description"]
    assert "mean of the answers to mental, physical, temporal, performance, effort, frustr" in entry
    assert entry.endswith(
        "without weights; empty where one is missing; from 0 to 100; higher is nearer to “Very"
        " high” in mental, physical, temporal, effort, frustration; to “Failure” in performance"
    )
    assert book["tlx", "performance"]["description"].endswith("(0: Perfect; 100: Failure)")


def test_code_book_explains_every_score_of_every_shipped_scale(book):
    for definition in questionnaires("godspeed", "experience", "tlx", "sus"):
        for scale in scales_of(definition):
            entry = book[definition.slug, scale.name]["description"]
            assert scale.formula in entry
            assert f"from {scale.bounds[0]:g} to {scale.bounds[1]:g}; higher is nearer to" in entry
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
def test_coded_column_lists_the_meaning_of_each_word_of_its_enumeration(book, table, name, words):
    entry = levels(book[table, name])
    assert list(entry) == list(words)
    assert all(entry.values())


def test_the_numbers_of_modes_are_those_of_the_robot_api(book):
    assert tuple(levels(book["states", "mode"]).values()) == get_args(messages.Mode)


def test_code_book_explains_every_reason_and_lists_all_devices(book):
    assert levels(book["sessions", "reason"]) == END_REASONS
    assert all(END_REASONS.values())
    assert set(levels(book["sessions", "os"])) == {*SYSTEMS, "other"}
    assert "other" in levels(book["sessions", "browser"])


def test_levels_named_by_the_study_have_its_titles(book):
    study = shipped()["exploration"]
    conditions = levels(book["sessions", "condition"])
    assert conditions == {one.key: one.title["en"] for one in study.conditions}
    assert list(levels(book["pages", "step"])) == [one.key for one in study.steps]
    assert levels(book["answers", "questionnaire"])["sus"] == "Using the system"


def test_column_with_several_words_in_a_cell_lists_them_and_their_divider(book):
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
        entry = book[table, name]["description"]
        assert entry.endswith(f"; several words are separated by {divider}")


def test_a_word_without_a_meaning_is_an_error():
    with pytest.raises(KeyError, match="robot"):
        explained(("", "visitor", "robot"), visitor="left")


# --- times ----------------------------------------------------------------------------------------

CLOCKS = ("server's", "robot's clock", "page's clock")
# Times of a session that are an instant, or a duration between two that are named.
INSTANTS = [
    *(("sessions", name) for name in ("first_frame", "first_motion", "ended")),
    *(("states", name) for name in ("stamp", "received")),
    ("events", "stamp"),
    ("network", "stamp"),
]


def test_every_time_has_its_clock_its_unit_and_its_zero(book):
    for place in INSTANTS:
        entry = book[place]
        assert entry["unitText"] == "s"
        assert "since the grant" in entry["description"], place
        assert any(clock in entry["description"] for clock in CLOCKS), place


def test_description_defines_the_zero_of_times_and_the_ends_of_metrics():
    about = description(Dataset(shipped()["exploration"]), {"metrics": METRICS})
    assert "count from the moment at which the server granted the robot" in about["description"]
    entry = {one["name"]: one["description"] for one in about["variableMeasured"]}
    for name in ("total_time", "time_to_motion", "task_time", "docking_time"):
        assert entry[name].endswith("by the server's clock")
    assert STARTED in entry["task_time"]
    assert "its event docked" in entry["task_time"]
    assert STARTED in entry["total_time"]
    assert ENDED in entry["total_time"]


def test_code_book_has_the_seconds_of_the_rule_of_docking(book):
    assert f"for {docked.DOCKED.seconds:g} s" in book["states", "docked"]["description"]
