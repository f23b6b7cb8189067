"""The base class of export formats, one in each module of experiments/export/formats/."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from django.utils.functional import Promise

from experiments.access import Role
from experiments.analysis.metrics.sessions import Measured
from experiments.dataset.columns import Tables
from experiments.dataset.files import as_csv, table_path
from experiments.dataset.records import Dataset, SessionRecord
from experiments.extraction.forms import Release
from experiments.extraction.selection import Selection
from experiments.models import Drive

# A path in the export, and the content in parts.
File = tuple[str, Iterable[str | bytes]]


def text_of(name: str) -> str:
    return Path(__file__).with_name("texts").joinpath(name).read_text(encoding="utf-8")


@dataclass(frozen=True)
class ExportSource:
    """The data of an export: `drives` are those of the dataset's sessions, in their order; `more`
    are the columns of all tables beside those of a dataset, for the code book. `measured` has the
    numbers of the sessions so far, without segments and positions.
    """

    dataset: Dataset
    drives: Sequence[Drive]
    release: Release
    more: Tables
    measured: dict[str, Measured] = field(default_factory=dict)

    def table(self, name: str, rows: Iterable[Sequence[Any]]) -> File:
        """Return rows of values, in the order of the table's columns, as a file."""
        return table_path(name), as_csv(self.more[name], rows)


class ExportFormat:
    """Files of one kind: some for the whole study, some for each session, and the last ones."""

    # The text of the page and of the command about it, and who may request it; every export has a
    # format without a label.
    label: ClassVar[str | Promise] = ""
    help: ClassVar[str] = ""
    least: ClassVar[Role] = "viewer"
    # The columns of its tables beside those of a dataset, for the code book; of a table of the
    # dataset, those that have more levels. `tables_of` adds those that depend on the study.
    tables: ClassVar[Tables] = {}

    @classmethod
    def is_in(cls, name: str, choice: Selection) -> bool:
        """Tell whether an export has it: always, or when it was requested by its name."""
        return not cls.label or name in choice.formats

    @classmethod
    def tables_of(cls, _dataset: Dataset, _drives: Sequence[Drive]) -> Tables:
        """Return its tables' columns; Psych-DS refuses columns that are in no file."""
        return cls.tables

    def __init__(self, source: ExportSource) -> None:
        self.source = source

    def of_study(self) -> Iterator[File]:
        yield from ()

    def of_session(self, session: SessionRecord, drive: Drive) -> Iterator[File]:
        """Yield the files of one session; nothing of its record is kept."""
        yield from ()

    def at_last(self) -> Iterator[File]:
        """Yield the files that are known only after all sessions."""
        yield from ()
