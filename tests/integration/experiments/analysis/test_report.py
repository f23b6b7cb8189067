"""Everything at once: the same bytes from the same dataset, wherever it comes from, and sessions
behind every number.
"""

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from experiments.analysis.figures.drawing import as_svg
from experiments.analysis.figures.floor import thinned
from experiments.analysis.figures.trajectories import figure_6
from experiments.analysis.metrics.sessions import measure_all
from experiments.analysis.report import analyse, reports
from experiments.dataset.folder import write
from experiments.dataset.records import Dataset
from experiments.definition.shipped import shipped
from tests.support.analysis.study_dataset import made_up
from tests.support.paths import ROOT

STUDY = shipped()["exploration"]
ELSEWHERE = """
import sys
from pathlib import Path
from experiments.dataset.folder import read
from experiments.analysis.report import analyse
analyse(read(Path(sys.argv[1])), Path(sys.argv[2]))
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A dataset, its folder, and the report on it as it was made from memory."""
    folder = tmp_path_factory.mktemp("study")
    dataset = made_up(np.random.default_rng(51), 14)
    write(dataset, folder / "dataset")
    analyse(dataset, folder / "report")
    return dataset, folder


def one_excluded():
    """A dataset of which one session is excluded."""
    dataset = made_up(np.random.default_rng(51), 14)
    sessions = (replace(dataset.sessions[0], excluded="a test drive"), *dataset.sessions[1:])
    return replace(dataset, sessions=sessions)


def contents(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.nightly
def test_an_exported_dataset_alone_gives_the_same_bytes_in_another_process(tmp_path):
    folder, dataset = tmp_path, one_excluded()
    write(dataset, folder / "dataset")
    analyse(dataset, folder / "report")
    settings = tmp_path / "settings"
    settings.mkdir()
    (settings / "matplotlibrc").write_text("font.size: 20\naxes.facecolor: red\n")
    environment = os.environ | {
        "PYTHONHASHSEED": "7",
        "MPLCONFIGDIR": str(settings),
        "TZ": "Asia/Tokyo",
        "PYTHONPATH": str(ROOT),
    }
    subprocess.run(
        [sys.executable, "-c", ELSEWHERE, str(folder / "dataset"), str(tmp_path / "again")],
        check=True,
        cwd=ROOT,
        env=environment,
    )
    first, second = contents(folder / "report"), contents(tmp_path / "again")
    assert any(name.startswith("all/figures/") for name in first)
    assert sorted(first) == sorted(second)
    assert [name for name in first if first[name] != second[name]] == []


@pytest.mark.nightly
def test_the_sums_are_those_of_every_file(written):
    _, folder = written
    lines = (folder / "report" / "SHA256SUMS").read_text().splitlines()
    found = {line.split("  ")[1]: line.split("  ")[0] for line in lines}
    files = contents(folder / "report")
    del files["SHA256SUMS"]
    assert found == {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}


def test_tables_are_made_with_and_without_excluded_sessions():
    dataset = one_excluded()
    without, every = reports(dataset)
    assert len(every.measured) == len(without.measured) + 1
    assert dataset.sessions[0].id not in {one.session.id for one in without.measured}


def test_each_number_names_its_sessions_and_each_figure_file_is_complete(
    written,
):
    dataset, folder = written
    found = json.loads((folder / "report" / "counting" / "sources.json").read_text())
    known = {one.id for one in dataset.sessions}
    assert all(set(ids) <= known for ids in found["sets"])
    assert any(place is not None for row in found["tables"]["table-5"] for place in row)
    for name, parts in found["figures"].items():
        svg = (folder / "report" / "counting" / "figures" / f"{name}.svg").read_text()
        assert all(f'id="{gid}"' in svg for gid in parts), name
    assert len(found["figures"]["figure-7"]) == sum(
        bool(len(one.positions)) for one in measure_all(dataset)
    )


def test_figures_contain_no_date_and_no_path(written):
    _, folder = written
    for path in (folder / "report").rglob("figure-*"):
        content = path.read_bytes()
        assert b"Matplotlib v" not in content
        assert b"CreationDate" not in content
        assert str(ROOT).encode() not in content


@pytest.mark.nightly
@pytest.mark.parametrize("participants", [0, 1])
def test_reports_on_no_and_on_one_participant_are_written(participants, tmp_path):
    files = analyse(made_up(np.random.default_rng(52), participants), tmp_path)
    assert all(path.stat().st_size for path in files)


def test_a_study_without_plans_robots_and_questionnaires_is_drawn_all_the_same():
    dataset = made_up(np.random.default_rng(53), 3)
    (found,) = reports(replace(dataset, plans={}, robots=(), questionnaires=()))
    assert all(as_svg(one) for one in found.figures)
    (empty,) = reports(Dataset(STUDY))
    assert len(empty.tables) == len(found.tables)


def test_figure_6_has_the_path_of_every_robot():
    svg = as_svg(figure_6(made_up(np.random.default_rng(57), 1), "office")).decode()
    assert 'id="path-giraff"' in svg
    assert 'id="path-rhodon"' in svg


def test_a_thinned_way_stays_within_2_centimetres_and_keeps_its_holes():
    t = np.linspace(0.0, 6.0, 800)
    positions = np.column_stack((t, np.sin(t)))
    positions[400:] += (3.0, 0.0)
    thin = thinned(positions)
    assert len(thin) < 80
    assert np.isnan(thin).all(axis=1).sum() == 1
    assert (thin == positions[399]).all(axis=1).any()
    assert (thin == positions[400]).all(axis=1).any()
    for part, whole in (
        (thin[thin[:, 0] < 4.0], positions[:400]),
        (thin[thin[:, 0] > 4.0], positions[400:]),
    ):
        assert np.abs(np.interp(whole[:, 0], part[:, 0], part[:, 1]) - whole[:, 1]).max() < 0.03


def test_a_straight_way_is_one_line_without_a_hole():
    positions = np.column_stack((np.linspace(0.0, 9.0, 100), np.zeros(100)))
    assert thinned(positions).tolist() == [[0.0, 0.0], [9.0, 0.0]]
