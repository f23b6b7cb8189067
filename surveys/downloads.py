"""Answers as CSV, written while they are sent: a batch of responses at a time is in memory, however
many there are.

`long` has a line a question and response, `wide` a line a response with two columns a question: its
value (a type may need several columns for it), and why there is none. The lines are ordinary
generators, for exports that are no pages as well.
"""

import datetime
from collections.abc import AsyncIterator, Iterator, Sequence
from itertools import islice
from typing import Any

from asgiref.sync import sync_to_async
from django.db.models import QuerySet
from django.http import StreamingHttpResponse

from robots.files.csv_text import csv_text
from surveys.definition import Definition, cells_of, columns_of
from surveys.models import Answer, Questionnaire, Response
from surveys.scoring import scores

BATCH = 200
LINES_AT_ONCE = 500
ABOUT = (
    "response",
    "questionnaire",
    "version",
    "respondent",
    "context",
    "context_label",
    "robot",
    "outcome",
    "seed",
    "language",
    "started_at",
    "finished_at",
)
LONG = (
    *ABOUT,
    "item",
    "kind",
    "page",
    "position",
    "value",
    "missing",
    "answer_language",
    "text_version",
    "seconds",
    "first_at",
    "answered_at",
)


def as_long_csv(responses: QuerySet[Response], name: str) -> StreamingHttpResponse:
    """Return a download with a line a question and response; responses of any questionnaires."""
    return _download(long_lines(responses), name)


def as_wide_csv(slug: str) -> StreamingHttpResponse:
    """Return a download with a line a response to any version of a questionnaire,
    with its scores.
    """
    return _download(wide_lines(slug), f"{slug}-wide")


def _download(lines: Iterator[str], name: str) -> StreamingHttpResponse:
    headers = {
        "Content-Disposition": f'attachment; filename="{name}.csv"',
        "Cache-Control": "private, no-store",
    }
    return StreamingHttpResponse(
        _beside_the_loop(lines), content_type="text/csv; charset=utf-8", headers=headers
    )


async def _beside_the_loop(lines: Iterator[str]) -> AsyncIterator[str]:
    """Give the lines on, read from the database in the thread that Django keeps for it."""
    while part := await sync_to_async(lambda: list(islice(lines, LINES_AT_ONCE)))():
        yield "".join(part)


def long_lines(responses: QuerySet[Response]) -> Iterator[str]:
    """Yield CSV with a line a question and response."""
    yield csv_text([LONG])
    for response, definition, rows in answered(responses):
        about, places = _about(response), definition.positions(response.seed)
        given = response.response_statuses(definition, {row.item: row.given for row in rows})
        by_item = {row.item: row for row in rows}
        for question in definition.questions():
            said, row = given[question.key], by_item.get(question.key)
            cells = [
                question.key,
                question.item.kind,
                question.page + 1,
                places[question.key],
                "" if said.value is None else question.item.cell(said.value),
                said.missing or "",
            ]
            yield csv_text([[*about, *cells, *_of_row(row)]])


def _of_row(row: Answer | None) -> list[Any]:
    if row is None:
        return ["", "", "", "", ""]
    return [row.language, row.text_version, row.seconds, _iso(row.first_at), _iso(row.answered_at)]


def wide_lines(slug: str) -> Iterator[str]:
    """Yield CSV with a line a response to any version of a questionnaire, with its scores."""
    versions = [
        row.as_definition() for row in Questionnaire.objects.filter(slug=slug).order_by("version")
    ]
    layout = columns_of(versions)
    named = list(dict.fromkeys(name for definition in versions for name in scores(definition, {})))
    yield csv_text([[*ABOUT, *layout, *named]])
    for response, definition, rows in answered(Response.objects.filter(questionnaire__slug=slug)):
        given = response.response_statuses(definition, {row.item: row.given for row in rows})
        values = {key: said.value for key, said in given.items()}
        missing = {key: said.missing or "" for key, said in given.items()}
        asked = {question.key: question for question in definition.questions()}
        cells = cells_of(asked, values, missing)
        found = scores(definition, values)
        row = [
            *_about(response),
            *(cells.get(column, "") for column in layout),
            *(found.get(name) for name in named),
        ]
        yield csv_text([row])


def answered(
    responses: QuerySet[Response],
) -> Iterator[tuple[Response, Definition, Sequence[Answer]]]:
    """Yield responses, the oldest first, with what they were asked and their rows; two queries a
    batch.
    """
    known: dict[Any, Definition] = {}
    ordered = (
        responses.select_related("questionnaire")
        .order_by("started_at", "id")
        .iterator(chunk_size=BATCH)
    )
    while batch := list(islice(ordered, BATCH)):
        rows: dict[Any, list[Answer]] = {response.pk: [] for response in batch}
        for answer in Answer.objects.filter(response__in=list(rows)).order_by("position"):
            rows[answer.response_id].append(answer)
        for response in batch:
            key = response.questionnaire_id
            known[key] = known.get(key) or response.questionnaire.as_definition()
            yield response, known[key], rows[response.pk]


def _about(response: Response) -> list[Any]:
    questionnaire = response.questionnaire
    return [
        response.pk,
        questionnaire.slug,
        questionnaire.version,
        response.respondent,
        response.context,
        response.context_label,
        "|".join(response.robot),
        response.outcome,
        response.seed,
        response.language,
        _iso(response.started_at),
        _iso(response.finished_at),
    ]


def _iso(at: datetime.datetime | None) -> str:
    return "" if at is None else at.isoformat()
