"""A play of bots in a sandbox: orders in a file, a process that carries them out at its own pace,
findings in a file.

The first half runs in the process that a command was given to, at real time and beside the site;
the second in the one that it starts.
"""

import asyncio
import collections
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from itertools import cycle, zip_longest
from pathlib import Path
from typing import Any

import msgspec
from django.conf import settings
from django.db import connection
from django.utils import timezone

from experiments.bots.crowd import BotGroup, Plan
from experiments.bots.diary import Diary
from experiments.bots.endings import ABOUT_PHOTO, Ending
from experiments.bots.pace import Pace, own_pace
from experiments.bots.persona import effect
from experiments.definition.schema import Condition, StudyDefinition
from experiments.export.archive import unpacked
from experiments.export.files import export_files
from experiments.extraction.selection import Selection
from experiments.models import Drive, ParticipantKind, Study
from experiments.participation import links
from experiments.publishing import obstacles_here
from experiments.rehearsal import findings
from experiments.rehearsal.plan import AT_ONCE, problems
from experiments.rehearsal.report import RehearsalReport, judge
from robots.processes import tied_to_parent
from telepresence_site.children import STOP_SECONDS
from telepresence_site.rehearsal import sandbox

ORDERS, PROGRESS, FINDINGS, PACE = "orders.json", "progress.json", "findings.json", "pace"
SETTLE_SECONDS = 120.0
PROGRESS_SECONDS = 2.0
END_SECONDS = 2 * STOP_SECONDS


class PlayFailed(Exception):
    """There is no such sandbox, it did not come up, or it ended early; one sentence."""


@dataclass(frozen=True)
class Orders:
    """What is to be played. `endings` are values of Ending, `effects` as they are written on a
    command line; `dataset` is the folder for what was recorded, empty for none.
    """

    endings: list[str]
    seed: int
    speed: float
    at_once: int = AT_ONCE
    effects: list[str] = field(default_factory=list)
    explore: bool = False
    visits: int = 1
    sites: str = ""
    dataset: str = ""


@dataclass(frozen=True)
class Played:
    """What came of it: a report on the study, and the bots' diaries as data."""

    report: RehearsalReport
    diaries: list[dict[str, Any]]
    seconds: float
    real_seconds: float


# --- beside the site ------------------------------------------------------------------------------


def play(
    study: Study, orders: Orders, folder: Path, told: Callable[[str], None] = lambda _line: None
) -> Played:
    """Play a study in a sandbox and return what was found; `told` hears of each bot.

    Raises:
        PlayFailed: there cannot be such a sandbox, it did not come up, or its process ended early.
    """
    wrong = problems(study.as_definition())
    if wrong:
        raise PlayFailed(" ".join(wrong))
    sandbox.pack(study, folder)
    (folder / ORDERS).write_text(json.dumps(asdict(orders)), encoding="utf-8")
    pace = Pace(folder / PACE)
    environment = pace.environment(
        sandbox.environment(
            folder, {**os.environ, "DJANGO_SETTINGS_MODULE": "telepresence_site.settings"}
        )
    )
    command = [sys.executable, str(settings.BASE_DIR / "manage.py"), "play_in_sandbox"]
    process = subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        preexec_fn=tied_to_parent(),
    )
    last = ""
    try:
        for line in process.stdout or ():
            last = line.strip() or last
            told(line.rstrip())
    finally:
        _end(process)
    if process.returncode != 0 or not (folder / FINDINGS).exists():
        raise PlayFailed(
            f"The sandbox ended: {last or 'it said nothing'} (its logs: {folder / 'log'})"
        )
    return msgspec.json.decode((folder / FINDINGS).read_bytes(), type=Played)


