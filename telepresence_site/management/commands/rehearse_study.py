"""`manage.py rehearse_study STUDY`: bots play a draft through every condition and branch, and what
they find is kept with it.
"""

import json
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError
from django.utils import timezone

from experiments.bots.endings import Ending
from experiments.definition.problems import problems
from experiments.definition.schema import StudyDefinition
from experiments.models import Study
from experiments.rehearsal import findings
from experiments.rehearsal.report import ConditionReport, RehearsalReport
from robots.processes import interrupted_by_signals
from telepresence_site.rehearsal import sandbox
from telepresence_site.rehearsal.play import Orders, PlayFailed, play
from telepresence_site.rehearsal.room import sandbox_folder

ASIDE = (Ending.SKIPS_PHOTO, Ending.REFUSES, Ending.LEAVES_AT_DOCK, Ending.COMES_AGAIN)


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
            default=1,
            metavar="S",
            help="seed for everything that the bots decide",
        )
        parser.add_argument(
            "--speed",
            type=float,
            default=10.0,
            metavar="X",
            help="at most this many times faster than real time (default 10)",
        )
        parser.add_argument(
            "--each",
            type=int,
            default=2,
            metavar="N",
            help="bots that go through each condition to the end (default 2)",
        )
        parser.add_argument("--report", type=Path, help="a file for the report, as JSON")

    def handle(self, *_args: Any, **options: Any) -> None:
        study = named_draft(options["study"])
        rehearsal = findings.begin(study, timezone.now())
        wrong = [*problems(study.as_definition()), *sandbox.problems(study.as_definition())]
        if wrong:
            findings.keep(rehearsal, None, " ".join(wrong))
            raise CommandError("\n".join(["The study cannot be rehearsed as it is:", *wrong]))
        orders = orders_for(
            study.as_definition(), options["each"], options["seed"], options["speed"]
        )
        try:
            with interrupted_by_signals(), sandbox_folder(study.slug) as folder:
                played = play(study, orders, folder, self.stdout.write)
        except (PlayFailed, KeyboardInterrupt) as error:
            findings.keep(rehearsal, None, str(error) or "Stopped before the rehearsal finished.")
            raise CommandError(str(error) or "Stopped before the rehearsal finished.") from error
        findings.keep(rehearsal, played.report)
        self._tell(played.report, options["report"])

    def _tell(self, report: RehearsalReport, file: Path | None) -> None:
        if file is not None:
            file.write_text(json.dumps(report.as_data(), indent=1), encoding="utf-8")
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
    through = max(2, each) * max(1, len(definition.conditions))
    endings = [str(Ending.COMPLETES)] * through + [str(ending) for ending in ASIDE]
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
