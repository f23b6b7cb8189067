"""The process that computes a report prints its progress, and leaves no report that was deleted."""

import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest

from experiments.dataset.folder import write
from tests.support.analysis.study_dataset import made_up
from tests.support.paths import ROOT

PATIENCE = 300.0


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dataset")
    write(made_up(np.random.default_rng(5), 12), folder)
    return folder


def computing(dataset, home):
    """Start the computation of a report in `home`, as the analysis page does."""
    words = ("manage.py", "analyse_study", "--dataset", str(dataset), "--out", str(home / "key"))
    with (home / "key.log").open("xb") as log:
        return subprocess.Popen(
            [sys.executable, *words, "--page", "--progress"],
            cwd=ROOT,
            env=os.environ | {"HTTP_ONLY": "1"},
            stdout=log,
            stderr=subprocess.STDOUT,
        )


def lines(home):
    found = (home / "key.log").read_text().splitlines()
    return [json.loads(line) for line in found if line.startswith("{")]


@pytest.mark.nightly
def test_progress_counts_sessions_and_files_until_the_report_is_there(dataset, tmp_path):
    process = computing(dataset, tmp_path)
    assert process.wait(PATIENCE) == 0
    printed = lines(tmp_path)
    assert [one["measured"] for one in printed] == sorted(one["measured"] for one in printed)
    assert [one["files"] for one in printed] == sorted(one["files"] for one in printed)
    assert printed[-1]["measured"] <= printed[-1]["sessions"]
    assert printed[-1]["files"] > 20
    assert (tmp_path / "key" / "SHA256SUMS").is_file()


@pytest.mark.nightly
def test_computation_ends_and_leaves_nothing_once_its_report_is_deleted(dataset, tmp_path):
    process = computing(dataset, tmp_path)
    deadline = time.monotonic() + PATIENCE
    while not lines(tmp_path) and time.monotonic() < deadline:
        time.sleep(0.05)
    (tmp_path / "key.log").unlink()
    assert process.wait(PATIENCE) == 1
    assert list(tmp_path.iterdir()) == []
