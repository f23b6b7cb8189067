"""`manage.py rehearse_study STUDY`: bots play a draft through every condition and branch, and their
report is stored with it.
"""

import json
import os
import socket
from argparse import ArgumentParser
from dataclasses import asdict
from pathlib import Path
from typing import Any
from uuid import UUID

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError
from django.utils import timezone

from experiments.definition.problems import problems
from experiments.models import Study
from experiments.rehearsal import plan, runs
from experiments.rehearsal.report import ConditionReport, RehearsalReport
from robots.process.ending import interrupted_by_signals
from telepresence_site.rehearsal.heartbeat import heartbeats, retry_until_written
from telepresence_site.rehearsal.play import PROGRESS, Orders, PlayFailed, play
from telepresence_site.rehearsal.sandbox import sandbox_folder

NICE = 10  # lower priority than everything that visitors drive with


class Command(BaseCommand):
    help = (
        "Let bots take part in a study in a sandbox, through every "
        "condition, branch and door state, and store the report with the "
        "study."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        add = parser.add_argument
        add("study", help="name of the study, or name:version")
        seed = "seed for everything that the bots decide"
        add("--seed", type=int, default=plan.SEED, metavar="S", help=seed)
        speed = "at most this many times faster than real time (default 10)"
        add("--speed", type=float, default=plan.SPEED, metavar="X", help=speed)
        each = "bots that go through each condition to the end (default 2)"
        add("--each", type=int, default=plan.EACH, metavar="N", help=each)
        add("--report", type=Path, help="a file for the report, as JSON")
        requested = "ID of a rehearsal that was started from a page; set by run_practice"
        add("--requested", type=UUID, metavar="ID", help=requested)

    def handle(self, *_args: Any, **options: Any) -> None:
        study, key = named_draft(options["study"]), options["requested"]
        try:
            key = key or runs.begin(study, socket.gethostname(), timezone.now()).pk
        except runs.AlreadyRehearsedError:
            raise CommandError("The study is being rehearsed: see its page.") from None
        if options["requested"]:
            os.nice(NICE)
        # The draft may have changed since the request; from here on it is in memory.
        runs.sign(key, timezone.now(), sha256=study.sha256)
        found = (*problems(study.as_definition()), *plan.problems(study.as_definition()))
        wrong = [str(problem) for problem in found]
        if wrong:
            runs.fail(key, " ".join(wrong))
            raise CommandError("\n".join(["The study cannot be rehearsed as it is:", *wrong]))
        # through every cell, with every option of every list, and a few other endings
        endings = [str(ending) for ending in plan.endings(study.as_definition(), options["each"])]
        sites = str(settings.VAR_DIR / "sites")
        orders = Orders(endings, options["seed"], options["speed"], explore=True, sites=sites)
        try:
            with (
                interrupted_by_signals(),
                sandbox_folder(study.slug) as folder,
                heartbeats(key, folder / PROGRESS),
            ):
                played = play(study, orders, folder, self.stdout.write)
        except (PlayFailed, OSError, KeyboardInterrupt) as error:
            reason = str(error) or "Stopped before the rehearsal finished."
            retry_until_written(lambda: runs.fail(key, reason))
            raise CommandError(reason) from error
        retry_until_written(lambda: runs.finish(key, played.report))
        self._print(played.report, options["report"])

    def _print(self, report: RehearsalReport, file: Path | None) -> None:
        if file is not None:
            file.write_text(json.dumps(asdict(report), indent=1), encoding="utf-8")
        for one in report.conditions:
            self.stdout.write(line_of(one))
        self.stdout.write(f"A participant needs about {report.expected_minutes:g} minutes.")
        for need in report.power:
            self.stdout.write(
                f"A difference of {need['effect']:g} standard deviations needs "
                f"{need['total']:g} participants (80 % power)."
            )
        for sentence in report.notes:
            self.stdout.write(f"  note: {sentence}")
        for sentence in report.problems:
            self.stdout.write(f"  problem: {sentence}")
        if not report.passed:
            raise CommandError("The rehearsal did not pass: see the problems above.")
        self.stdout.write("The rehearsal passed.")


def named_draft(text: str) -> Study:
    """Return the version named `slug:version`, or the newest, which is the draft if there is one.

    Raises:
        CommandError: there is none.
    """
    slug, _, version = text.partition(":")
    rows = Study.objects.filter(slug=slug).order_by("-version")
    found = (rows.filter(version=int(version)) if version.isdigit() else rows).first()
    if found is None:
        raise CommandError(f"There is no study {text!r}.")
    return found


def line_of(one: ConditionReport) -> str:
    took = (
        f"{one.median_seconds / 60.0:.1f} min by bots, about {one.expected_minutes:g} by people"
        if one.median_seconds
        else "no bot finished"
    )
    return (
        f"{one.key:<24} {one.completed} of {one.drives} completed; {took}; limit"
        f" {one.limit_minutes:g} min"
    )
