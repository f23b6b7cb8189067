"""Answers once more, a line a response: what most programs for statistics read."""

from collections.abc import Iterator, Sequence
from typing import Any

from experiments.dataset.records import Dataset
from surveys.definition import Definition
from surveys.scoring import WideTable

WIDE = ("response", "version", "participant", "session", "finished")


def wide_head(versions: Sequence[Definition]) -> list[str]:
    """Return the columns of a questionnaire in all of its versions."""
    return [*WIDE, *WideTable(versions).head]


def wide_rows(dataset: Dataset, slug: str) -> Iterator[list[Any]]:
    """Yield the responses to a questionnaire as rows."""
    known = {one.version: one for one in dataset.questionnaires if one.slug == slug}
    table = WideTable([*known.values()])
    for one in dataset.responses:
        if one.questionnaire == slug:
            own = table.row(known.get(one.version), one.values, one.missing)
            yield [one.id, one.version, one.participant, one.session, one.finished, *own]
