"""What was planned, and what became of it: the text of the preregistration, who is excluded by
which rule, and the reporting sheet.
"""

from collections.abc import Iterator

from experiments.analysis.plan.preregistration import preregistration
from experiments.analysis.plan.reporting_sheet import as_markdown, reporting_sheet
from experiments.analysis.tables.people import of_whom
from experiments.analysis.tables.table import Table
from experiments.dataset.columns import Column, flag
from experiments.dataset.counting import counting
from experiments.dataset.exclusions import RULES
from experiments.dataset.files import table
from experiments.dataset.levels import KINDS
from experiments.dataset.records import Dataset
from experiments.export.format import ExportFormat, ExportSource, File, encoded

EXCLUSIONS = (
    Column("participant", "", "who is excluded"),
    Column("session", "", "session that is excluded; empty: the participant with all sessions"),
    Column("rule", "", "rule that excludes them").one_of(RULES),
    Column("value", "", "what was found"),
    flag("planned", "1 when the plan of the study has the rule"),
)


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
        rows = [
            [one.participant, one.session, one.rule, one.value, one.is_planned]
            for some in self._chosen
            for one in some.exclusions
        ]
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
