"""What was planned, and what became of it: the text of the preregistration, who is excluded by
which rule, and the reporting sheet.
"""

from collections.abc import Iterator
from dataclasses import replace

from experiments.analysis.dataset.columns import Column, flag
from experiments.analysis.dataset.exclusions import RULES
from experiments.analysis.dataset.files import table
from experiments.analysis.dataset.records import Dataset, SessionRecord
from experiments.analysis.metrics.sessions import Measured, measure
from experiments.analysis.plan.preregistration import preregistration
from experiments.analysis.plan.reporting_sheet import as_markdown, reporting_sheet
from experiments.analysis.tables.participant_kinds import KINDS, of_whom
from experiments.analysis.tables.table import Table
from experiments.dataset.build import ANALYSED
from experiments.dataset.events import events_of
from experiments.dataset.selection import Selection
from experiments.export.format import ExportFormat, ExportSource, File, encoded
from experiments.models import Drive

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

    @classmethod
    def is_in(cls, _name: str, _choice: Selection) -> bool:
        """Tell that every export has it."""
        return True

    def __init__(self, source: ExportSource) -> None:
        super().__init__(source)
        there = {one.kind for one in source.dataset.participants} or {"participant"}
        self._chosen = [source.dataset.counting([kind]) for kind in KINDS if kind in there]
        self._counted = {one.id for some in self._chosen for one in some.sessions}
        self._measured: list[Measured] = []

    def of_study(self) -> Iterator[File]:
        """Yield the preregistration, and everybody who is excluded."""
        dataset = self.source.dataset
        text = preregistration(dataset.study, dataset.freeze, dataset.questionnaires)
        rows = [
            [one.participant, one.session, one.rule, one.value, int(one.is_planned)]
            for some in self._chosen
            for one in some.exclusions
        ]
        yield from encoded([("preregistration.md", [text]), table("exclusions", rows, EXCLUSIONS)])

    def of_session(self, session: SessionRecord, drive: Drive) -> Iterator[File]:
        """Measure a session that counts; of its record only the numbers are kept."""
        if session.id in self._counted:
            events = events_of([drive], replace(self.source.release, choice=ANALYSED))
            found = measure(self.source.dataset, session, events)
            self._measured.append(replace(found, segments=(), way=found.way[:0]))
        yield from ()

    def at_last(self) -> Iterator[File]:
        """Yield the reporting sheets: of participants, pilots and bots, of whom there are some."""
        sheets = "\n".join(as_markdown(self._sheet(some)) for some in self._chosen)
        yield from encoded([("reporting-sheet.md", [sheets])])

    def _sheet(self, some: Dataset) -> Table:
        own = {one.id for one in some.sessions}
        measured = [one for one in self._measured if one.session.id in own]
        everybody = self.source.dataset.participants
        sheet = reporting_sheet(some, measured, everybody)
        return of_whom(sheet, some.participants)
