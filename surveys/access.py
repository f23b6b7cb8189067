"""Who may see which response: its own respondent, and nobody else. For all others it is not there."""

from typing import Any
from uuid import UUID

from django.http import Http404, HttpRequest

from surveys.models import Response
from surveys.responses import Respondent

SESSION_KEY = "surveys_respondent"


def answer_as(request: HttpRequest, key: str) -> None:
    """Let this browser answer as an anonymous respondent from now on; the caller has made sure that it may."""
    request.session[SESSION_KEY] = key


def respondent_of(request: HttpRequest) -> Respondent | None:
    """Return who answers in this browser: whoever is signed in, or the anonymous respondent; None for a stranger."""
    user: Any = request.user
    if user.is_authenticated:
        return Respondent(user=user)
    key = request.session.get(SESSION_KEY, "")
    return Respondent(key=key) if key else None


def own_response(request: HttpRequest, pk: UUID) -> Response:
    """Return a response of whoever asks.

    Raises:
        Http404: when there is none, or it is somebody else's.
    """
    user: Any = request.user
    key = request.session.get(SESSION_KEY, "")
    row = Response.objects.select_related("questionnaire").filter(pk=pk).first()
    if row is None:
        raise Http404
    is_users = user.is_authenticated and row.user_id == user.pk
    is_browsers = bool(key) and row.user_id is None and row.respondent_key == key
    if not (is_users or is_browsers):
        raise Http404
    return row
