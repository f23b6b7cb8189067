"""Answers as CSV, streamed with one batch of responses in memory. `long` has a line a question and
response, `wide` a line a response.
"""

from collections.abc import AsyncIterator, Iterator, Sequence
from itertools import islice
from typing import Any

from asgiref.sync import sync_to_async
from django.db.models import QuerySet
from django.http import StreamingHttpResponse

from robots.files.csv_text import csv_text
from surveys.definition import Definition
from surveys.item import one_cell
from surveys.models import Answer, Questionnaire, Response
from surveys.scoring import WideTable

BATCH = 200
LINES_AT_ONCE = 500
ABOUT = (
    *("response", "questionnaire", "version", "respondent", "context", "context_label", "robot"),
    *("outcome", "seed", "language", "started_at", "finished_at"),
)
LONG = (
    *(*ABOUT, "item", "kind", "page", "position", "value", "missing", "answer_language"),
    *("text_version", "seconds", "first_at", "answered_at"),
)


def as_long_csv(responses: QuerySet[Response], name: str) -> StreamingHttpResponse:
    return _download(_long_rows(responses), name)


def as_wide_csv(slug: str) -> StreamingHttpResponse:
    return _download(_wide_rows(slug), f"{slug}-wide")


def _download(rows: Iterator[Sequence[Any]], name: str) -> StreamingHttpResponse:
    response = StreamingHttpResponse(_lines(rows), content_type="text/csv; charset=utf-8")
    response["Content-Disposition"] = f'attachment; filename="{name}.csv"'
    response["Cache-Control"] = "private, no-store"
    return response


async def _lines(rows: Iterator[Sequence[Any]]) -> AsyncIterator[str]:
    """Yield CSV; the database is read in Django's thread for it."""
    while part := await sync_to_async(lambda: list(islice(rows, LINES_AT_ONCE)))():
        yield csv_text(part)


def _long_rows(responses: QuerySet[Response]) -> Iterator[Sequence[Any]]:
    yield LONG
    for response, definition, rows in answered(responses):
        about, places = _about(response), definition.positions(response.seed)
        given = response.response_statuses(definition, {row.item: row.given for row in rows})
        by_item = {row.item: row for row in rows}
        for question in definition.questions():
            key, status = question.key, given[question.key]
            cells = [key, question.item.kind, question.page + 1, places[key]]
            cells += [one_cell(status.value), status.missing]
            if row := by_item.get(key):
                cells += [row.language, row.text_version, row.seconds]
                cells += [row.first_at.isoformat(), row.answered_at.isoformat()]
            yield [*about, *cells, *[None] * (len(LONG) - len(ABOUT) - len(cells))]


def _wide_rows(slug: str) -> Iterator[Sequence[Any]]:
    versions = Questionnaire.objects.filter(slug=slug).order_by("version")
    table = WideTable([row.as_definition() for row in versions])
    yield [*ABOUT, *table.head]
    for response, definition, rows in answered(Response.objects.filter(questionnaire__slug=slug)):
        given = response.response_statuses(definition, {row.item: row.given for row in rows})
        values = {key: status.value for key, status in given.items()}
        missing = {key: status.missing or "" for key, status in given.items()}
        yield [*_about(response), *table.row(definition, values, missing)]


def answered(responses: QuerySet[Response]) -> Iterator[tuple[Response, Definition, list[Answer]]]:
    """Yield responses, oldest first, with questionnaire and answers, in two queries a batch."""
    known: dict[Any, Definition] = {}
    ordered = responses.select_related("questionnaire").order_by("started_at", "id")
    found = ordered.iterator(chunk_size=BATCH)
    while batch := list(islice(found, BATCH)):
        rows: dict[Any, list[Answer]] = {response.pk: [] for response in batch}
        for answer in Answer.objects.filter(response__in=list(rows)).order_by("position"):
            rows[answer.response_id].append(answer)
        for response in batch:
            key = response.questionnaire_id
            known[key] = known.get(key) or response.questionnaire.as_definition()
            yield response, known[key], rows[response.pk]


def _about(response: Response) -> list[Any]:
    questionnaire, finished = response.questionnaire, response.finished_at
    return [
        *(response.pk, questionnaire.slug, questionnaire.version, response.respondent),
        *(response.context, response.context_label, "|".join(response.robot), response.outcome),
        *(response.seed, response.language, response.started_at.isoformat()),
        finished and finished.isoformat(),
    ]
