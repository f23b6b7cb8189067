"""Refusals of the site's JSON APIs (docs/reference/json-api.md)."""

from django.http import JsonResponse

from accounts.attempts import Attempts

VERSION = 1


def problem(status: int, error: str, detail: str, **headers: str) -> JsonResponse:
    """Return a refusal: `error` is a code for the program, `detail` a sentence for its author."""
    body = {"apiVersion": VERSION, "error": error, "detail": detail}
    return JsonResponse(body, status=status, headers=headers)


def too_many(
    attempts: Attempts, name: str, now: float, error: str = "too_many_attempts"
) -> JsonResponse:
    """Return the refusal of a client that has reached its limit, with the wait in seconds."""
    wait = str(attempts.wait(name, now))
    return problem(429, error, f"Try again in {wait} seconds.", **{"Retry-After": wait})
