"""Views that may be asked only so often; who asks more is told to wait, by a page or in JSON, with
Retry-After.
"""

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
FORM_REFUSED = (200, 400)  # a page, and what a script is told
ATTEMPTS_SECONDS = 60  # the longest window of ACCOUNT_RATE_LIMITS
SAFE = frozenset({"GET", "HEAD", "OPTIONS"})


def limited(
    attempts: Attempts,
    *,
    reading: bool = False,
    json: bool = False,
    refusals: Container[int] | None = None,
) -> Callable[[View[Given]], View[Given]]:
    """Keep a view to so many requests of one person, or of one address while nobody is signed in.

    Args:
        attempts: how many in how long.
        reading: also requests that change nothing are counted.
        json: the answer is for a program.
        refusals: count only requests that are answered with one of these codes: a class behind one
            address that does all right has no limit.
    """

    def limit(view: View[Given]) -> View[Given]:
        @functools.wraps(view)
        def kept(
            request: HttpRequest, *args: Given.args, **kwargs: Given.kwargs
        ) -> HttpResponseBase:
            if not (reading or request.method not in SAFE):
                return view(request, *args, **kwargs)
            name, now = who(request), time.time()
            if not (
                attempts.count(name, now) if refusals is None else attempts.are_left(name, now)
            ):
                return too_many(request, attempts.wait(name, now), json=json)
            answer = view(request, *args, **kwargs)
            if refusals is not None and answer.status_code in refusals:
                attempts.count(name, now)
            return answer

        return kept

    return limit


class RetryAfterMiddleware:
    """Middleware: whoever met a limit of django-allauth reads so in the answer's code, and when to
    come again.

    The page stays as it is: after too many wrong passwords it is the form, with a sentence above
    it.
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
    """Return by what requests are counted together: the user, or the address of who is not signed
    in.
    """
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
