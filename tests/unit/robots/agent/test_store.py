"""What survives a restart of the agent."""

import errno
from types import SimpleNamespace

from robots.agent.safety.estop_latch import EStopLatch
from robots.agent.safety.lease import Remembered
from robots.agent.store import Store
from robots.api import disk_space
from robots.api.disk_space import MIB


def test_a_latch_that_cannot_be_read_counts_as_latched(tmp_path):
    for content in ("", "{", "[]", '{"source": "driver"}'):
        (tmp_path / "estop.json").write_text(content)
        assert Store(tmp_path).latch().source == "unreadable"


def test_the_newest_lease_is_restored_and_an_unreadable_one_is_none(tmp_path):
    store = Store(tmp_path)
    assert store.lease() is None
    store.keep_lease(Remembered("s1", 4, 2, 9.5))
    assert Store(tmp_path).lease() == Remembered("s1", 4, 2, 9.5)
    (tmp_path / "lease.json").write_text("nonsense")
    assert store.lease() is None


def test_a_write_that_was_interrupted_leaves_the_old_file(tmp_path):
    store = Store(tmp_path)
    store.keep_latch(EStopLatch("driver", 1.0))
    (tmp_path / "estop.new").write_text('{"sour')
    assert store.latch() == EStopLatch("driver", 1.0)


def test_a_disk_that_fills_up_is_reported_before_it_is_full(tmp_path, monkeypatch):
    store, free = Store(tmp_path / "giraff"), 200 * MIB
    monkeypatch.setattr(disk_space.shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
    assert store.shortage() == ()  # no folder yet, so the store is empty
    store.prepare()
    assert store.shortage() == ()
    free -= 1
    assert store.shortage() == ("disk_low: 199 MB are free on the robot's computer",)
    free = 2 * MIB
    assert store.shortage()[0].startswith("disk_low: ")
    free -= 1
    assert store.shortage() == ("disk_full: 1 MB are free on the robot's computer",)


def test_a_disk_that_cannot_be_read_counts_as_full(tmp_path, monkeypatch):
    store = Store(tmp_path / "giraff")

    def dying(_path):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("pathlib.Path.is_dir", dying)
    monkeypatch.setattr(disk_space.shutil, "disk_usage", dying)
    assert store.shortage() == ("disk_full: 0 MB are free on the robot's computer",)
