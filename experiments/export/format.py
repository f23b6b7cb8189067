"""What every format of an export is made of. A format is one file in experiments/export/formats/
with one subclass of `ExportFormat`, found by name.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from django.utils.functional import Promise

from experiments.access import Role
from experiments.analysis.metrics.sessions import Measured
from experiments.dataset.columns import Column
from experiments.dataset.records import Dataset, SessionRecord
from experiments.extraction.forms import Release
from experiments.extraction.selection import Selection
from experiments.models import Drive

File = tuple[str, Iterable[bytes]]  # where in the export, and its content in parts


@dataclass(frozen=True)
class ExportSource:
    """What is exported: `drives` are those of the dataset's sessions, in their order; `more` are
    the columns of all tables beside those of a dataset, for the code book. `measured` has the
    numbers of the sessions so far, without segments and positions.
    """

    dataset: Dataset
    drives: Sequence[Drive]
    release: Release
    more: Mapping[str, tuple[Column, ...]]
    measured: dict[str, Measured] = field(default_factory=dict)


class ExportFormat:
    """Files of one kind: some for the whole study, some for each session, and the last ones."""

    # What the page and the command say of it, and who may ask for it; every export has a format
    # without a label.
    label: ClassVar[str | Promise] = ""
    help: ClassVar[str] = ""
    least: ClassVar[Role] = "viewer"
    # The columns of its tables beside those of a dataset, for the code book; of a table of the
    # dataset, those that have more levels. `tables_of` adds those that depend on the study.
    tables: ClassVar[Mapping[str, tuple[Column, ...]]] = {}

    @classmethod
    def is_in(cls, name: str, choice: Selection) -> bool:
        """Tell whether an export has it: always, or when it was asked for by its name."""
        return not cls.label or name in choice.formats

    @classmethod
    def tables_of(
        cls, _dataset: Dataset, _drives: Sequence[Drive]
    ) -> Mapping[str, tuple[Column, ...]]:
        """Return the columns of its tables in the export of a study: Psych-DS refuses a code book
        with columns that are in no file.
        """
        return cls.tables

    def __init__(self, source: ExportSource) -> None:
        self.source = source

    def of_study(self) -> Iterator[File]:
        """Yield the files of the whole study, which come first."""
        yield from ()

    def of_session(self, session: SessionRecord, drive: Drive) -> Iterator[File]:
        """Yield the files of one session; nothing of its record is kept."""
        yield from ()

    def at_last(self) -> Iterator[File]:
        """Yield the files that are known only after all sessions."""
        yield from ()


def encoded(files: Iterable[tuple[str, Iterable[str]]]) -> Iterator[File]:
    """Yield files of text as they are written."""
    for name, parts in files:
        yield name, (part.encode() for part in parts)
