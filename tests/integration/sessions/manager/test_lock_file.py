"""A lock that the system releases when its process dies, held by real processes."""

import contextlib
import signal
import subprocess
import sys

from sessions.manager.lock_file import LockFile

HOLDER = """
import sys
from pathlib import Path
from sessions.manager.lock_file import LockFile
life = LockFile(Path(sys.argv[1]))
print(repr(life.predecessor()), flush=True)
life.sign("first")
print("signed", flush=True)
sys.stdin.read()
"""


@contextlib.contextmanager
def holder(path):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert (process.stdout.readline(), process.stdout.readline()) == ("''\n", "signed\n")
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.communicate()


def test_lock_of_a_killed_process_names_it_as_predecessor(tmp_path):
    life = LockFile(tmp_path / "lock")
    with holder(tmp_path / "lock") as process:
        assert life.predecessor() == ""
        process.kill()
        process.wait()
        assert life.predecessor() == "first"
        life.sign("second")
        assert life.predecessor() == "second"
    assert LockFile(tmp_path / "lock").predecessor() == "", "the file is held by the second"
    life.release()
    assert LockFile(tmp_path / "lock").predecessor() == "second"


def test_stopped_process_is_no_predecessor(tmp_path):
    with holder(tmp_path / "lock") as process:
        process.send_signal(signal.SIGSTOP)
        assert LockFile(tmp_path / "lock").predecessor() == ""


def test_process_that_does_not_hold_the_file_cannot_sign_it(tmp_path):
    with holder(tmp_path / "lock"):
        life = LockFile(tmp_path / "lock")
        life.predecessor()
        life.sign("second")
    assert (tmp_path / "lock").read_text().startswith("first\n")


def test_lock_in_a_missing_folder_is_ignored_without_an_error(tmp_path):
    life = LockFile(tmp_path / "there is no such folder" / "lock")
    assert life.predecessor() == ""
    life.sign("second")
    life.release()


def test_copy_of_the_file_names_no_predecessor_because_its_writer_may_live(tmp_path):
    with holder(tmp_path / "lock"):
        (tmp_path / "copy").write_bytes((tmp_path / "lock").read_bytes())
        assert LockFile(tmp_path / "copy").predecessor() == ""


def test_file_of_another_boot_names_no_predecessor(tmp_path, monkeypatch):
    with holder(tmp_path / "lock"):
        pass
    life = LockFile(tmp_path / "lock")
    assert life.predecessor() == "first"
    (tmp_path / "boot").write_text("another")
    monkeypatch.setattr("sessions.manager.lock_file.BOOT", tmp_path / "boot")
    assert life.predecessor() == ""
    life.release()


def test_removed_file_names_no_predecessor(tmp_path):
    with holder(tmp_path / "lock"):
        (tmp_path / "lock").unlink()
        assert LockFile(tmp_path / "lock").predecessor() == ""
