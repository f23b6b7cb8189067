"""Reports that the analysis page shows, kept as long as they say what the database says.

A report is known by a hash of everything in the database that it could depend on. It is made by a
process of its own, because half a minute of computing in the web process would delay the commands
of whoever drives; whoever asks for one that is being made waits for it.
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

from django.conf import settings
from django.db import connection
from django.db.models import Count, Max

from experiments.analysis.dataset.levels import Kind
from experiments.analysis.dataset.records import COUNTING, EVERY
from experiments.analysis.metrics.definitions import VERSION
from experiments.analysis.page import LAYOUT, PAGE
from experiments.export.reports import home
from experiments.models import Drive, Participant, StepVisit, Study
from sessions.models import StateChunk
from surveys.models import Questionnaire, Response

SECONDS = 180.0  # after so long a computation has failed
KEPT = 6  # reports a study
LOOK_AGAIN = 0.2


class NotComputedError(RuntimeError):
    """The report could not be made; says why."""


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
        (study.sha256, study.published_at, study.deviations, VERSION, LAYOUT, sorted(kinds)),
    )
    return hashlib.sha256(repr(about).encode()).hexdigest()[:24]


def found(study: Study, key: str) -> Stored | None:
    """Return a report that is there."""
    folder = home(study) / key
    return Stored(key, folder) if key.isalnum() and (folder / "SHA256SUMS").is_file() else None


def fresh(study: Study, kinds: Sequence[Kind]) -> Stored:
    """Return the report on what is in the database now, made if need be.

    Raises:
        NotComputedError: it could not be made.
    """
    key = key_of(study, kinds)
    there = found(study, key)
    if there is not None:
        return there
    lock = home(study) / f"{key}.lock"
    lock.parent.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + SECONDS
    while not _taken(lock):
        if time.monotonic() > deadline:
            raise NotComputedError(
                "Another computation of the same analysis has not finished. Try again later."
            )
        time.sleep(LOOK_AGAIN)
        there = found(study, key)
        if there is not None:
            return there
    try:
        return _made(study, key, kinds)
    finally:
        lock.rmdir()


def _taken(lock: Path) -> bool:
    """A folder can be made once; that of a process that died is too old to count."""
    try:
        lock.mkdir()
    except FileExistsError:
        return _took_over(lock)
    return True


def _took_over(lock: Path) -> bool:
    try:
        is_old = time.time() - lock.stat().st_mtime > SECONDS
        if is_old:
            lock.touch()
    except FileNotFoundError:  # given back meanwhile
        return False
    return is_old


def _made(study: Study, key: str, kinds: Sequence[Kind]) -> Stored:
    partial = home(study) / f"{key}.partial"
    shutil.rmtree(partial, ignore_errors=True)
    options = [word for kind in kinds for word in ("--kind", kind)]
    run_command(
        "analyse_study", f"{study.slug}:{study.version}", "--out", str(partial), "--page", *options
    )
    final = home(study) / key
    shutil.rmtree(final, ignore_errors=True)
    partial.rename(final)
    _forget_old(study)
    return Stored(key, final)


def run_command(*words: str) -> None:
    """Run a command of the site in a process of its own.

    Raises:
        NotComputedError: it failed, or took too long.
    """
    try:
        subprocess.run(
            command(*words),
            env=environment(),
            check=True,
            capture_output=True,
            timeout=SECONDS,
            text=True,
        )
    except subprocess.TimeoutExpired as error:
        raise NotComputedError(f"The analysis took longer than {SECONDS:.0f} s.") from error
    except subprocess.CalledProcessError as error:
        raise NotComputedError((error.stderr or "").strip().rpartition("\n")[2]) from error


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
    reports = [path for path in home(study).iterdir() if (path / "SHA256SUMS").is_file()]
    for path in sorted(reports, key=lambda one: one.stat().st_mtime, reverse=True)[KEPT:]:
        shutil.rmtree(path, ignore_errors=True)
