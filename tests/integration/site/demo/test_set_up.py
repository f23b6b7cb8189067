"""The set-up when something is missing: one clear sentence, and an exit code other than 0."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.programs.finished import run


def shell(*arguments: str, cwd: Path = ROOT, **more: str) -> subprocess.CompletedProcess[str]:
    """Run a program with an environment of PATH, HOME and `more`."""
    environment = {"PATH": os.environ["PATH"], "HOME": str(cwd), **more}
    return run(*arguments, cwd=cwd, env=environment)


@pytest.fixture
def set_up():
    spec = importlib.util.spec_from_file_location("set_up", ROOT / "deploy" / "set_up.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def one_sentence(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode != 0
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    return done.stderr.strip()


def test_missing_python_is_named_with_the_line_that_installs_it():
    done = shell(
        "/bin/sh", "deploy/set_up.sh", "python3-that-is-not-there", ".venv", "requirements.lock"
    )
    assert "sudo apt install python3 python3-venv" in one_sentence(done)


def test_python_that_is_too_old_is_named_with_its_version(set_up, monkeypatch, capsys):
    monkeypatch.setattr(set_up, "OLDEST", (sys.version_info[0], sys.version_info[1] + 1))
    with pytest.raises(SystemExit) as ended:
        set_up.main()
    assert ended.value.code == 1
    assert f"is {sys.version_info[0]}.{sys.version_info[1]}" in capsys.readouterr().err


def test_missing_venv_module_is_named_with_its_package(set_up, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(set_up.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SystemExit):
        set_up.make_environment(str(tmp_path / "venv"))
    assert "sudo apt install python3-venv" in capsys.readouterr().err


@pytest.mark.nightly
def test_failed_installation_ends_in_one_sentence_and_is_tried_again(
    set_up, monkeypatch, capsys, tmp_path
):
    (tmp_path / "broken.lock").write_text(
        "no-such-package-anywhere==1.0 \\\n    --hash=sha256:" + "0" * 64 + "\n"
    )
    # Without an index, which might be slow.
    words = [sys.executable, str(ROOT / "deploy/set_up.py"), str(tmp_path / "venv"), "broken.lock"]
    done = shell(*words, cwd=tmp_path, PIP_NO_INDEX="1")
    assert "pip could not be updated" in one_sentence(done)
    assert not (tmp_path / "venv" / "installed").exists()
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    with pytest.raises(SystemExit):
        set_up.install(str(tmp_path / "venv/bin/python"), str(tmp_path / "broken.lock"))
    assert "could not be installed" in capsys.readouterr().err


def test_only_an_environment_that_is_not_up_to_date_is_installed(set_up, monkeypatch, tmp_path):
    """Also after the packages of another commit, or of the developers' lock."""
    monkeypatch.chdir(tmp_path)
    Path("venv").mkdir()
    installs = []
    monkeypatch.setattr(set_up, "make_environment", lambda folder: "python")
    monkeypatch.setattr(set_up, "install", lambda _, lock: installs.append(lock))
    monkeypatch.setattr(set_up, "update_pip", lambda _: None)

    def installed(lock: str, commit: str) -> list[str]:
        for name in ("requirements.lock", "requirements-dev.lock"):
            Path(name).write_text(f"{name} of {commit}")
        monkeypatch.setattr(sys, "argv", ["set_up.py", "venv", lock])
        installs.clear()
        set_up.main()
        return list(installs)

    for lock, commit, is_installed in (
        ("requirements.lock", "one", True),
        ("requirements.lock", "one", False),
        ("requirements-dev.lock", "one", True),
        ("requirements.lock", "one", False),
        ("requirements.lock", "other", True),
        ("requirements-dev.lock", "one", True),
        ("requirements.lock", "other", True),
        ("requirements.lock", "one", True),
    ):
        assert installed(lock, commit) == ([lock] if is_installed else []), (lock, commit)


@pytest.mark.nightly
def test_environment_has_the_locked_pip_and_no_setuptools(set_up, tmp_path):
    python = set_up.make_environment(str(tmp_path / "venv"))
    set_up.update_pip(python)
    listed = run(python, "-m", "pip", "list", "--format=freeze", check=True)
    locked = Path(set_up.PIP_LOCK).read_text().split()[0]
    assert listed.stdout.split() == [locked]
