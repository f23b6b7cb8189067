"""`manage.py import_questionnaire FILE`: a survey of another system as a questionnaire."""

from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.utils import timezone

from surveys.documents import BadDefinitionError
from surveys.importing.reading import MAX_FILE, ImportedSurvey, import_survey
from surveys.importing.report import ImportReport
from surveys.questionnaires import store_next


class Command(BaseCommand):
    help = (
        "Read a survey exported from Qualtrics (.qsf), LimeSurvey (.lss) or REDCap (data "
        "dictionary, .csv), and report what is imported, changed and not imported."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        add = parser.add_argument
        add("file", type=Path, help="the exported file")
        add("--save", action="store_true", help="store the questionnaire after the report")
        add("--name", default="", help="its name; default: made of its title")
        add("--language", default="en", help="language of the texts of a REDCap file")
        add("--form", default="", help="import only this form of a REDCap file")

    def handle(self, *_args: Any, **options: Any) -> None:
        path: Path = options["file"]
        try:
            with path.open("rb") as file:
                document = file.read(MAX_FILE + 1)
            found = import_survey(document, options["language"], options["form"], options["name"])
            self._write_report(found.report)
            self._save(found, save=options["save"])
        except BadDefinitionError as error:
            problems = "\n".join(f"  {problem}" for problem in error.problems)
            raise CommandError(f"{path} cannot be imported:\n{problems}") from error
        except OSError as error:
            raise CommandError(f"{error.filename}: {error.strerror}.") from error

    def _write_report(self, report: ImportReport) -> None:
        for note in report.notes:
            keys = f" → {', '.join(note.keys)}" if note.keys else ""
            self.stdout.write(f"{note.label}: {note.name}{keys}")
            if note.text:
                self.stdout.write(f"    “{note.text}”")
            for remark in note.remarks:
                self.stdout.write(f"    {remark}")
        counts = (f"{label}: {count}" for _outcome, label, count in report.counts())
        self.stdout.write(" · ".join(counts))

    def _save(self, found: ImportedSurvey, *, save: bool) -> None:
        if found.definition is None:
            raise BadDefinitionError(found.problems)
        if not save:
            self.stdout.write(f"Not stored. Add --save to store it as {found.slug}.")
            return
        row, is_new = store_next(found.definition, found.report, timezone.now())
        name = f"version {row.version} of {row.slug}"
        self.stdout.write(f"Stored as {name}." if is_new else f"Already stored as {name}.")
