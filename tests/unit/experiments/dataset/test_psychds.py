"""A dataset keeps to the rules of Psych-DS, whatever its questionnaires are called."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from experiments.dataset.code_book import description
from experiments.dataset.files import keyword_values, questionnaire_paths
from experiments.dataset.folder import read, write
from experiments.dataset.records import Dataset
from experiments.definition.publication import Author, PublicationDetails
from experiments.definition.shipped import shipped
from tests.support.analysis import psychds_rules
from tests.support.analysis.study_dataset import made_up
from tests.support.studies.questionnaires import defined, item

DETAILS = PublicationDetails(
    authors=(
        Author(
            name="Carberry, Josiah", orcid="0000-0002-1825-0097", affiliation="Brown University"
        ),
        Author(name="Núñez, Ana"),
    ),
    license="CC-BY-4.0",
    funder="Agencia Estatal de Investigación, PID2020-1",
    preregistration="https://osf.io/abcde",
    doi="10.5281/zenodo.1234567",
    keywords=("telepresence", "driving"),
    ethics="CEUMA 12-2026-H",
)


@pytest.fixture(scope="module")
def dataset():
    made = made_up(np.random.default_rng(3), 4)
    return replace(made, publication=DETAILS)


@pytest.fixture
def folder(dataset, tmp_path):
    write(dataset, tmp_path)
    return tmp_path


def test_a_dataset_breaks_no_rule_of_psych_ds(folder):
    assert psychds_rules.errors(folder) == []


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (lambda at: (at / "dataset_description.json").unlink(), "MISSING_DATASET_DESCRIPTION"),
        (lambda at: (at / "data" / "questionnaire-a-b_data.csv").write_text("id\n1\n"), "KEYWORD"),
        (lambda at: (at / "data" / "description-x_data.csv").write_text("unheard\n1\n"), "COLUMN"),
        (lambda at: (at / "data" / "description-x_data.csv").write_text("x,y\n1\n"), "LENGTH"),
    ],
)
def test_the_rules_find_what_is_broken(folder, spoil, code):
    spoil(folder)
    assert any(code in error for error in psychds_rules.errors(folder))


@pytest.mark.parametrize("slug", ["nasa-tlx", "2nd", "a-b_c", "año-último", "---", "質問"])
def test_a_questionnaire_of_any_name_has_a_valid_file_name(slug):
    (path,) = questionnaire_paths([slug]).values()
    assert psychds_rules.FILE.fullmatch(path.removeprefix("data/"))


@given(st.sets(st.text(max_size=12), max_size=8))
def test_file_names_of_different_questionnaires_differ(slugs):
    values = keyword_values(slugs)
    assert set(values) == slugs
    assert all(re.fullmatch(r"[a-zA-Z0-9]+", value) for value in values.values())
    assert len({value.casefold() for value in values.values()}) == len(slugs)


def test_names_that_would_be_the_same_differ_and_others_are_readable():
    values = keyword_values(["a-b", "aB", "ab", "nasa-tlx"])
    assert values["nasa-tlx"] == "nasaTlx"
    assert len({value.casefold() for value in values.values()}) == 4


def test_publication_details_are_written_in_words_of_schema_org_and_read(dataset, folder):
    book = json.loads((folder / "dataset_description.json").read_text())
    first = book["author"][0]
    assert first["@type"] == "Person"
    assert first["identifier"] == "https://orcid.org/0000-0002-1825-0097"
    assert first["affiliation"]["name"] == "Brown University"
    assert book["license"] == "https://spdx.org/licenses/CC-BY-4.0"
    assert book["identifier"] == "https://doi.org/10.5281/zenodo.1234567"
    assert read(folder).publication == DETAILS


def test_missing_publication_details_are_left_out_and_named(tmp_path):
    write(Dataset(shipped()["exploration"]), tmp_path)
    book = json.loads((tmp_path / "dataset_description.json").read_text())
    assert "author" not in book
    assert "license" not in book
    assert PublicationDetails(doi="10.5281/zenodo.1").missing == tuple(
        name for name in PublicationDetails.__struct_fields__ if name != "doi"
    )


def test_columns_have_their_levels_and_ranges():
    kinds = {"likert": "l", "slider": "s", "single": "o", "multiple": "m"}
    asked = (defined([item(kind, key) for kind, key in kinds.items()]),)
    book = description(Dataset(shipped()["exploration"], questionnaires=asked))
    described = {
        (one["description"].split(":")[0], one["name"]): one for one in book["variableMeasured"]
    }
    kind = described["participants", "kind"]
    assert [one["value"] for one in kind["valueReference"]] == ["participant", "pilot", "bot"]
    mode = {
        one["value"]: one["description"] for one in described["states", "mode"]["valueReference"]
    }
    assert mode["3"] == "docking"
    assert (
        described["states", "charge"]["minValue"],
        described["states", "charge"]["maxValue"],
    ) == (0, 1)
    own = {name: one for (table, name), one in described.items() if table == "test"}
    assert own["s"]["minValue"] < own["s"]["maxValue"]
    assert own["l"]["valueReference"]
    assert own["o"]["valueReference"]
    assert own["m"]["valueReference"]
    assert own["m"]["description"].endswith("; several words are separated by |")
    assert {one["value"] for one in own["l_missing"]["valueReference"]} >= {"skipped", "withheld"}


def test_every_number_of_a_dataset_is_in_the_range_of_its_column(dataset, folder):
    book = json.loads((folder / "dataset_description.json").read_text())
    bounds = {
        one["name"]: (one.get("minValue", -np.inf), one.get("maxValue", np.inf))
        for one in book["variableMeasured"]
        if one["description"].startswith("states:")
    }
    for session in dataset.sessions:
        states = dataset.states(session.id)
        for name in states.dtype.names:
            low, high = bounds[name]
            assert not ((states[name] < low) | (states[name] > high)).any(), name
