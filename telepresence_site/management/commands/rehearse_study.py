"""`manage.py rehearse_study STUDY`: bots play a draft through every condition and branch, and what
they find is kept with it.
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
from experiments.definition.schema import StudyDefinition
from experiments.models import Study
from experiments.rehearsal import plan, runs
from experiments.rehearsal.report import ConditionReport, RehearsalReport
from robots.processes import interrupted_by_signals
from telepresence_site.rehearsal.play import PROGRESS, Orders, PlayFailed, play
from telepresence_site.rehearsal.room import sandbox_folder
from telepresence_site.rehearsal.signing import patiently, signed

NICE = 10  # behind everything that somebody drives with


class Command(BaseCommand):
    """Rehearse a study."""

    help = (
        "Let bots take part in a study in a sandbox, through every "
        "condition, branch and door state, and store the report with the "
        "study."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("study", help="name of the study, or name:version")
        parser.add_argument(
            "--seed",
            type=int,
            default=plan.SEED,
            metavar="S",
            help="seed for everything that the bots decide",
        )
        parser.add_argument(
            "--speed",
            type=float,
            default=plan.SPEED,
            metavar="X",
            help="at most this many times faster than real time (default 10)",
        )
        parser.add_argument(
            "--each",
            type=int,
            default=plan.EACH,
            metavar="N",
            help="bots that go through each condition to the end (default 2)",
        )
        parser.add_argument("--report", type=Path, help="a file for the report, as JSON")
        parser.add_argument(
            "--requested",
            type=UUID,
            metavar="ID",
            help="ID of a rehearsal that was started from a page; set by run_practice",
        )

    def handle(self, *_args: Any, **options: Any) -> None:
        study, key = named_draft(options["study"]), options["requested"]
        try:
            key = key or runs.begin(study, socket.gethostname(), timezone.now()).pk
        except runs.AlreadyRehearsedError:
            raise CommandError("The study is being rehearsed: see its page.") from None
        if options["requested"]:
            os.nice(NICE)
        # it may have been changed since somebody asked; what is played is in memory from here on
        runs.sign(key, timezone.now(), sha256=study.sha256)
        found = (*problems(study.as_definition()), *plan.problems(study.as_definition()))
        wrong = [str(problem) for problem in found]
        if wrong:
            runs.fail(key, " ".join(wrong))
            raise CommandError("\n".join(["The study cannot be rehearsed as it is:", *wrong]))
        orders = orders_for(
            study.as_definition(), options["each"], options["seed"], options["speed"]
        )
        try:
            with (
                interrupted_by_signals(),
                sandbox_folder(study.slug) as folder,
                signed(key, folder / PROGRESS),
            ):
                played = play(study, orders, folder, self.stdout.write)
        except (PlayFailed, OSError, KeyboardInterrupt) as error:
            reason = str(error) or "Stopped before the rehearsal finished."
            patiently(lambda: runs.fail(key, reason))
            raise CommandError(reason) from error
        patiently(lambda: runs.finish(key, played.report))
        self._tell(played.report, options["report"])

    def _tell(self, report: RehearsalReport, file: Path | None) -> None:
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
    """Return the version that is named, else the newest, which is the draft where there is one.

    Raises:
        CommandError: there is none.
    """
    slug, _, version = text.partition(":")
    rows = Study.objects.filter(slug=slug).order_by("-version")
    found = (rows.filter(version=int(version)) if version.isdigit() else rows).first()
    if found is None:
        raise CommandError(f"There is no study {text!r}.")
    return found


def orders_for(definition: StudyDefinition, each: int, seed: int, speed: float) -> Orders:
    """Return what goes through every cell so many times, answers every list with each of its
    options, and leaves in a few other ways.
    """
    endings = [str(ending) for ending in plan.endings(definition, each)]
    return Orders(endings, seed, speed, explore=True, sites=str(settings.VAR_DIR / "sites"))


def line_of(one: ConditionReport) -> str:
    """Return a condition's report in one line."""
    took = (
        f"{one.median_seconds / 60.0:.1f} min by bots, about {one.expected_minutes:g} by people"
        if one.median_seconds
        else "no bot finished"
    )
    return (
        f"{one.key:<24} {one.completed} of {one.drives} completed; {took}; limit"
        f" {one.limit_minutes:g} min"
    )
