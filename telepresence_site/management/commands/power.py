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
    help = "Estimate the power of the declared analyses, and the number of participants needed."

    def add_arguments(self, parser: ArgumentParser) -> None:
        add = parser.add_argument
        add("study", help="name of the study, or name:version")
        participants = "numbers of participants, separated by commas [16,24,32,48,64]"
        add("--participants", type=_sizes, default=SIZES, help=participants)
        studies = f"studies to simulate for each number [{STUDIES}]"
        add("--studies", type=int, default=STUDIES, help=studies)
        add("--seed", type=int, default=1, help="random seed [1]")
        add("--json", action="store_true", help="write the table as JSON")

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
    """Return the orders of each set of conditions that a participant can have; its key has the
    conditions in the order of the study.
    """
    found: dict[tuple[str, ...], list[tuple[str, ...]]] = {}
    keys = [condition.key for condition in study.conditions]
    for access in ("open", "invitation"):
        for cell in cells(study, access):
            own = tuple(sorted(cell.conditions, key=keys.index))
            found.setdefault(own, []).append(cell.conditions)
    return found


def as_json(table: Table) -> str:
    rows = [[cell.text for cell in row] for row in table.rows]
    return json.dumps({"head": table.head, "rows": rows, "notes": table.notes}, ensure_ascii=False)


def as_text(table: Table) -> str:
    rows = [table.head, *([cell.text for cell in row] for row in table.rows)]
    widths = [max(len(row[n]) for row in rows) for n in range(len(table.head))]
    lines = [
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    return "\n".join((*lines, "", *table.notes))
