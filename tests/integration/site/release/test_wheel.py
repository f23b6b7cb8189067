"""What the wheel contains, and how its command starts, without an installation."""

import os
import sys
import zipfile
from importlib.metadata import PathDistribution

import pytest

from telepresence import __version__
from tests.support.programs.finished import run

SITE = ("accounts", "experiments", "sessions", "surveys", "telepresence_site")
# Imports every module of the agent, in a process that began with the command.
EVERY_MODULE = f"""
import importlib, pkgutil, sys
from telepresence.__main__ import main
sys.argv = ["telepresence", "run_robot", "Not_A_Name"]
main()
import robots.agent
for module in pkgutil.walk_packages(robots.agent.__path__, "robots.agent."):
    importlib.import_module(module.name)
print(robots.agent.__file__)
print([name for name in {("django", "channels", "daphne", *SITE)} if name in sys.modules])
"""


@pytest.fixture(scope="session")
def unpacked(wheel, tmp_path_factory):
    folder = tmp_path_factory.mktemp("site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def command(unpacked, *words, **settings):
    """Run Python in another folder, with the wheel's package on its path."""
    environment = {**os.environ, "PYTHONPATH": str(unpacked), "HOME": str(unpacked), **settings}
    for name in ("VAR_DIR", "XDG_DATA_HOME", "DJANGO_SETTINGS_MODULE"):
        environment.pop(name, None)
    return run(sys.executable, *words, cwd=unpacked.parent, env=environment)


def test_wheel_installs_one_package_of_its_own_name(unpacked):
    assert {path.name for path in unpacked.iterdir()} == {
        "telepresence",
        f"telepresence-{__version__}.dist-info",
    }


def test_wheel_contains_neither_tests_nor_data(unpacked):
    folders = {path.name for path in unpacked.rglob("*") if path.is_dir()}
    assert not folders & {"tests", "var", "node_modules", "__pycache__"}


def test_base_installation_needs_neither_django_nor_scipy_nor_matplotlib(unpacked):
    (about,) = unpacked.glob("*.dist-info")
    needed = [word for word in PathDistribution(about).requires if "extra ==" not in word]
    names = {word.split(">")[0].lower() for word in needed}
    assert {"aiortc", "numpy", "aiomqtt"} <= {name.split("<")[0] for name in names}
    assert not names & {"django", "channels", "daphne", "scipy", "matplotlib"}


def test_agent_of_the_wheel_imports_neither_django_nor_the_site(unpacked):
    ran = command(unpacked, "-c", EVERY_MODULE)
    where, loaded = ran.stdout.splitlines()[-2:]
    assert where == str(unpacked / "telepresence" / "_tree" / "robots" / "agent" / "__init__.py")
    assert loaded == "[]"


@pytest.mark.parametrize("words", ["--version", "version"])
def test_command_prints_its_version(unpacked, words):
    assert command(unpacked, "-m", "telepresence", words).stdout == f"{__version__}\n"


def test_site_keeps_its_data_in_the_users_folder_whatever_the_current_one(unpacked):
    code = "from django.conf import settings; print(settings.VAR_DIR)"
    ran = command(unpacked, "-m", "telepresence", "shell", "--no-imports", "-c", code)
    assert ran.stdout.split()[-1] == str(unpacked / ".local" / "share" / "telepresence")
    assert not (unpacked.parent / "var").exists()


def test_missing_extra_is_named(unpacked, tmp_path):
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['django'] = None\n")
    paths = os.pathsep.join((str(tmp_path), str(unpacked)))
    ran = command(unpacked, "-m", "telepresence", "demo", PYTHONPATH=paths)
    assert ran.returncode == 1
    assert "pip install 'telepresence[site]'" in ran.stderr
    assert "Traceback" not in ran.stderr


@pytest.mark.parametrize("words", [("--adapter", "simulator"), ("--adapter", "moos")])
def test_robot_that_the_agent_must_navigate_needs_scipy_and_others_do_not(
    unpacked, tmp_path, words
):
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['scipy'] = None\n")
    paths = os.pathsep.join((str(tmp_path), str(unpacked)))
    started = ("-m", "telepresence", "run_robot", "giraff", "--check", "--yes", *words)
    ran = command(unpacked, *started, PYTHONPATH=paths)
    assert ran.returncode == 1
    assert ("pip install 'telepresence[navigation]'" in ran.stderr) == ("simulator" in words)
    assert "Traceback" not in ran.stderr
