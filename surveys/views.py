"""The pages of a questionnaire, and saving single answers with JavaScript.

Both take the same fields; the page that is sent at the end repeats the answers that were saved one
by one. A response of another user is answered like one that does not exist.
"""

import datetime
from contextlib import suppress
from typing import Any
from uuid import UUID

import msgspec
from django.contrib.auth.decorators import login_required
from django.http import HttpRequest, HttpResponse, HttpResponseBase, JsonResponse
from django.shortcuts import get_object_or_404, redirect, render
from django.utils import timezone
from django.utils.translation import get_language, gettext as _
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_http_methods, require_POST, require_safe

from accounts.attempts import Attempts
from accounts.rate_limits import limited
from surveys import responses
from surveys.definition import Definition, language_for
from surveys.documents import spoken
from surveys.item import RefusedError
from surveys.models import Response
from surveys.outer_progress import filled_in, outer_progress_of
from surveys.page_form import Reader, page_form_of
from surveys.responses import ClosedError, NotAskedError, Saving

REFUSED, SIGNED_OUT, CLOSED, WRONG = 400, 403, 409, 422
MAX_WRITER = 32
ANSWERS = Attempts("survey-answer", limit=240)


@never_cache
@login_required
@require_safe
def resume(request: HttpRequest, response: UUID) -> HttpResponseBase:
    row = _own_response(request, response)
    return _go_on(row, row.questionnaire.as_definition(), timezone.now())


@never_cache
@login_required
@require_http_methods(["GET", "HEAD", "POST"])
def page(request: HttpRequest, response: UUID, number: int) -> HttpResponseBase:
    """Show a page, or store it; `number` counts from 1."""
    row = _own_response(request, response)
    definition, now = row.questionnaire.as_definition(), timezone.now()
    if row.finished_at is not None:
        return _away(row)
    shown = responses.pages_shown(row, definition)
    if number - 1 not in shown or number - 1 > row.reached:
        return _go_on(row, definition, now)
    handle = _take if request.method == "POST" else _show
    return handle(request, row, definition, number - 1)


def _take(request: HttpRequest, row: Response, definition: Definition, n: int) -> HttpResponseBase:
    saving, offered = _saving(request, definition), request.POST.getlist("shown")
    sent: dict[str, Any] = {"fields": _fields(request), "offered": offered, "saving": saving}
    try:
        result = responses.save_page(row, definition, n, **sent)
    except NotAskedError:
        return render(request, "surveys/refused.html", {"response": row}, status=REFUSED)
    if request.POST.get("go") == "back":
        # What was filled in so far is saved, and need not be complete.
        earlier = [one for one in responses.pages_shown(row, definition) if one < n]
        return redirect("survey_page", row.pk, (earlier[-1] if earlier else n) + 1)
    if not result.is_done:
        return _show(request, row, definition, n, result=result)
    return _to_page(row, definition, responses.leave_page(row, definition, n), saving.now)


def _show(
    request: HttpRequest,
    row: Response,
    definition: Definition,
    number: int,
    result: responses.PageResult | None = None,
) -> HttpResponse:
    shown = responses.pages_shown(row, definition)
    reader = Reader(
        *(_language(definition), row.seed, timezone.now(), row.given(), row.circumstances),
        errors=result.errors if result else {},
        sent=_fields(request) if result else {},
    )
    earlier = [n for n in shown if n < number]
    outer = outer_progress_of(row, get_language() or "")
    if outer is not None and outer.fill is not None:
        definition = filled_in(definition, outer.fill)
    context: dict[str, Any] = {
        "response": row,
        "form": page_form_of(definition, number, reader, shown),
        "page_number": number + 1,
        "more_appeared": bool(result and result.more_appeared),
        "title": (outer and outer.step_title) or spoken(definition.title, reader.language),
        "intro": spoken(definition.intro, reader.language) if not earlier else "",
        "language": reader.language,
        "earlier": earlier[-1] + 1 if earlier else None,
        "outer": outer,
    }
    return render(request, "surveys/page.html", context, status=WRONG if result else 200)


@never_cache
@require_POST
@limited(ANSWERS, json=True)
def answer(request: HttpRequest, response: UUID) -> JsonResponse:
    if not request.user.is_authenticated:
        return _not_saved(_("You are logged out. Log in again to continue."), SIGNED_OUT)
    row = _own_response(request, response)
    definition, item = row.questionnaire.as_definition(), request.POST.get("item", "")
    try:
        saving = _saving(request, definition)
        responses.save_one(row, definition, item, _fields(request), saving)
    except ClosedError:
        return _not_saved(_("This questionnaire is already closed."), CLOSED)
    except NotAskedError:
        return _not_saved(_("This question isn't on your page. Reload the page."), REFUSED)
    except RefusedError as error:
        return _not_saved(str(error), WRONG)
    return JsonResponse({"saved": True})


def _not_saved(error: str, status: int) -> JsonResponse:
    return JsonResponse({"saved": False, "error": error}, status=status)


@never_cache
@login_required
@require_safe
def done(request: HttpRequest, response: UUID) -> HttpResponseBase:
    row = _own_response(request, response)
    definition = row.questionnaire.as_definition()
    if row.finished_at is None:
        return redirect("survey", row.pk)
    title = spoken(definition.title, _language(definition))
    return render(request, "surveys/done.html", {"response": row, "title": title})


def _own_response(request: HttpRequest, pk: UUID) -> Response:
    rows = Response.objects.select_related("questionnaire").exclude(user=None)
    return get_object_or_404(rows, pk=pk, user_id=request.user.pk)


def _go_on(row: Response, definition: Definition, now: datetime.datetime) -> HttpResponseBase:
    if row.finished_at is not None:
        return _away(row)
    return _to_page(row, definition, responses.place(row, definition), now)


def _to_page(
    row: Response, definition: Definition, number: int | None, now: datetime.datetime
) -> HttpResponseBase:
    """Redirect to a page (from 0); without one finish, or to where a required answer is missing."""
    if number is None:
        number = responses.finish(row, definition, now)
    return _away(row) if number is None else redirect("survey_page", row.pk, number + 1)


def _away(row: Response) -> HttpResponseBase:
    return redirect(row.return_to) if row.return_to else redirect("survey_done", row.pk)


def _language(definition: Definition) -> str:
    return language_for(definition, get_language() or "")


def _fields(request: HttpRequest) -> dict[str, list[str]]:
    return {name: [str(value) for value in values] for name, values in request.POST.lists()}


def _saving(request: HttpRequest, definition: Definition) -> Saving:
    """Return how the page saves; malformed fields are left out, because no answer needs them."""
    writing = request.POST.get("writing", "")
    is_number = writing.isascii() and writing.isdigit() and len(writing) <= MAX_WRITER // 2
    seconds: dict[str, float] = {}
    with suppress(msgspec.DecodeError):
        seconds = msgspec.json.decode(request.POST.get("seconds", ""), type=dict[str, float])
    writer, number = request.POST.get("writer", "")[:MAX_WRITER], int(writing) if is_number else 0
    return Saving(timezone.now(), _language(definition), seconds, writer, number)
