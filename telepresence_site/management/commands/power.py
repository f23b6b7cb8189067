"""`manage.py power STUDY`: how many participants a study needs, by simulation."""

import json
from argparse import ArgumentParser, ArgumentTypeError
from typing import Any

from django.core.management import BaseCommand, CommandError

from experiments.analysis.power.search import STUDIES, PowerOptions, power_report, power_table
from experiments.analysis.tables.table import Table
from experiments.definition.schema import StudyDefinition
from experiments.management.study_lookup import study_named
from experiments.participation.assignment import cells

SIZES = (16, 24, 32, 48, 64)
MOST_PARTICIPANTS, MOST_STUDIES = 5000, 100_000


def _sizes(text: str) -> list[int]:
    try:
        found = [int(word) for word in text.split(",")]
    except ValueError as error:
        raise ArgumentTypeError(f"{text!r} is not a list of numbers such as 20,40") from error
    if not all(1 <= one <= MOST_PARTICIPANTS for one in found):
        raise ArgumentTypeError(f"give numbers from 1 to {MOST_PARTICIPANTS}")
    return found


class Command(BaseCommand):
    """Simulates a study with the statistics that will analyse it."""

    help = "Estimate the power of the declared analyses, and the number of participants needed."

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("study", help="name of the study, or name:version")
        parser.add_argument(
            "--participants",
            type=_sizes,
            default=SIZES,
            help="numbers of participants, separated by commas [16,24,32,48,64]",
        )
        parser.add_argument(
            "--studies",
            type=int,
            default=STUDIES,
            help=f"studies to simulate for each number [{STUDIES}]",
        )
        parser.add_argument("--seed", type=int, default=1, help="random seed [1]")
        parser.add_argument("--json", action="store_true", help="write the table as JSON")

    def handle(self, *_args: Any, **options: Any) -> None:
        study = study_named(options["study"]).as_definition()
        if not study.analyses:
            raise CommandError("The study declares no analysis: there is nothing to simulate.")
        if not 1 <= options["studies"] <= MOST_STUDIES:
            raise CommandError(f"Give --studies from 1 to {MOST_STUDIES}.")
        how = PowerOptions(options["seed"], options["studies"], _orders(study))
        found = power_report(study, options["participants"], how)
        table = power_table(study, found, how.studies)
        self.stdout.write(as_json(table) if options["json"] else as_text(table))


def _orders(study: StudyDefinition) -> dict[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the orders of conditions by the conditions of a participant, as the study has them."""
    found: dict[tuple[str, ...], list[tuple[str, ...]]] = {}
    written = {condition.key: place for place, condition in enumerate(study.conditions)}
    for access in ("open", "invitation"):
        for cell in cells(study, access):
            own = tuple(sorted(cell.conditions, key=lambda key: written[key]))
            found.setdefault(own, []).append(cell.conditions)
    return found


def as_json(table: Table) -> str:
    """Return a table as JSON: its head, rows of texts, and notes."""
    rows = [[cell.text for cell in row] for row in table.rows]
    return json.dumps({"head": table.head, "rows": rows, "notes": table.notes}, ensure_ascii=False)


def as_text(table: Table) -> str:
    """Return a table as lines of columns, with its notes below."""
    rows = [table.head, *([cell.text for cell in row] for row in table.rows)]
    widths = [max(len(row[n]) for row in rows) for n in range(len(table.head))]
    lines = [
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    return "\n".join((*lines, "", *table.notes))
