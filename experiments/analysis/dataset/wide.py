"""Answers once more, a line a response: what most programs for statistics read."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from experiments.analysis.dataset.cells import as_cell
from experiments.analysis.dataset.names import questionnaire_paths
from experiments.analysis.dataset.records import Dataset, ResponseRecord
from surveys.definition import Definition
from surveys.scoring import WideTable as Answers

WIDE = ("response", "version", "participant", "session", "finished")
WideTable = tuple[str, list[str], Iterable[Sequence[Any]]]  # where, head and rows


def wide_tables(dataset: Dataset) -> Iterator[WideTable]:
    """Yield, for each questionnaire, a table with a line a response: two columns a question (its
    value, for which a type may need several, and why there is none) and the scores.
    """
    for slug, path in questionnaire_paths(one.slug for one in dataset.questionnaires).items():
        versions = [one for one in dataset.questionnaires if one.slug == slug]
        given = [one for one in dataset.responses if one.questionnaire == slug]
        yield path, wide_head(versions), _wide_rows(versions, given)


def wide_head(versions: Sequence[Definition]) -> list[str]:
    """Return the columns of a questionnaire in all of its versions."""
    return [*WIDE, *Answers(versions).head]


def _wide_rows(
    versions: Sequence[Definition], responses: Iterable[ResponseRecord]
) -> Iterator[list[Any]]:
    known = {one.version: one for one in versions}
    table = Answers(versions)
    for one in responses:
        yield [
            *(one.id, one.version, one.participant, one.session, as_cell(one.finished)),
            *table.row(known.get(one.version), one.values, one.missing),
        ]
