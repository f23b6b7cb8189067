"""Where a sandbox is, and what stays of it: the logs of the last ones, nothing else."""

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from django.conf import settings

KEPT = 3


@contextmanager
def sandbox_folder(name: str) -> Iterator[Path]:
    """Yield a new folder in the site's run-time data; of older ones only the last few stay, to look
    into when something went wrong.
    """
    home: Path = settings.VAR_DIR / "sandboxes"
    home.mkdir(parents=True, exist_ok=True)
    for old in sorted(home.iterdir(), key=lambda path: path.stat().st_mtime)[: -KEPT + 1 or None]:
        shutil.rmtree(old, ignore_errors=True)
    folder = home / f"{name}-{time.time_ns()}"
    folder.mkdir()
    yield folder
