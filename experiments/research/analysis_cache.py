"""Reports that the analysis pages show: computed by a process of their own, because that may take
minutes, and kept as long as they say what the database says.

A report is known by a hash of everything in the database that it could depend on. In the folder of
a study's reports, `<key>/` is a report, complete once its sums are there, and `<key>.log` is what
the process that computes it has printed: lines of its progress, and at last why it failed.
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
from sessions.models import StateChunk
from surveys.models import Questionnaire, Response

STALE_SECONDS = 120.0  # a process that has printed nothing for so long is gone
KEPT = 6  # reports a study
_started: dict[Path, "subprocess.Popen[bytes]"] = {}  # by log: those that this process started


class NotComputedError(RuntimeError):
    """The report could not be made; says why."""


@dataclass(frozen=True)
class Computing:
    """A report that is being computed; there is no progress before its process has begun."""

    key: str
    progress: ReportProgress | None = None


@dataclass(frozen=True)
class Stored:
    """A report on disk; `key` names it in addresses."""

    key: str
    folder: Path

    @property
    def computed_at(self) -> datetime.datetime:
        """When it was made."""
        return datetime.datetime.fromtimestamp(
            (self.folder / "SHA256SUMS").stat().st_mtime, datetime.UTC
        )

    @property
    def selections(self) -> tuple[str, ...]:
        """The drives that count, and the sensitivity analysis where something is excluded."""
        return tuple(name for name in (COUNTING, EVERY) if (self.folder / name).is_dir())

    def read(self, selection: str, name: str) -> Any:
        """Return a file of the page (experiments/analysis/page.py)."""
        return json.loads(
            (self.folder / selection / PAGE / f"{name}.json").read_text(encoding="utf-8")
        )


def key_of(study: Study, kinds: Sequence[Kind]) -> str:
    """Return the hash of all that a report depends on: nothing that it shows can change without one
    of these changing.
    """
    people = Participant.objects.filter(study=study).order_by("pk")
    drives = Drive.objects.filter(participant__study=study).order_by("pk")
    definition = study.as_definition()
    answers = Response.objects.filter(user__participations__study=study).order_by("pk").distinct()
    about = (
        list(
            people.values_list("pk", "kind", "status", "stage", "cell", "step", "age", "completion")
        ),
        list(
            drives.values_list(
                "pk",
                "outcome",
                "settled_at",
                "excluded_reason",
                "session__ended_at",
                "session__closed_at",
                "session__outcome",
            )
        ),
        list(answers.values_list("pk", "seen_at", "finished_at")),
        StateChunk.objects.filter(
            session__drive__participant__study=study, session__closed_at=None
        ).count(),
        list(
            StepVisit.objects.filter(participant__study=study)
            .aggregate(n=Count("pk"), began=Max("began_at"), ended=Max("finished_at"))
            .items()
        ),
        list(Questionnaire.objects.order_by("pk").values_list("pk", "sha256")),
        robots_of(definition, drives.values_list("session__robot__name", flat=True)),
        plans_of(definition),
        (study.sha256, study.published_at, study.deviations, VERSION, LAYOUT, sorted(kinds)),
    )
    return hashlib.sha256(repr(about).encode()).hexdigest()[:24]


def found(study: Study, key: str) -> Stored | None:
    """Return a report that is there."""
    folder = home(study) / key
    return Stored(key, folder) if key.isalnum() and (folder / "SHA256SUMS").is_file() else None


def report_for(study: Study, kinds: Sequence[Kind], followed: str = "") -> Stored | Computing:
    """Return the report on what is in the database now, or how far its computation is, which is
    started if need be. A page that shows or waits for a report already names it by its key
    (`followed`), so that it does not change while participants take part.

    Raises:
        NotComputedError: it could not be computed; the next call tries again.
    """
    if followed.isalnum():
        known = _finished(study, followed) or _computing(study, followed)
        if known is not None:
            return known
    key = key_of(study, kinds)
    return _finished(study, key) or _computing(study, key) or _start(study, key, kinds)


def _finished(study: Study, key: str) -> Stored | None:
    there = found(study, key)
    if there is not None:
        _drop(home(study) / f"{key}.log")
    return there


def _computing(study: Study, key: str) -> Computing | Stored | None:
    log = home(study) / f"{key}.log"
    try:
        lines, last = log.read_text().splitlines(), log.stat().st_mtime
    except FileNotFoundError:
        return None
    process = _started.get(log)
    is_over = process.poll() is not None if process else time.time() - last > STALE_SECONDS
    told = [line for line in lines if line[:1] + line[-1:] == "{}"]
    if not is_over:
        return Computing(key, msgspec.json.decode(told[-1], type=ReportProgress) if told else None)
    _drop(log)
    if there := found(study, key):  # it has finished since the caller looked
        return there
    errors = [line for line in lines if line not in told]
    raise NotComputedError(errors[-1] if errors else "The computation was interrupted.")


def _drop(log: Path) -> None:
    _started.pop(log, None)
    log.unlink(missing_ok=True)


def _start(study: Study, key: str, kinds: Sequence[Kind]) -> Computing:
    _forget_old(study)
    folder, log = home(study) / key, home(study) / f"{key}.log"
    folder.parent.mkdir(parents=True, exist_ok=True)
    options = [word for kind in kinds for word in ("--kind", kind)]
    words = ("analyse_study", f"{study.slug}:{study.version}", "--out", str(folder), "--page")
    try:
        output = log.open("xb")
    except FileExistsError:  # another request has started it
        return Computing(key)
    with output:
        shutil.rmtree(folder, ignore_errors=True)
        _started[log] = subprocess.Popen(
            command(*words, "--progress", *options),
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
    return Computing(key)


def command(*words: str) -> list[str]:
    """Return the words by which a command of the site is run, at low priority where the system
    knows that.
    """
    polite = [nice, "-n", "10"] if (nice := shutil.which("nice")) else []
    return [*polite, sys.executable, str(Path(settings.BASE_DIR) / "manage.py"), *words]


def environment() -> dict[str, str]:
    """Return the environment in which a command sees the same database as this process."""
    own = connection.settings_dict
    same = {"DATABASE_URL": f"sqlite:///{own['NAME']}"} if connection.vendor == "sqlite" else {}
    return os.environ | {"VAR_DIR": str(settings.VAR_DIR)} | same


def _forget_old(study: Study) -> None:
    reports = list(home(study).glob("*/SHA256SUMS"))
    for path in sorted(reports, key=lambda one: one.stat().st_mtime, reverse=True)[KEPT - 1 :]:
        shutil.rmtree(path.parent, ignore_errors=True)
