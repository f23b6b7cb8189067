"""The example package: the conformance suite on its adapter, and a drive with it installed."""

import json
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from tests.support.architectures.acme_robot import EXAMPLE, AcmeRig
from tests.support.architectures.rca_conformance import RcaConformance
from tests.support.paths import ROOT
from tests.support.programs.finished import run


class TestAcme(RcaConformance):
    @pytest.fixture(autouse=True, scope="class")
    def _importable(self):
        sys.path.insert(0, str(EXAMPLE))
        yield
        sys.path.remove(str(EXAMPLE))

    @pytest.fixture(scope="class")
    def shared_rig(self, _importable):
        with AcmeRig() as rig:
            yield rig

    def make_rig(self, directory):
        return AcmeRig()


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Return the Python of a new virtual environment with the package. The project's libraries are
    those of the environment that runs the tests.
    """
    folder = tmp_path_factory.mktemp("robot") / "environment"
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    found = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = output(python, "-c", found).strip()
    paths = f"{sysconfig.get_path('purelib')}\n{ROOT}\n"
    Path(site, "project.pth").write_text(paths, encoding="utf-8")
    offline = ["--no-index", "--no-deps", "--no-build-isolation", "--disable-pip-version-check"]
    output(sys.executable, "-m", "pip", "--python", python, "install", "-q", *offline, EXAMPLE)
    return python


def output(*command):
    ran = run(*command)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout


@pytest.mark.nightly
def test_agent_drives_with_an_installed_adapter(environment, tmp_path):
    printed = output(environment, "-m", "tests.support.architectures.acme_drive", tmp_path)
    found = json.loads(printed.splitlines()[-1])
    assert found["adapters"].count("acme") == 1
    assert found["driven"] > 0.1, "metres"
    red, green, blue = found["photo"]
    assert red > 120
    assert max(green, blue) < 80, "the SDK's pictures are BGR"
    assert found["touched"] == ["ahead"]
    assert found["after_contact"] == 0.0, "m/s"
    assert found["latest_tick"] < 0.2 + found["host_late"], "a hung call stalls the loop"
    assert "has stopped sending its odometry" in found["lost"] or "answer" in found["lost"]
    assert found["seconds_to_end"] < 6.0


def test_package_contains_its_profile(environment):
    text = "import telepresence_acme.adapter as a; robot = a.create('acme', {});"
    text += "print(a.__file__, robot.profile.series)"
    place, series = output(environment, "-c", text).split()
    assert series == "acme"
    assert str(ROOT) not in place, "not the installed package"
