"""Bots play a study in a sandbox. The first half of this module runs in a command's process, in
real time, and writes orders into a file. The second half runs in the process that it starts, which
carries them out at its own pace and writes findings into a file.
"""

import asyncio
import collections
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from itertools import cycle, zip_longest
from pathlib import Path
from typing import Any

import msgspec
from django.conf import settings
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
from experiments.rehearsal import findings
from experiments.rehearsal.plan import AT_ONCE, problems
from experiments.rehearsal.report import RehearsalReport, judge
from experiments.resources import obstacles_here
from robots.process.ending import tied_to_parent, wait_or_kill
from telepresence_site.children import STOP_SECONDS
from telepresence_site.rehearsal import sandbox
from telepresence_site.rehearsal.heartbeat import attempt, repeated

ORDERS, PROGRESS, FINDINGS, PACE = "orders.json", "progress.json", "findings.json", "pace"
SETTLE_SECONDS = 120.0
END_SECONDS = 2 * STOP_SECONDS


class PlayFailed(Exception):
    """The sandbox is impossible, did not start, or ended early; the message is one sentence."""


@dataclass(frozen=True)
class Orders:
    """What to play. `endings` are values of Ending, `effects` as on the command line; `dataset` is
    the folder for the recorded dataset, empty for none.
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
    """The result: a report on the study, the bots' diaries, simulated and real duration in s."""

    report: RehearsalReport
    diaries: list[dict[str, Any]]
    seconds: float
    real_seconds: float


# --- beside the site ------------------------------------------------------------------------------


def play(
    study: Study, orders: Orders, folder: Path, show: Callable[[str], None] = lambda _line: None
) -> Played:
    """Play a study in a sandbox and return the findings; `show` is called with a line for each bot.

    Raises:
        PlayFailed: the sandbox is impossible, did not start, or ended early.
    """
    wrong = problems(study.as_definition())
    if wrong:
        raise PlayFailed(" ".join(wrong))
    sandbox.pack(study, folder)
    (folder / ORDERS).write_text(json.dumps(asdict(orders)), encoding="utf-8")
    pace = Pace(folder / PACE)
    given = {**os.environ, "DJANGO_SETTINGS_MODULE": "telepresence_site.settings"}
    environment = pace.environment(sandbox.environment(folder, given))
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
            show(line.rstrip())
    finally:
        process.terminate()  # it ends its own children first; killed, they end with it
        wait_or_kill(process, END_SECONDS)
    if process.returncode != 0 or not (folder / FINDINGS).exists():
        raise PlayFailed(
            f"The sandbox ended: {last or 'it said nothing'} (its logs: {folder / 'log'})"
        )
    return msgspec.json.decode((folder / FINDINGS).read_bytes(), type=Played)


# --- in the sandbox -------------------------------------------------------------------------------


def carry_out(show: Callable[[str], None]) -> None:
    """Carry out the orders in this process's VAR_DIR, and write the findings there."""
    orders = Orders(**json.loads((settings.VAR_DIR / ORDERS).read_text(encoding="utf-8")))
    study = sandbox.unpack()
    pace = own_pace()
    if pace is None:
        raise PlayFailed("this command is started by run_bots and rehearse_study only")
    with sandbox.running(study.as_definition(), Path(orders.sites)) as site:
        began, quick = pace.real(), timezone.now()
        diaries, report = _perform(study, orders, site, show, pace)
        seconds, real = (timezone.now() - quick).total_seconds(), pace.real() - began
    played = Played(report, [asdict(diary) for diary in diaries], seconds, real)
    (settings.VAR_DIR / FINDINGS).write_bytes(msgspec.json.encode(played))


def _perform(
    study: Study, orders: Orders, site: str, show: Callable[[str], None], pace: Pace
) -> tuple[list[Diary], RehearsalReport]:
    """Let the bots play, unless the sandbox's robots and sites make the study impossible."""
    definition = study.as_definition()
    wrong = obstacles_here(definition)
    if wrong:
        return [], RehearsalReport(0, problems=[str(problem) for problem in wrong])
    done: list[Diary] = []

    def on_diary(diary: Diary) -> None:
        show(line_of(diary))
        done.append(diary)

    def note_progress(_ended: object = None) -> None:
        _note_progress(study, orders, len(done))

    note_progress()
    with repeated(note_progress):
        diaries = asyncio.run(crowd_of(study, orders, site, on_diary, pace).run())
    attempt(note_progress)
    _settle(study)
    pace.set(1.0)
    if orders.dataset:
        collections.deque(unpacked(export_files(study, Selection()), Path(orders.dataset)), 0)
    return diaries, judge(definition, diaries, findings.findings(study))


def _note_progress(study: Study, orders: Orders, bots: int) -> None:
    """Write how far the play is to a file beside the orders."""
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
    on_diary: Callable[[Diary], None],
    pace: Pace | None = None,
) -> BotGroup:
    """Return the bots of some orders, each with a link of its own, to open conditions and to those
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
    return BotGroup(plan, on_diary, pace, orders.speed)


def bot_links(study: Study, endings: Sequence[Ending]) -> list[str]:
    """Create a link for each ending and return their paths. Only participants who enter by such a
    link are bots.
    """
    paths, kind, now = [], ParticipantKind.BOT, timezone.now()
    for number, access in enumerate(accesses_of(study.as_definition(), endings)):
        _row, token = links.make(study, label=f"bot {number}", access=access, kind=kind, now=now)
        paths.append(f"/studies/link/{token}/")
    return paths


def accesses_of(definition: StudyDefinition, endings: Sequence[Ending]) -> list[str]:
    """Return each bot's access: each kind in proportion to its conditions, alternating so that no
    robot waits long. A bot whose ending is about the photo gets an access with a photo.
    """
    with_photo = [
        one
        for one in definition.conditions
        if (course := definition.course_of(one)) is not None and course.photo is not None
    ]
    usual = cycle(_alternating(definition.conditions))
    photo = cycle(_alternating(with_photo or definition.conditions))
    return [next(photo if ending in ABOUT_PHOTO else usual) for ending in endings]


def _alternating(conditions: Sequence[Condition]) -> list[str]:
    kinds = ("open", "invitation")
    rows = [[kind for one in conditions if one.access == kind] for kind in kinds]
    return [one for pair in zip_longest(*rows) for one in pair if one is not None] or ["open"]


def line_of(diary: Diary) -> str:
    drives = ", ".join(
        f"{leg.outcome or leg.reason or 'no drive'} in {leg.seconds:.0f} s" for leg in diary.legs
    )
    stuck = f" · stuck: {diary.stuck}" if diary.stuck else ""
    return f"bot {diary.number:3} {diary.ending:<22} {drives or 'no drive'}{stuck}"


def _settle(study: Study) -> None:
    """Wait until the session manager has settled the last drives."""
    deadline = time.monotonic() + SETTLE_SECONDS
    while (
        Drive.objects.filter(participant__study=study, settled_at=None).exists()
        and time.monotonic() < deadline
    ):
        time.sleep(1.0)