def _end(process: "subprocess.Popen[str]") -> None:
    """End the sandbox's process, whose own children end before it, or with it when it does not
    listen.
    """
    if process.poll() is None:
        process.terminate()
    try:
        process.wait(END_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


# --- in the sandbox -------------------------------------------------------------------------------


def carry_out(told: Callable[[str], None]) -> None:
    """Do what the orders in this process's VAR_DIR say, and leave the findings there."""
    orders = Orders(**json.loads((settings.VAR_DIR / ORDERS).read_text(encoding="utf-8")))
    study = sandbox.unpack()
    pace = own_pace()
    if pace is None:
        raise PlayFailed("this command is started by run_bots and rehearse_study only")
    with sandbox.running(study.as_definition(), Path(orders.sites)) as site:
        began, quick = pace.real(), timezone.now()
        diaries, report = _perform(study, orders, site, told, pace)
        seconds, real = (timezone.now() - quick).total_seconds(), pace.real() - began
    played = Played(report, [asdict(diary) for diary in diaries], seconds, real)
    (settings.VAR_DIR / FINDINGS).write_bytes(msgspec.json.encode(played))


def _perform(
    study: Study, orders: Orders, site: str, told: Callable[[str], None], pace: Pace
) -> tuple[list[Diary], RehearsalReport]:
    """Let the bots play, unless what the sandbox has makes it impossible."""
    definition = study.as_definition()
    wrong = obstacles_here(definition)
    if wrong:
        return [], RehearsalReport(0, problems=[str(problem) for problem in wrong])
    done: list[Diary] = []

    def heard(diary: Diary) -> None:
        told(line_of(diary))
        done.append(diary)

    with _noted_progress(study, orders, done):
        diaries = asyncio.run(crowd_of(study, orders, site, heard, pace).run())
    _settle(study)
    pace.set(1.0)
    if orders.dataset:
        collections.deque(unpacked(export_files(study, Selection()), Path(orders.dataset)), 0)
    return diaries, judge(definition, diaries, findings.findings(study))


@contextmanager
def _noted_progress(study: Study, orders: Orders, done: Sequence[Diary]) -> Iterator[None]:
    """Inside, write to a file beside the orders how far the play is, every PROGRESS_SECONDS."""
    ended = threading.Event()

    def keep_noting() -> None:
        while not ended.wait(PROGRESS_SECONDS):
            _note_progress(study, orders, len(done))
        connection.close()

    _note_progress(study, orders, 0)
    thread = threading.Thread(target=keep_noting, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        _note_progress(study, orders, len(done))


def _note_progress(study: Study, orders: Orders, bots: int) -> None:
    definition = study.as_definition()
    drives = Drive.objects.filter(participant__study=study).exclude(outcome="")
    drives = drives.exclude(step__in=definition.practice_keys)
    progress = {
        "drives": drives.count(),
        "conditions": drives.order_by().values("condition").distinct().count(),
        "of_conditions": len(definition.conditions),
        "bots": bots,
        "of_bots": len(orders.endings),
    }
    new = settings.VAR_DIR / f"{PROGRESS}.new"
    new.write_text(json.dumps(progress), encoding="utf-8")
    new.replace(settings.VAR_DIR / PROGRESS)


def crowd_of(
    study: Study,
    orders: Orders,
    site: str,
    heard: Callable[[Diary], None],
    pace: Pace | None = None,
) -> BotGroup:
    """Return the bots of some orders, each with a link of its own: to open conditions and to those
    by invitation in turn.
    """
    endings = [Ending(name) for name in orders.endings]
    effects = [effect(text) for text in orders.effects]
    plan = Plan(
        site,
        bot_links(study, endings),
        endings,
        orders.seed,
        orders.at_once,
        effects,
        orders.explore,
        orders.visits,
    )
    return BotGroup(plan, heard, pace, orders.speed)


def bot_links(study: Study, endings: Sequence[Ending]) -> list[str]:
    """Make links that make bots of who redeems them, one for each ending, and return their paths:
    no other way leads to being a bot.
    """
    now = timezone.now()
    ways = ways_in(study.as_definition(), endings)
    made = [
        links.make(study, label=f"bot {number}", access=way, kind=ParticipantKind.BOT, now=now)
        for number, way in enumerate(ways)
    ]
    return [f"/studies/link/{token}/" for _row, token in made]


def ways_in(definition: StudyDefinition, endings: Sequence[Ending]) -> list[str]:
    """Return how each bot comes in: as often by each way as there are conditions for it, and by
    turns, so that no robot waits long.

    Whose ending is about the photo comes by a way on which there is one.
    """
    with_photo = [
        one
        for one in definition.conditions
        if (course := definition.course_of(one)) is not None and course.photo is not None
    ]
    usual, photo = (
        cycle(_by_turns(definition.conditions)),
        cycle(_by_turns(with_photo or definition.conditions)),
    )
    return [next(photo if ending in ABOUT_PHOTO else usual) for ending in endings]


def _by_turns(conditions: Sequence[Condition]) -> list[str]:
    ways = ("open", "invitation")
    rows = [[one.access for one in conditions if one.access == way] for way in ways]
    return [way for pair in zip_longest(*rows) for way in pair if way is not None] or ["open"]


def line_of(diary: Diary) -> str:
    """Return a bot's diary in one line."""
    drives = (
        ", ".join(
            f"{leg.outcome or leg.reason or 'no drive'} in {leg.seconds:.0f} s"
            for leg in diary.legs
        )
        or "no drive"
    )
    return (
        f"bot {diary.number:3} {diary.ending:<22}"
        f" {drives}{' · stuck: ' + diary.stuck if diary.stuck else ''}"
    )


def _settle(study: Study) -> None:
    """Wait until the session manager has settled the last drives."""
    deadline = time.monotonic() + SETTLE_SECONDS
    while (
        Drive.objects.filter(participant__study=study, settled_at=None).exists()
        and time.monotonic() < deadline
    ):
        time.sleep(1.0)
