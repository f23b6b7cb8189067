"""The quality flags of all participants with their grades; they exclude no participant."""

from collections.abc import Iterator

from experiments.analysis.quality import answer_flags, driving_flags, network_flags
from experiments.dataset.records import SessionRecord
from experiments.definition.recruitment.quality_flags import Flag
from experiments.export.format import ExportFormat, ExportSource, File, listed_columns
from experiments.models import Drive


class QualityFlagsFormat(ExportFormat):
    tables = {"quality_flags": listed_columns("quality_flags")}

    def __init__(self, source: ExportSource) -> None:
        super().__init__(source)
        self._found: list[Flag] = []

    def of_session(self, session: SessionRecord, drive: Drive) -> Iterator[File]:
        """Note the flags of a session, and yield nothing."""
        self._found += driving_flags(self.source.dataset, session)
        yield from ()

    def at_last(self) -> Iterator[File]:
        dataset = self.source.dataset
        found = [*self._found, *answer_flags(dataset), *network_flags(dataset)]
        found.sort(key=lambda one: (one.participant, -one.grade, one.name, one.value))
        rows = (
            (one.participant, one.session, one.name, str(int(one.grade)), one.value)
            for one in found
        )
        yield self.source.table("quality_flags", rows)
