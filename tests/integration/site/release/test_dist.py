"""`make dist`: a release of the present commit."""

import hashlib
import json
import os
import sys

import pytest

from telepresence import __version__
from tests.support.paths import ROOT
from tests.support.programs.finished import run

pytestmark = pytest.mark.nightly  # a quicker test of the wheel is in test_wheel.py


def built(folder, **environment):
    words = (sys.executable, ROOT / "deploy" / "dist.py", folder)
    run(*words, check=True, cwd=folder.parent, env={**os.environ, **environment})
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def dist(tmp_path_factory):
    return built(tmp_path_factory.mktemp("first") / "dist")


def test_two_builds_have_the_same_bytes(dist, tmp_path):
    before = os.umask(0o077)
    try:
        again = built(tmp_path / "dist", TZ="Asia/Tokyo", LC_ALL="C", PYTHONHASHSEED="1")
    finally:
        os.umask(before)
    assert again == dist
    assert len(dist) == 5


def test_checksums_name_every_other_file(dist):
    sums = dict(line.split()[::-1] for line in dist["SHA256SUMS"].decode().splitlines())
    others = {name: content for name, content in dist.items() if name != "SHA256SUMS"}
    assert sums == {name: hashlib.sha256(content).hexdigest() for name, content in others.items()}


@pytest.mark.parametrize("part", ["robot", "server"])
def test_component_list_has_every_locked_package_with_its_hashes(dist, part):
    (content,) = [content for name, content in dist.items() if name.endswith(f"{part}.cdx.json")]
    found = json.loads(content)
    listed = {f"{one['name']}=={one['version']}" for one in found["components"]}
    lines = (ROOT / f"requirements-{part}.lock").read_text().splitlines()
    assert listed == {line.split()[0] for line in lines if "==" in line}
    assert all(one["externalReferences"][0]["hashes"] for one in found["components"])
    assert found["metadata"]["component"]["version"] == __version__
