"""Answers once more, a line a response: what most programs for statistics read."""

from collections.abc import Iterator, Sequence
from typing import Any

from experiments.analysis.dataset.records import Dataset
from surveys.definition import Definition, cells_of, columns_of
from surveys.scoring import scores

WIDE = ("response", "version", "participant", "session", "finished")


def wide_head(versions: Sequence[Definition]) -> list[str]:
    """Return the columns of a questionnaire in all of its versions: of each question its value, for
    which a type may need several, and why there is none; then the scores.
    """
    named = dict.fromkeys(name for one in versions for name in scores(one, {}))
    return [*WIDE, *columns_of(versions), *named]


def wide_rows(dataset: Dataset, slug: str) -> Iterator[list[Any]]:
    """Yield the responses to a questionnaire as rows."""
    known = {one.version: one for one in dataset.questionnaires if one.slug == slug}
    layout = wide_head([*known.values()])[len(WIDE) :]
    everywhere = {question.key: question for one in known.values() for question in one.questions()}
    for one in dataset.responses:
        if one.questionnaire != slug:
            continue
        own = known.get(one.version)
        asked = {question.key: question for question in own.questions()} if own else {}
        found = cells_of(everywhere | asked, one.values, one.missing)
        found |= scores(own, one.values) if own else {}
        yield [
            *(one.id, one.version, one.participant, one.session, one.finished),
            *(found.get(name, "") for name in layout),
        ]
