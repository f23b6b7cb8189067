"""The dataset alone gives the same tables with other versions of the libraries, which are installed
from the package index into an environment of their own, over the packages of the project.
"""

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import numpy as np
import pytest

from experiments.dataset.folder import write
from experiments.dataset.records import COUNTING
from tests.support.analysis.study_dataset import made_up
from tests.support.paths import ROOT

pytestmark = [pytest.mark.soak, pytest.mark.timeout(1200)]

# The oldest that the project allows beside this Python, and one between it and the newest.
VERSIONS = (("2.0.2", "3.10.0"), ("2.3.5", "3.10.7"))


def environment_with(folder: Path, *packages: str) -> Path:
    """Return the Python of an environment in which these packages hide those of the project."""
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "-q", *packages], check=True)
    own = sysconfig.get_path("purelib", vars={"base": str(folder)})
    Path(own, "project.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python


def report_by(python: Path | str, dataset: Path, folder: Path) -> dict[str, bytes]:
    """Return the tables of a report that this Python makes, by their names."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    words = ("manage.py", "analyse_study", "--dataset", str(dataset), "--out", str(folder))
    subprocess.run([python, *words], check=True, cwd=ROOT, env=environment)
    tables = (folder / COUNTING / "tables").glob("*.csv")
    return {path.stem: path.read_bytes() for path in tables}


@pytest.mark.parametrize(("numpy", "matplotlib"), VERSIONS)
def test_other_versions_of_numpy_and_matplotlib_make_the_same_tables(tmp_path, numpy, matplotlib):
    dataset = tmp_path / "dataset"
    write(made_up(np.random.default_rng(81), 24), dataset)
    packages = (f"numpy=={numpy}", f"matplotlib=={matplotlib}")
    theirs = report_by(environment_with(tmp_path / "other", *packages), dataset, tmp_path / "a")
    ours = report_by(sys.executable, dataset, tmp_path / "b")
    software = theirs.pop("software").decode()
    assert numpy in software, "the other version did not run"
    assert matplotlib in software
    assert ours.pop("software").decode() != software
    assert len(ours) > 20
    assert sorted(ours) == sorted(theirs)
    assert [name for name in ours if ours[name] != theirs[name]] == []
