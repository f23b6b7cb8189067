"""Reports that the analysis pages show: each computed by a process of its own, because that may
take minutes, and used as long as the data in the database are the same.

The key of a report is a hash of all data that it could depend on. In the folder of a study's
reports, `<key>/` is a report, complete once its sums are there, and `<key>.log` is what the process
that computes it has printed: lines of its progress, and at last why it failed.
"""

import datetime
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from django.conf import settings
from django.db import connection
from django.db.models import Count, Max

from experiments.analysis.metrics.definitions import VERSION
from experiments.analysis.page import LAYOUT, PAGE
from experiments.dataset.levels import Kind
from experiments.dataset.records import COUNTING, EVERY
from experiments.export.reports import ReportProgress, home
from experiments.extraction.robots import plans_of, robots_of
from experiments.models import Drive, Participant, StepVisit, Study
from experiments.versions import analysis_versions
from sessions.models import StateChunk
from surveys.models import Questionnaire, Response

STALE_SECONDS = 120.0  # without output: the process is gone
KEPT = 6  # reports a study
_started: dict[Path, "subprocess.Popen[bytes]"] = {}  # children of this process, by their log


class NotComputedError(RuntimeError):
    """The report could not be made; says why."""


@dataclass(frozen=True)
class Computing:
    """A report that is being computed; without progress until its process has begun."""

    key: str
    progress: ReportProgress | None = None


@dataclass(frozen=True)
class Stored:
    """A report on disk; `key` names it in addresses."""

    key: str
    folder: Path

    @property
    def computed_at(self) -> datetime.datetime:
        written = (self.folder / "SHA256SUMS").stat().st_mtime
        return datetime.datetime.fromtimestamp(written, datetime.UTC)

    @property
    def selections(self) -> tuple[str, ...]:
        """Those that count, and all drives (a sensitivity analysis) where some are excluded."""
        return tuple(name for name in (COUNTING, EVERY) if (self.folder / name).is_dir())

    def read(self, selection: str, name: str) -> Any:
        path = self.folder / selection / PAGE / f"{name}.json"
        return json.loads(path.read_text(encoding="utf-8"))


def key_of(study: Study, kinds: Sequence[Kind]) -> str:
    """Return a hash that differs whenever anything differs that a report shows."""
    people = Participant.objects.filter(study=study).order_by("pk")
    drives = Drive.objects.filter(participant__study=study).order_by("pk")
    definition = study.as_definition()
    answers = Response.objects.filter(user__participations__study=study).order_by("pk").distinct()
    of_people = ("pk", "kind", "status", "stage", "cell", "step", "age", "completion")
    of_drives = ("pk", "outcome", "settled_at", "excluded_at", "excluded_reason")
    of_sessions = ("session__ended_at", "session__closed_at", "session__outcome")
    chunks = StateChunk.objects.filter(session__drive__participant__study=study)
    visits = StepVisit.objects.filter(participant__study=study)
    about = (
        list(people.values_list(*of_people)),
        list(drives.values_list(*of_drives, *of_sessions)),
        list(answers.values_list("pk", "seen_at", "finished_at")),
        chunks.filter(session__closed_at=None).count(),
        list(visits.aggregate(Count("pk"), Max("began_at"), Max("finished_at")).values()),
        list(Questionnaire.objects.order_by("pk").values_list("pk", "sha256")),
        robots_of(definition, drives.values_list("session__robot__name", flat=True)),
        plans_of(definition),
        (study.sha256, study.published_at, study.deviations, VERSION, LAYOUT, sorted(kinds)),
        analysis_versions(),
    )
    return hashlib.sha256(repr(about).encode()).hexdigest()[:24]


def found(study: Study, key: str) -> Stored | None:
    folder = home(study) / key
    return Stored(key, folder) if key.isalnum() and (folder / "SHA256SUMS").is_file() else None


def report_for(study: Study, kinds: Sequence[Kind], followed: str = "") -> Stored | Computing:
    """Return the report on the present data, or the progress of its computation, which is started
    if necessary; a NotComputedError when it failed, and the next call tries again. A page that
    shows or waits for a report names its key (`followed`), so that it does not change while
    participants take part.
    """
    if followed.isalnum() and (known := _known(study, followed)):
        return known
    key = key_of(study, kinds)
    return _known(study, key) or _start(study, key, kinds)


def _known(study: Study, key: str) -> Computing | Stored | None:
    log = home(study) / f"{key}.log"
    if stored := found(study, key):
        _drop(log)
        return stored
    try:
        lines, last = log.read_text().splitlines(), log.stat().st_mtime
    except FileNotFoundError:
        return None
    process = _started.get(log)
    is_over = process.poll() is not None if process else time.time() - last > STALE_SECONDS
    progress = [line for line in lines if line[:1] + line[-1:] == "{}"]
    if not is_over and progress:
        return Computing(key, msgspec.json.decode(progress[-1], type=ReportProgress))
    if not is_over:
        return Computing(key)
    _drop(log)
    if stored := found(study, key):  # it has finished since the first look
        return stored
    errors = [line for line in lines if line not in progress]
    raise NotComputedError(errors[-1] if errors else "The computation was interrupted.")


def _drop(log: Path) -> None:
    _started.pop(log, None)
    log.unlink(missing_ok=True)


def _start(study: Study, key: str, kinds: Sequence[Kind]) -> Computing:
    _forget_old(study)
    folder, log = home(study) / key, home(study) / f"{key}.log"
    folder.parent.mkdir(parents=True, exist_ok=True)
    options = [word for kind in kinds for word in ("--kind", kind)]
    words = ("analyse_study", f"{study.slug}:{study.version}", "--out", str(folder))
    try:
        output = log.open("xb")
    except FileExistsError:  # another request has started it
        return Computing(key)
    streams = {"stdin": subprocess.DEVNULL, "stdout": output, "stderr": subprocess.STDOUT}
    with output:
        shutil.rmtree(folder, ignore_errors=True)
        line = command(*words, "--page", "--noted", "--progress", *options)
        _started[log] = subprocess.Popen(line, env=environment(), **streams)
    return Computing(key)


def command(*words: str) -> list[str]:
    """Return the words that run a command of the site, at low priority where there is `nice`."""
    nice = shutil.which("nice")
    manage = [sys.executable, str(settings.BASE_DIR / "manage.py"), *words]
    return [nice, "-n", "10", *manage] if nice else manage


def environment() -> dict[str, str]:
    """Return the environment in which a command uses the same database as this process."""
    variables = {"VAR_DIR": str(settings.VAR_DIR)}
    if connection.vendor == "sqlite":
        variables["DATABASE_URL"] = f"sqlite:///{connection.settings_dict['NAME']}"
    return os.environ | variables


def _forget_old(study: Study) -> None:
    reports = list(home(study).glob("*/SHA256SUMS"))
    for path in sorted(reports, key=lambda one: one.stat().st_mtime, reverse=True)[KEPT - 1 :]:
        shutil.rmtree(path.parent, ignore_errors=True)
