"""The recorder on PostgreSQL, which is stricter about text than SQLite, and can be away."""

import json
import os
import subprocess
import sys

import pytest

from tests.support.paths import ROOT
from tests.support.programs.postgres import running_postgres

pytestmark = pytest.mark.postgres


@pytest.mark.nightly
def test_crash_of_the_database_and_invalid_text_lose_no_other_state(tmp_path):
    with running_postgres() as server:
        environment = {**os.environ, "VAR_DIR": str(tmp_path), "DATABASE_URL": server.url}
        command = [sys.executable, "-m", "tests.support.sessions.record_exercise"]
        with subprocess.Popen(
            command,
            cwd=ROOT,
            env=environment,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        ) as exercise:
            assert json.loads(exercise.stdout.readline()) == {"at": "half"}
            server.stop()
            print("go on", file=exercise.stdin, flush=True)
            assert json.loads(exercise.stdout.readline()) == {"at": "away"}
            server.start()
            print("go on", file=exercise.stdin, flush=True)
            found = json.loads(exercise.stdout.readline())
    assert found["stopped"]
    assert found["seqs"] == list(range(1, 201))
    assert found["said"] == "ab"
    assert found["refused"] >= 1, "text that cannot be stored was not refused"


def test_autovacuum_of_states_is_frequent():
    with running_postgres() as server:
        asked = "SELECT reloptions FROM pg_class WHERE relname = 'telepresence_sessions_statechunk'"
        assert server.ask(asked) == [(["autovacuum_vacuum_scale_factor=0.02"],)]
