"""A dataset as a folder: it is read without a difference, and a broken file is named."""

import json
import math
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from experiments.dataset.columns import columns_of, matrix_of
from experiments.dataset.files import numbers
from experiments.dataset.folder import DatasetError, put, read, write
from experiments.dataset.records import (
    Dataset,
    EventRecord,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from experiments.dataset.states import STATES
from experiments.definition.shipped import shipped
from tests.support.analysis.study_dataset import made_up
from tests.support.studies.questionnaires import defined, item

STUDY = shipped()["exploration"]
SESSION = SessionRecord("s", "a", "giraff")
PEOPLE, EVENTS = (f"data/description-{name}_data.csv" for name in ("participants", "events"))
PEOPLE_HEAD = "id,kind,age,cell,reached,left,finished,withdrawn\n"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("written")
    write(made_up(np.random.default_rng(1), 5), folder)
    return folder


@pytest.fixture
def folder(written, tmp_path):
    return shutil.copytree(written, tmp_path, dirs_exist_ok=True)


def plain(record):
    return {
        name: None if isinstance(value, float) and math.isnan(value) else value
        for name, value in vars(record).items()
    }


def descriptions(folder):
    """The descriptions of the code book by the names of columns."""
    book = json.loads((folder / "dataset_description.json").read_text())
    return {entry["name"]: entry["description"] for entry in book["variableMeasured"]}


def test_a_dataset_that_was_written_and_read_is_the_same(tmp_path):
    dataset = made_up(np.random.default_rng(1), 13)
    write(dataset, tmp_path)
    again = read(tmp_path)
    for name in ("sessions", "participants", "pages"):
        assert [*map(plain, getattr(again, name))] == [*map(plain, getattr(dataset, name))]
    for name in ("events", "responses", "study", "robots", "questionnaires", "plans"):
        assert getattr(again, name) == getattr(dataset, name)
    for session in dataset.sessions:
        for name in ("states", "network"):
            one, other = (matrix_of(getattr(which, name)(session.id)) for which in (again, dataset))
            np.testing.assert_array_equal(one, other)


def test_writing_what_was_read_gives_the_same_bytes(folder, tmp_path_factory):
    second = tmp_path_factory.mktemp("second")
    write(read(folder), second)
    names = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    assert names == sorted(path.relative_to(second) for path in second.rglob("*") if path.is_file())
    assert all((folder / name).read_bytes() == (second / name).read_bytes() for name in names)


def test_every_column_of_every_file_is_in_the_code_book(folder):
    book = json.loads((folder / "dataset_description.json").read_text())
    assert {"name", "description", "schemaVersion", "variableMeasured"} <= set(book)
    described = {entry["name"] for entry in book["variableMeasured"]}
    for path in (folder / "data").rglob("*_data.csv"):
        assert set(path.read_text().split("\n", 1)[0].split(",")) <= described, path.name


def test_the_code_book_names_the_option_of_a_column_with_its_place(tmp_path):
    asked = (defined([item("ranking", "r"), item("text", "t")]),)
    write(Dataset(STUDY, questionnaires=asked), tmp_path)
    expected = {
        "r.a": "test: Text of r – A",
        "r.c": "test: Text of r – C",
        "r_missing": "test: why there is no answer to: Text of r",
        "t": "test: Text of t",
    }
    found = descriptions(tmp_path)
    assert found | expected == found


def test_formulas_of_spreadsheets_are_guarded_and_read_unchanged(tmp_path):
    formulas = '=HYPERLINK("x")\nsecond "line", with comma\r=1+1;-cmd\t@x'
    doors = ("lab-door", "lounge-door")
    values = {"words": "=1+1", "several": ["x", "y"], "n": -2}
    dataset = Dataset(
        STUDY,
        participants=(ParticipantRecord("a", left="'quoted"),),
        sessions=(replace(SESSION, reason=formulas, doors_closed=doors),),
        events=(EventRecord("s", -1.5, "page", "cue", {"ä": [1, "|"]}),),
        responses=(ResponseRecord("r", "ict", "a", values, missing={"gender": "skipped"}),),
    )
    write(dataset, tmp_path)
    written = (tmp_path / "data" / "description-sessions_data.csv").read_bytes().decode()
    assert not re.search(r"[;\t\r\n]\"*[=@-]", written)
    again = read(tmp_path)
    assert again.sessions[0].reason == formulas
    assert again.sessions[0].doors_closed == doors
    assert again.participants[0].left == "'quoted"
    assert (again.events, again.responses) == (dataset.events, dataset.responses)


def test_numbers_are_read_with_all_their_digits(tmp_path):
    values = [0.1, 1e-17, 1.0 / 3.0, 123456789.123456789, -0.0, 1e300, 5.0]
    for file in numbers("states", "s", columns_of(STATES, x=values)):
        put(file, tmp_path)
    write(Dataset(STUDY, sessions=(SESSION,)), tmp_path)
    found = read(tmp_path).states("s")
    np.testing.assert_array_equal(found["x"], values)
    assert np.isnan(found["y"]).all()


def test_states_that_were_written_before_a_column_was_added_lack_it(tmp_path):
    states = columns_of(STATES, x=[1.0, 2.0], distance_by_position=[1.0, 1.0])
    write(Dataset(STUDY, sessions=(SESSION,), states=lambda _: states), tmp_path)
    path = next((tmp_path / "data" / "states").glob("*.csv"))
    late = {column.name for column in STATES if column.late}
    head, *lines = path.read_text().splitlines()
    kept = [at for at, name in enumerate(head.split(",")) if name not in late]
    rows = [[line.split(",")[at] for at in kept] for line in (head, *lines)]
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    found = read(tmp_path).states("s")
    assert found["x"].tolist() == [1.0, 2.0]
    assert np.isnan(found["distance_by_position"]).all()


def test_columns_are_read_by_their_names_also_the_names_of_earlier_releases(tmp_path):
    states = columns_of(STATES, x=[1.0, 2.0], y=[3.0, 4.0], visitor_silence=[0.1, 0.2])
    one = SessionRecord("s", "a", "giraff", outcome="completed", number=2)
    write(Dataset(STUDY, sessions=(one,), states=lambda _: states), tmp_path)
    for path in (tmp_path / "data").rglob("*.csv"):
        rows = [line.split(",")[::-1] for line in path.read_text().splitlines()]
        path.write_text("".join(",".join(row) + "\n" for row in rows))
    path = tmp_path / "data" / "states" / "session-s_data.csv"
    path.write_text(path.read_text().replace("visitor_silence", "silence", 1))
    again = read(tmp_path)
    assert plain(again.sessions[0]) == plain(one)
    np.testing.assert_array_equal(matrix_of(again.states("s")), matrix_of(states))
    path.write_text(path.read_text().replace("silence", "noise", 1))
    with pytest.raises(DatasetError, match="lacks the columns visitor_silence"):
        read(tmp_path).states("s")


def test_an_empty_study_can_be_written_and_read(tmp_path):
    write(Dataset(STUDY), tmp_path)
    assert read(tmp_path).sessions == ()
    assert len(read(tmp_path).states("nobody")) == 0


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("study.json", "{", "study.json"),
        ("study.json", "{}", "study.json"),
        ("data/description-sessions_data.csv", "id,participant\ns,a\n", "lacks the columns"),
        (PEOPLE, f"{PEOPLE_HEAD}a,participant,old,,,,0,0\n", "old"),
        (PEOPLE, f"{PEOPLE_HEAD}a,participant\n", "too few"),
        (EVENTS, "session,stamp,source,type,data\ns,1,page,cue,{\n", "description-events"),
        ("data/description-answers_data.csv", None, "description-answers"),
        ("robots.json", "[{}]", "robots.json"),
        ("plans/office.json", "{}", "office.json"),
    ],
)
def test_a_broken_file_is_named(folder, name, content, says):
    path = folder / name
    path.unlink() if content is None else path.write_text(content)
    with pytest.raises(DatasetError, match=says):
        read(folder)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("stamp", "time", 1),
        lambda text: text[:-9],
        lambda text: text.replace("0.9", "lots", 1),
    ],
)
def test_a_broken_file_of_states_is_named_when_it_is_read(folder, change):
    path = min((folder / "data" / "states").glob("*.csv"))
    dataset = read(folder)
    session = next(one.id for one in dataset.sessions if one.id.replace("-", "") in path.name)
    assert len(dataset.states(session))
    path.write_text(change(path.read_text()))
    with pytest.raises(DatasetError, match=path.name):
        dataset.states(session)


@pytest.mark.parametrize("code", ["../../etc/passwd", "", "a/b", "x" * 65])
def test_a_code_that_is_no_name_of_a_file_is_refused(tmp_path, code):
    states = columns_of(STATES, x=[1.0])
    dataset = Dataset(STUDY, sessions=(replace(SESSION, id=code),), states=lambda _: states)
    with pytest.raises(DatasetError):
        write(dataset, tmp_path)


def test_code_book_marks_items_that_are_scored_in_reverse(tmp_path):
    asked = defined([item("likert", "a"), item("likert", "b", reverse=True)], scoring="likert")
    write(Dataset(STUDY, questionnaires=(asked,)), tmp_path)
    described = descriptions(tmp_path)
    assert described["a"] == "test: Text of a"
    assert described["b"].startswith("test: Text of b (reverse-coded: stored as answered")
