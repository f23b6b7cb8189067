"""Answers once more, a line a response: what most programs for statistics read."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from experiments.analysis.dataset.cells import as_cell
from experiments.analysis.dataset.names import questionnaire_paths
from experiments.analysis.dataset.records import Dataset, ResponseRecord
from surveys.definition import Definition, cells_of, columns_of
from surveys.scoring import scores

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
    return [*WIDE, *columns_of(versions), *_scores(versions)]


def _wide_rows(
    versions: Sequence[Definition], responses: Iterable[ResponseRecord]
) -> Iterator[list[Any]]:
    known = {one.version: one for one in versions}
    layout, named = columns_of(versions), _scores(versions)
    everywhere = {question.key: question for one in versions for question in one.questions()}
    for one in responses:
        own = known.get(one.version)
        asked = {question.key: question for question in own.questions()} if own else {}
        cells = cells_of(everywhere | asked, one.values, one.missing)
        found = scores(own, one.values) if own else {}
        yield [
            *(one.id, one.version, one.participant, one.session, as_cell(one.finished)),
            *(cells.get(column, "") for column in layout),
            *("" if found.get(name) is None else found[name] for name in named),
        ]


def _scores(versions: Sequence[Definition]) -> list[str]:
    return list(dict.fromkeys(name for one in versions for name in scores(one, {})))
