"""The quality flags of all participants with their grades; they exclude no participant."""

from collections.abc import Iterator

from experiments.analysis.quality import answer_flags, driving_flags, network_flags
from experiments.dataset.columns import Column
from experiments.dataset.records import SessionRecord
from experiments.definition.recruitment.quality_flags import Flag
from experiments.export.format import ExportFormat, ExportSource, File
from experiments.models import Drive

MEANINGS = {
    "attention_check": "another answer to an attention check of the plan",
    "speeding": "less than 1 s an answer, or than a third of the median time",
    "straight_lining": "the same answer to all items of a scale",
    "never_moved": "saw the video and never moved the robot",
    "regular_input": "inputs of the same length, as a program's",
    "frozen_video": "seconds of the drive without a new video frame",
    "same_network": "participants of the study on one network",
    "same_id": "participants of the study with one recruitment id",
}
GRADES = {
    "1": "note: happens to attentive participants as well",
    "2": "doubtful: worth a look",
    "3": "serious: hardly compatible with taking part as meant",
}
COLUMNS = (
    Column("participant", "", "code of the participant"),
    Column("session", "", "code of the session; empty where the flag is about no single one"),
    Column("flag", "", "what was found", levels=MEANINGS),
    Column("grade", "", "how serious it is", levels=GRADES),
    Column("value", "", "what was found, in words and figures"),
)


class QualityFlagsFormat(ExportFormat):
    tables = {"quality_flags": COLUMNS}

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
