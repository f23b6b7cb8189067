"""The JSON API of a study: how far its versions are, and how somebody with a recruitment id stands,
for programs that approve and pay. docs/reference/json-api.md describes it.

A key belongs to one study and to the researcher who made it: it is refused as soon as they may not
see participants' ids any more.
"""

import time
from collections import Counter
from typing import Any

from django.http import HttpRequest, JsonResponse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from accounts import audit
from accounts.attempts import Attempts, address_of
from experiments.access import may
from experiments.models import Participant, ParticipantKind, Study
from experiments.recruitment.keys import key_of
from experiments.recruitment.payments import minutes_of

VERSION = 1
READ = Attempts("study-api-read", limit=120)
REFUSED = Attempts("study-api-refused", limit=20)
MOST_LISTED = 1000


def _problem(status: int, error: str, detail: str, **headers: str) -> JsonResponse:
    body = {"apiVersion": VERSION, "error": error, "detail": detail}
    return JsonResponse(body, status=status, headers=headers)


def _too_many(attempts: Attempts, address: str, now: float) -> JsonResponse:
    wait = attempts.wait(address, now)
    detail = f"Try again in {wait} seconds."
    return _problem(429, "too_many_attempts", detail, **{"Retry-After": str(wait)})


def _refusal(request: HttpRequest, slug: str) -> JsonResponse | None:
    """Return why a request is refused; None when its key opens the study."""
    address, now = address_of(request), time.time()
    for attempts, is_left in (
        (REFUSED, REFUSED.are_left(address, now)),
        (READ, READ.count(address, now)),
    ):
        if not is_left:
            return _too_many(attempts, address, now)
    key = key_of(request.headers.get("Authorization", ""), timezone.now())
    if key is None or key.slug != slug or not may(key.made_by, slug, "researcher"):
        REFUSED.count(address, now)
        detail = "Send “Authorization: Bearer KEY” with a key of this study."
        return _problem(401, "wrong_key", detail)
    return None


@never_cache
@require_safe
def study(request: HttpRequest, slug: str) -> JsonResponse:
    """Tell how many participants each version of a study has, by status and by outcome."""
    refusal = _refusal(request, slug)
    if refusal is not None:
        return refusal
    people = Participant.objects.filter(study__slug=slug, kind=ParticipantKind.PARTICIPANT)
    counts: dict[Any, tuple[Counter[str], Counter[str]]] = {}
    for row, status, outcome in people.values_list("study", "status", "completion"):
        by_status, by_outcome = counts.setdefault(row, (Counter(), Counter()))
        by_status[status] += 1
        by_outcome[outcome] += bool(outcome)
    versions = [
        {
            "version": one.version,
            "status": one.status,
            "published": one.published_at and one.published_at.isoformat(timespec="seconds"),
            "participants": {name: by_status[name] for name in Participant.Status.values},
            "outcomes": {name: number for name, number in sorted(by_outcome.items()) if number},
        }
        for one in Study.objects.filter(slug=slug).order_by("version")
        for by_status, by_outcome in [counts.get(one.pk, (Counter(), Counter()))]
    ]
    return JsonResponse({"apiVersion": VERSION, "study": slug, "versions": versions})


@never_cache
@require_safe
def participants(request: HttpRequest, slug: str) -> JsonResponse:
    """List a study's participants, in all versions; `?id=` chooses those with a recruitment id,
    `?after=` a page after a participant's code.
    """
    refusal = _refusal(request, slug)
    if refusal is not None:
        return refusal
    rows = Participant.objects.filter(study__slug=slug, kind=ParticipantKind.PARTICIPANT)
    rows = rows.exclude(status=Participant.Status.WITHDRAWN)
    if identifier := request.GET.get("id", ""):
        rows = rows.filter(recruitment_id=identifier)
    if after := request.GET.get("after", ""):
        rows = rows.filter(code__gt=after)
    found = list(rows.select_related("study").order_by("code")[: MOST_LISTED + 1])
    audit.note("participants_read_by_api", study=slug, detail=f"{len(found)} participants")
    listed = [_described(one) for one in found[:MOST_LISTED]]
    more = {"next": listed[-1]["participant"]} if len(found) > MOST_LISTED else {}
    return JsonResponse({"apiVersion": VERSION, "participants": listed, **more})


def _described(one: Participant) -> dict[str, Any]:
    return {
        "id": one.recruitment_id,
        "participant": one.code,
        "version": one.study.version,
        "status": one.status,
        "step": one.step,
        "outcome": one.completion,
        "completionCode": one.completion_code,
        "parameters": one.recruitment,
        "started": one.created_at.isoformat(timespec="seconds"),
        "lastSeen": one.seen_at.isoformat(timespec="seconds"),
        "finished": one.finished_at and one.finished_at.isoformat(timespec="seconds"),
        "minutes": minutes_of(one),
    }
