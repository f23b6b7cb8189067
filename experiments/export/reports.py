"""The folders of reports on studies, and the progress of the computation of one."""

import os
import shutil
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import msgspec
from django.conf import settings

from experiments.dataset.columns import Columns
from experiments.dataset.records import Dataset
from experiments.models import Study

INTERVAL_S, LIMIT_S = 1.0, 3600.0


def home(study: Study) -> Path:
    return Path(settings.VAR_DIR) / "analysis" / str(study.pk)


def forget(study: Study) -> None:
    """Delete all reports on a study: they show data that a participant has withdrawn."""
    shutil.rmtree(home(study), ignore_errors=True)


class ReportProgress(msgspec.Struct, frozen=True):
    """Sessions measured of all `sessions`, and files written, after so many seconds."""

    measured: int
    sessions: int
    files: int
    seconds: float


class ProgressLines(threading.Thread):
    """Prints a ReportProgress each second while a report is computed into a folder."""

    def __init__(self, folder: Path) -> None:
        super().__init__(daemon=True)
        self._folder = folder
        self._ended = threading.Event()
        self._sessions = 0
        self._measured: set[str] = set()

    def follow(self, dataset: Dataset) -> Dataset:
        """Return a dataset that notes which of its sessions are measured."""
        self._sessions = len(dataset.sessions)

        def states(session: str) -> Columns:
            self._measured.add(session)
            return dataset.states(session)

        return replace(dataset, states=states)

    def stop(self) -> None:
        """Stop printing: a thread that still prints while Python exits aborts it."""
        self._ended.set()
        if self.is_alive():
            self.join()

    def run(self) -> None:
        """Print until it is stopped; end the process at the limit, or if its report is deleted."""
        begin = time.monotonic()
        while (seconds := time.monotonic() - begin) < LIMIT_S:
            files = sum(path.is_file() for path in self._folder.rglob("*"))
            line = ReportProgress(len(self._measured), self._sessions, files, seconds)
            print(msgspec.json.encode(line).decode(), flush=True)  # noqa: T201 -- its purpose
            if self._ended.wait(INTERVAL_S):
                return
            # `forget` unlinks the file that this prints into: no report may be left after that.
            if not os.fstat(sys.stdout.fileno()).st_nlink:
                break
        shutil.rmtree(self._folder, ignore_errors=True)
        print(f"The computation took longer than {LIMIT_S:.0f} s.", flush=True)  # noqa: T201
        os._exit(1)
