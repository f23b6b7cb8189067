"""deploy/run_tests.sh fails for an unknown word, a run without any test and a failed part, and
shows the output of its parts when it is interrupted.

A shell script replaces the programs of the virtual environment, so that each run takes seconds.
"""

import os
import signal
import subprocess
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.sessions.site import wait_for

# the last folder of each
PARTS = ["tests/integration", "tests/integration/browser/visits", "tests/timing/robots"]
OTHERS = [
    "tests/integration/robots/agent/adapters",
    "tests/integration/browser/studies",
    "tests/integration/surveys",
    "tests/timing/browser",
]
ANSWER = """#!/bin/sh
last=""
for word in "$@"; do
    case "$word" in --ignore) break ;; tests/*) last=$word ;; esac
done
echo "$last" >>"$CALLED"
echo "this is what $last said"
[ "$last" != "${HANGS:-nobody}" ] || sleep 300
code=0
for one in ${ENDS:-}; do [ "${one%=*}" != "$last" ] || code=${one#*=}; done
exit "$code"
"""


class Runner:
    def __init__(self, folder: Path) -> None:
        self.called = folder / "called"
        self.temporary = folder / "tmp"
        self.temporary.mkdir()
        programs = folder / "bin"
        programs.mkdir()
        for name in ("python", "mypy"):
            (programs / name).write_text(ANSWER)
            (programs / name).chmod(0o755)
        folders = {"BIN": programs, "CALLED": self.called, "TMPDIR": self.temporary}
        self.environment = {name: str(path) for name, path in folders.items()}
        self.environment["PATH"] = os.environ["PATH"]

    def begin(self, word: str, **more: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            ["/bin/sh", "deploy/run_tests.sh", word],
            cwd=ROOT,
            env={**self.environment, **more},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def run(self, word: str, **more: str) -> tuple[int, str]:
        process = self.begin(word, **more)
        output, _ = process.communicate(timeout=60)
        return process.returncode, output

    def parts(self) -> list[str]:
        return self.called.read_text().splitlines() if self.called.exists() else []


@pytest.fixture
def runner(tmp_path) -> Runner:
    return Runner(tmp_path)


def test_unknown_word_fails_the_run(runner):
    code, output = runner.run("nigthly")
    assert code == 2
    assert "not nigthly" in output


def test_folder_that_the_environment_names_is_kept(runner, tmp_path):
    (tmp_path / "mine").mkdir()
    code, _ = runner.run("nightly", LOGS=str(tmp_path / "mine"), RUN_STARTED="1")
    assert code == 0
    assert (tmp_path / "mine").is_dir()
    assert list(runner.temporary.iterdir()) == []


@pytest.mark.parametrize("word", ["nightly", "soak"])
def test_failed_part_does_not_stop_the_others_and_is_named_at_the_end(runner, word):
    code, output = runner.run(word, ENDS="tests/integration=1 tests/timing/robots=2")
    assert code == 1
    assert output.strip().endswith("failed: servers timing_of_robots")
    assert {*PARTS, *OTHERS} <= set(runner.parts())


def test_one_part_may_have_no_marked_test_but_not_the_whole_run(runner):
    code, _ = runner.run("nightly", ENDS="tests/timing/robots=5")
    assert code == 0
    all_empty = " ".join(f"{name}=5" for name in (*PARTS, *OTHERS))
    code, output = runner.run("nightly", ENDS=all_empty)
    assert code == 1
    assert "No test was chosen" in output


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_interrupted_run_ends_its_parts_and_shows_their_output(runner, end: signal.Signals):
    process = runner.begin("nightly", HANGS=PARTS[1])
    wait_for(lambda: PARTS[1] in runner.parts(), 30, "the browsers' part")
    process.send_signal(end)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 128 + end
    assert "-- browsers, not finished" in output
    assert f"this is what {PARTS[1]} said" in output
    assert list(runner.temporary.iterdir()) == []


def test_part_that_ends_first_is_shown_first(runner):
    process = runner.begin("nightly", HANGS="tests/integration")
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith("-- browsers, ended"):
            break
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=60)
    assert "-- servers, not finished" in output
