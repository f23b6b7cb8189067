"""Files of SPSS and Stata have the values, labels and missing values of a table."""

import numpy as np
import pandas as pd
import pyreadstat
import pytest

from experiments.dataset.columns import Column, amount_of, flag
from experiments.dataset.files import data_tables
from experiments.dataset.levels import MISSING
from experiments.export.formats.labelled import labelled, variable_names, written
from tests.support.analysis.study_dataset import made_up

ENDS = {"-2": "not at all", "2": "very well"}
LAYOUT = (
    Column("id", "", "code", is_text=True),
    Column("kind", "", "who took part", levels={"participant": "took part", "bot": "a program"}),
    amount_of("seconds", "s", "how long it took"),
    flag("finished", "1 when it was finished"),
    Column("q1", "", "I could drive well", least=-2, greatest=2, levels=ENDS),
    Column("q1_missing", "", "why there is no answer", levels=MISSING),
    Column("doors", "", "closed doors", levels={"lab": "", "hall": ""}, divider="|"),
    Column("r.a", "", "place of A"),
    Column("2nd", "", "ä" * 200),
)
ROWS = [
    ["P1", "participant", 1.5, True, 2, "", ("lab", "hall"), 1, "x"],
    ["P2", "bot", float("nan"), False, "", "skipped", (), 2, "ü"],
    ["1E5", "coder", 0.25, True, "", "not_asked", ("hall",), "", ""],
]


def read_back(ending, tmp_path, layout=LAYOUT, rows=ROWS, **options):
    path = tmp_path / f"table.{ending}"
    path.write_bytes(written(labelled(layout, rows), ending))
    read = pyreadstat.read_sav if ending == "sav" else pyreadstat.read_dta
    return read(path, **options)


@pytest.mark.parametrize("ending", ["sav", "dta"])
def test_values_and_labels_are_read_unchanged(ending, tmp_path):
    frame, about = read_back(ending, tmp_path)
    names = variable_names([column.name for column in LAYOUT], 32)
    assert list(frame) == names
    assert names[-2:] == ["r_a", "v_2nd"]
    assert frame["id"].tolist() == ["P1", "P2", "1E5"]
    assert frame["kind"].tolist() == [1, 2, 3]
    labels = about.variable_value_labels
    assert labels["kind"] == {1: "took part", 2: "a program", 3: "coder"}
    assert labels["finished"] == {0: "no", 1: "yes"}
    assert {value: labels["q1"][value] for value in (-2, 2)} == {-2: "not at all", 2: "very well"}
    np.testing.assert_array_equal(frame["seconds"], [1.5, np.nan, 0.25])
    assert frame["doors"].tolist() == ["lab|hall", "", "hall"]
    assert about.column_names_to_labels["seconds"] == "how long it took (s)"
    assert about.column_names_to_labels["v_2nd"].startswith("ää")


def test_reasons_for_no_answer_are_missing_values_of_spss(tmp_path):
    frame, about = read_back("sav", tmp_path)
    assert frame["q1"].isna().tolist() == [False, True, True]
    frame, about = read_back("sav", tmp_path, user_missing=True)
    (codes,) = about.missing_ranges["q1"]
    assert codes["lo"] <= frame["q1"][2] < frame["q1"][1] <= codes["hi"]
    labels = about.variable_value_labels["q1"]
    assert labels[frame["q1"][1]] == MISSING["skipped"]
    assert labels[frame["q1"][2]] == MISSING["not_asked"]
    measure = about.variable_measure
    assert [measure[name] for name in ("kind", "seconds", "q1")] == ["nominal", "scale", "ordinal"]


def test_reasons_for_no_answer_are_missing_values_of_stata(tmp_path):
    frame, _ = read_back("dta", tmp_path)
    assert frame["q1"].isna().tolist() == [False, True, True]
    frame, about = read_back("dta", tmp_path, user_missing=True)
    labels = about.variable_value_labels["q1"]
    given = frame["q1"].tolist()
    assert given[0] == 2
    assert [labels[one] for one in given[1:]] == [MISSING["skipped"], MISSING["not_asked"]]


@pytest.mark.parametrize("ending", ["sav", "dta"])
def test_same_table_gives_the_same_bytes_at_any_time(ending):
    table = labelled(LAYOUT, ROWS)
    first = written(table, ending)
    assert b"1980" in first or b"Jan 80" in first
    assert b"2026" not in first
    assert written(table, ending) == first


def test_names_are_valid_in_both_programs_and_differ():
    long = "a" * 40
    found = variable_names(["x.y", "x_y", "X_Y", long + "1", long + "2", "with", "_a", "ä"], 32)
    assert found == [
        *("x_y", "x_y_2", "X_Y_3"),
        *("a" * 32, "a" * 30 + "_2"),
        *("v_with", "v__a", "v__"),
    ]


@pytest.mark.parametrize("ending", ["sav", "dta"])
def test_tables_of_a_whole_dataset_are_read_unchanged(ending, tmp_path):
    dataset = made_up(np.random.default_rng(4), 6)
    for one in data_tables(dataset):
        if one.name in {"events", "answers"}:
            continue
        rows = list(one.rows)
        frame, about = read_back(ending, tmp_path, one.layout, rows)
        assert len(frame) == len(rows)
        assert all(about.column_labels)
        for column, name in zip(one.layout, frame, strict=True):
            given = [row[one.layout.index(column)] for row in rows]
            if not column.levels and all(isinstance(value, int | float) for value in given):
                np.testing.assert_array_equal(frame[name], pd.Series(given, dtype=float))


@pytest.mark.parametrize("ending", ["sav", "dta"])
def test_table_without_rows_has_its_variables(ending, tmp_path):
    frame, about = read_back(ending, tmp_path, rows=[])
    assert len(frame) == 0
    assert about.column_names_to_labels["kind"] == "who took part"
