"""Rate limits of views. A client over its limit gets 429 as a page or JSON, with Retry-After."""

import functools
import time
from collections.abc import Callable, Container
from typing import Any, Concatenate, ParamSpec

from django.http import HttpRequest, HttpResponse, HttpResponseBase, JsonResponse
from django.shortcuts import render

from accounts.attempts import Attempts, address_of

Given = ParamSpec("Given")
View = Callable[Concatenate[HttpRequest, Given], HttpResponseBase]
TOO_MANY = 429
FORM_REFUSED = (200, 400)  # as a page, and for a script
ATTEMPTS_SECONDS = 60  # the longest window of ACCOUNT_RATE_LIMITS
SAFE = frozenset({"GET", "HEAD", "OPTIONS"})


def limited(
    attempts: Attempts,
    *,
    reading: bool = False,
    json: bool = False,
    refusals: Container[int] | None = None,
) -> Callable[[View[Given]], View[Given]]:
    """Limit the requests of a user, or of an address without a login, to a view.

    Args:
        attempts: how many in how long.
        reading: count also requests that change nothing.
        json: refuse in JSON.
        refusals: count only requests that are answered with one of these codes, so that a class
            behind one address is not limited while it makes no errors.
    """

    def limit(view: View[Given]) -> View[Given]:
        @functools.wraps(view)
        def limited_view(
            request: HttpRequest, *args: Given.args, **kwargs: Given.kwargs
        ) -> HttpResponseBase:
            if not (reading or request.method not in SAFE):
                return view(request, *args, **kwargs)
            name, now = who(request), time.time()
            check = attempts.count if refusals is None else attempts.are_left
            if not check(name, now):
                return too_many(request, attempts.wait(name, now), json=json)
            answer = view(request, *args, **kwargs)
            if refusals is not None and answer.status_code in refusals:
                attempts.count(name, now)
            return answer

        return limited_view

    return limit


class RetryAfterMiddleware:
    """Middleware: answers with 429 and Retry-After where django-allauth's limits were reached. The
    page stays: after too many wrong passwords it is the form, with a sentence above it.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponseBase]) -> None:
        self._get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponseBase:
        response = self._get_response(request)
        guessed = getattr(request, "limit_met", False)
        if guessed and response.status_code in FORM_REFUSED:
            response.status_code = TOO_MANY
        if response.status_code == TOO_MANY and not response.has_header("Retry-After"):
            response["Retry-After"] = str(getattr(request, "retry_after", ATTEMPTS_SECONDS))
        return response


def who(request: HttpRequest) -> str:
    """Return the key that requests are counted by: the user, or the address without a login."""
    user: Any = getattr(request, "user", None)
    return f"user-{user.pk}" if user is not None and user.is_authenticated else address_of(request)


def too_many(request: HttpRequest, seconds: int, *, json: bool = False) -> HttpResponse:
    if json:
        detail = f"Try again in {seconds} seconds."
        return JsonResponse(
            {"error": "too_many_attempts", "detail": detail},
            status=TOO_MANY,
            headers={"Retry-After": str(seconds)},
        )
    page = render(request, "429.html", status=TOO_MANY)
    page["Retry-After"] = str(seconds)
    return page
