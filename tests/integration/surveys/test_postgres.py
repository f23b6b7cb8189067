"""The same rows on PostgreSQL, which reorders JSON's keys, is strict about text, and lets
writers run side by side.
"""

import os
import subprocess
import sys

import pytest

from tests.support.paths import ROOT
from tests.support.programs.postgres import running_postgres

pytestmark = [pytest.mark.postgres, pytest.mark.nightly]
SAME = ["test_questionnaires.py", "test_responses.py", "test_admin.py"]


def test_questionnaires_and_responses_keep_their_promises_on_postgres(tmp_path):
    with running_postgres() as server:
        environment = {**os.environ, "VAR_DIR": str(tmp_path), "DATABASE_URL": server.url}
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            *(f"tests/integration/surveys/{name}" for name in SAME),
        ]
        done = subprocess.run(
            command,
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
    assert done.returncode == 0, done.stdout[-4000:]
    assert " passed" in done.stdout
