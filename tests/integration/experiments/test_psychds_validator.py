"""The official validator of Psych-DS accepts an export, and refuses what our own rules refuse."""

import shutil

import numpy as np
import pytest

from experiments.dataset.folder import write
from experiments.export.archive import unpacked
from experiments.export.files import export_files
from experiments.extraction.selection import Selection
from tests.support.analysis import psychds_rules, psychds_validator
from tests.support.analysis.study_dataset import made_up
from tests.support.studies.study_rows import put

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.browser,
    pytest.mark.django_db(transaction=True),
    pytest.mark.skipif(
        not psychds_validator.is_there(),
        reason="var/psychds is missing: make setup-psychds fetches the validator of Psych-DS",
    ),
]


def errors(folder) -> list[str]:
    found = psychds_validator.validate(folder)
    wrong = [one for one in found["issues"] if one["severity"] == "error"]
    assert found["valid"] is not bool(wrong)
    return [f"{one['key']}: {', '.join(one['files'])}" for one in wrong]


def test_official_validator_accepts_an_export(tmp_path):
    stored = put(made_up(np.random.default_rng(3), 3))
    folder = tmp_path / "dataset"
    choice = Selection(formats=frozenset({"mcap", "labelled"}))
    list(unpacked(export_files(stored.study, choice), folder))
    assert errors(folder) == []
    assert psychds_rules.errors(folder) == []


@pytest.mark.parametrize(
    "spoil",
    [
        lambda at: (at / "dataset_description.json").unlink(),
        lambda at: (at / "data" / "questionnaire-a-b_data.csv").write_text("id\n1\n"),
        lambda at: (at / "data" / "description-x_data.csv").write_text("unheard\n1\n"),
        lambda at: (at / "data" / "description-x_data.csv").write_text("x,y\n1\n"),
        lambda at: shutil.rmtree(at / "data"),
    ],
)
def test_official_validator_refuses_what_our_rules_refuse(tmp_path, spoil):
    write(made_up(np.random.default_rng(3), 2), tmp_path)
    spoil(tmp_path)
    assert psychds_rules.errors(tmp_path)
    assert errors(tmp_path)
