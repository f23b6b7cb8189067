"""`manage.py run_bots STUDY`: scripted participants take part, in real time on this site or many
times faster in a sandbox.
"""

import asyncio
import json
from argparse import ArgumentParser
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from django.conf import settings
from django.core.management.base import BaseCommand, CommandError

from experiments.bots.endings import Ending, draw, in_turn
from experiments.bots.persona import EffectError, effect
from experiments.management.study_lookup import study_named
from experiments.models import Study
from robots.process.ending import ended_by_signals, interrupted_by_signals
from telepresence_site.rehearsal.play import Orders, PlayFailed, crowd_of, line_of, play
from telepresence_site.rehearsal.sandbox import sandbox_folder

FASTEST = 50.0


class Command(BaseCommand):
    help = (
        "Let bots take part in a study: with --url on a running site, with "
        "--speed in a sandbox that runs faster than real time."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        add = parser.add_argument
        add("study", help="name of the study, or name:version")
        for name, default, metavar, text in (
            ("--participants", 2, "N", "how many bots (default 2)"),
            ("--seed", 1, "S", "seed for everything that the bots decide"),
            ("--at-once", 2, "K", "how many take part at a time (default 2)"),
            ("--visits", 1, "V", "how often each of them takes part (default once)"),
        ):
            add(name, type=int, default=default, metavar=metavar, help=text)
        speed = "in a sandbox, at most this many times faster than real time"
        add("--speed", type=float, metavar="X", help=speed)
        url = "the site where they take part, which must use this database"
        add("--url", default="http://127.0.0.1:8000", help=url)
        ends = "how bots end: usual, every, or names separated by commas: " + ", ".join(Ending)
        add("--endings", default="usual", help=ends)
        shifts = (
            "shift answers: question@circumstance=value:size, such as easy@assist=steer:0.8;"
            " separate several circumstances by commas"
        )
        add("--effect", action="append", default=[], metavar="E", help=shifts)
        folder = "with --speed, a new folder for the dataset of the bots"
        add("--dataset", type=Path, metavar="DIR", help=folder)
        add("--report", type=Path, help="a file for the bots' diaries, as JSON")

    def handle(self, *_args: Any, **options: Any) -> None:
        study, orders = study_named(options["study"]), _orders(options)
        diaries = (
            self._on_site(study, orders, options["url"])
            if options["speed"] is None
            else self._in_sandbox(study, orders)
        )
        if options["report"] is not None:
            options["report"].write_text(json.dumps(diaries, indent=1), encoding="utf-8")
        stuck = sum(1 for diary in diaries if diary["stuck"])
        self.stdout.write(f"{len(diaries)} bots, {stuck} of them stuck.")
        if stuck:
            raise CommandError("Some bots got stuck in the study; see above.")

    def _on_site(self, study: Study, orders: Orders, url: str) -> list[dict[str, Any]]:
        if study.status == Study.Status.CLOSED:
            raise CommandError("The study is closed: it accepts no new participants.")
        # A bot waits minutes for a site that does not answer, and there is nothing to clean up.
        with ended_by_signals():
            bots = crowd_of(study, orders, url, lambda one: self.stdout.write(line_of(one)))
            diaries = asyncio.run(bots.run())
        return [asdict(diary) for diary in diaries]

    def _in_sandbox(self, study: Study, orders: Orders) -> list[dict[str, Any]]:
        with sandbox_folder(study.slug) as folder:
            try:
                with interrupted_by_signals():
                    played = play(study, orders, folder, self.stdout.write)
            except (PlayFailed, KeyboardInterrupt) as error:
                raise CommandError(str(error) or "Stopped before the bots finished.") from error
        for sentence in played.report.problems:
            self.stdout.write(f"  {sentence}")
        simulated, real = played.seconds / 60.0, played.real_seconds / 60.0
        self.stdout.write(
            f"{simulated:.1f} simulated minutes took {real:.1f} real ones:"
            f" {simulated / max(real, 1e-6):.1f} times real time."
        )
        return played.diaries


def _orders(options: dict[str, Any]) -> Orders:
    speed = options["speed"] or 1.0
    counts = (options["participants"], options["at_once"], options["visits"])
    if not 1.0 <= speed <= FASTEST or min(counts) < 1:
        raise CommandError(
            f"--speed takes 1 to {FASTEST:g}; --participants, --at-once and --visits at least 1."
        )
    dataset: Path | None = options["dataset"]
    if dataset is not None:
        if options["speed"] is None:
            raise CommandError(
                "--dataset works only in a sandbox: add --speed, or use export_study."
            )
        if dataset.exists() and (not dataset.is_dir() or any(dataset.iterdir())):
            raise CommandError(f"{dataset} already exists: choose another --dataset.")
    try:
        for text in options["effect"]:
            effect(text)
    except EffectError as error:
        raise CommandError(str(error)) from error
    endings = _endings(options["endings"], options["participants"], options["seed"])
    return Orders(
        [str(ending) for ending in endings],
        options["seed"],
        speed,
        options["at_once"],
        options["effect"],
        visits=options["visits"],
        sites=str(settings.VAR_DIR / "sites"),
        dataset="" if dataset is None else str(dataset.absolute()),
    )


def _endings(text: str, count: int, seed: int) -> list[Ending]:
    if text == "usual":
        return draw(count, np.random.default_rng(seed))
    if text == "every":
        return in_turn(count)
    try:
        return in_turn(count, [Ending(name.strip()) for name in text.split(",")])
    except ValueError as error:
        raise CommandError(f"{error}; choose from: {', '.join(Ending)}.") from error
