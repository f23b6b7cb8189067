"""Folders that are computed once for a state of the sources and shared by all test processes."""

import fcntl
import hashlib
import shutil
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from tests.support.paths import ROOT

FORGOTTEN_S = 24 * 3600.0


def kept_folder(name: str, sources: Iterable[Path], make: Callable[[Path], None]) -> Path:
    """Return a folder that `make` has filled. The first process that needs it calls `make`, and
    again after one of the sources has changed.
    """
    parent = ROOT / ".pytest_cache" / name
    parent.mkdir(parents=True, exist_ok=True)
    with (parent / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        folder = parent / _digest(sources)
        if not folder.is_dir():
            for old in parent.glob("*/"):
                # another run may still use a newer one
                if time.time() - old.stat().st_mtime > FORGOTTEN_S:
                    shutil.rmtree(old, ignore_errors=True)
            unfinished = folder.with_suffix(".new")
            shutil.rmtree(unfinished, ignore_errors=True)
            unfinished.mkdir()
            make(unfinished)
            unfinished.rename(folder)
    return folder


def _digest(sources: Iterable[Path]) -> str:
    entries = sorted(f"{path} {path.stat().st_mtime_ns} {path.stat().st_size}" for path in sources)
    return hashlib.sha256("\n".join(entries).encode()).hexdigest()[:16]
