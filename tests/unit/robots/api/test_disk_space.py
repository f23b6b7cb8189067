"""How much room a disk has, in a word."""

from types import SimpleNamespace

import pytest

from robots.api import disk_space
from robots.api.disk_space import MIB, DiskSpace


@pytest.mark.parametrize(
    ("free", "word"),
    [(600, "ok"), (500, "ok"), (499, "low"), (2, "low"), (1.9, "full"), (0, "full")],
)
def test_free_space_is_classified(monkeypatch, tmp_path, free, word):
    monkeypatch.setattr(
        disk_space.shutil, "disk_usage", lambda _: SimpleNamespace(free=int(free * MIB))
    )
    assert DiskSpace(tmp_path, 500).state() == word


def test_a_small_disk_is_full_without_a_warning_limit(monkeypatch, tmp_path):
    monkeypatch.setattr(disk_space.shutil, "disk_usage", lambda _: SimpleNamespace(free=MIB))
    assert DiskSpace(tmp_path, 0).state() == "full"


def test_a_missing_disk_has_no_room(tmp_path):
    assert DiskSpace(tmp_path / "gone", 500).state() == "full"
