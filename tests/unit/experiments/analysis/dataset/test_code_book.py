"""The code book explains every column: scores by their definitions, words by the enumerations in
the code, times by clock, event and unit.
"""

import pytest

from experiments.analysis.dataset.code_book import description
from experiments.analysis.dataset.records import Dataset
from experiments.definition.shipped import shipped
from surveys.scoring import scales_of, sus
from tests.support.study_dataset import questionnaires


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
    assert sus(answers) == 2.5 * sum(value - 1 for value in turned)


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
