"""What was planned, and what became of it: the text of the preregistration, who is excluded by
which rule, and the reporting sheet.
"""

from collections.abc import Iterator

from experiments.analysis.plan.preregistration import preregistration
from experiments.analysis.plan.reporting_sheet import as_markdown, reporting_sheet
from experiments.analysis.tables.participant_kinds import KINDS, of_whom
from experiments.analysis.tables.table import Table
from experiments.dataset.columns import declared
from experiments.dataset.counting import counting
from experiments.dataset.files import table, values_of
from experiments.dataset.records import Dataset, PlanExclusion
from experiments.export.format import ExportFormat, ExportSource, File, encoded

EXCLUSIONS = declared(PlanExclusion)


class PlanFormat(ExportFormat):
    """What every export has."""

    tables = {"exclusions": EXCLUSIONS}

    def __init__(self, source: ExportSource) -> None:
        super().__init__(source)
        there = {one.kind for one in source.dataset.participants} or {"participant"}
        self._chosen = [counting(source.dataset, [kind]) for kind in KINDS if kind in there]

    def of_study(self) -> Iterator[File]:
        """Yield the preregistration, and everybody who is excluded."""
        dataset = self.source.dataset
        text = preregistration(dataset.study, dataset.freeze, dataset.questionnaires)
        found = (one for some in self._chosen for one in some.exclusions)
        rows = values_of(found, EXCLUSIONS)
        yield from encoded([("preregistration.md", [text]), table("exclusions", rows, EXCLUSIONS)])

    def at_last(self) -> Iterator[File]:
        """Yield the reporting sheets: of participants, pilots and bots, of whom there are some."""
        sheets = "\n".join(as_markdown(self._sheet(some)) for some in self._chosen)
        yield from encoded([("reporting-sheet.md", [sheets])])

    def _sheet(self, some: Dataset) -> Table:
        measured = [self.source.measured[one.id] for one in some.sessions]
        everybody = self.source.dataset.participants
        sheet = reporting_sheet(some, measured, everybody)
        return of_whom(sheet, some.participants)
