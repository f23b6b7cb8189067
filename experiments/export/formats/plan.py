"""The plan and its outcome: preregistration, exclusions, and reporting sheet."""

from collections.abc import Iterator

from experiments.analysis.plan.preregistration import preregistration
from experiments.analysis.plan.reporting_sheet import as_markdown, reporting_sheet
from experiments.analysis.tables.people import label_kinds
from experiments.dataset.columns import declared
from experiments.dataset.counting import counting
from experiments.dataset.files import values_of
from experiments.dataset.levels import KINDS
from experiments.dataset.records import PlanExclusion
from experiments.export.format import ExportFormat, ExportSource, File


class PlanFormat(ExportFormat):
    tables = {"exclusions": declared(PlanExclusion)}

    def __init__(self, source: ExportSource) -> None:
        super().__init__(source)
        there = {one.kind for one in source.dataset.participants} or {"participant"}
        self._chosen = [counting(source.dataset, [kind]) for kind in KINDS if kind in there]

    def of_study(self) -> Iterator[File]:
        dataset = self.source.dataset
        text = preregistration(dataset.study, dataset.freeze, dataset.questionnaires)
        yield "preregistration.md", [text]
        found = (one for some in self._chosen for one in some.exclusions)
        yield self.source.table("exclusions", values_of(found, self.tables["exclusions"]))

    def at_last(self) -> Iterator[File]:
        """Yield the reporting sheets: of the participants, the pilots and the bots of the study."""
        everybody = self.source.dataset.participants
        sheets = []
        for some in self._chosen:
            measured = [self.source.measured[one.id] for one in some.sessions]
            sheet = reporting_sheet(some, measured, everybody)
            sheets.append(as_markdown(label_kinds(sheet, some.participants)))
        yield "reporting-sheet.md", ["\n".join(sheets)]
