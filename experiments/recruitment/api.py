"""The JSON API of a study: how many participants its versions have, and the state of participants
with a recruitment id, for programs that approve and pay. docs/reference/json-api.md describes it.

A key belongs to one study and to the researcher who made it. It is shown once and stored as a hash,
and refused once that researcher may no longer see participants' ids.
"""

import datetime
import secrets
import time
from collections import Counter, defaultdict
from typing import Any

from django.http import HttpRequest, JsonResponse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from accounts import audit
from accounts.attempts import Attempts, address_of
from accounts.json_api import VERSION, problem, too_many
from accounts.tokens import hash_of
from experiments.access import may
from experiments.models import LEFT, Participant, ParticipantKind, Study, StudyKey
from experiments.recruitment.payments import minutes_of
from experiments.recruitment.recognition import withdrawn_as

READ = Attempts("study-api-read", limit=120)
REFUSED = Attempts("study-api-refused", limit=20)
MAX_LISTED = 1000
TOKEN_BYTES, MAX_LENGTH = 32, 128
USE_STEP = datetime.timedelta(minutes=1)  # the precision of `last_used_at`


def make_key(slug: str, label: str, user: Any, now: datetime.datetime) -> str:
    """Return a new key for a study; an IntegrityError when it has one of this label."""
    key = secrets.token_urlsafe(TOKEN_BYTES)
    row = StudyKey(slug=slug, label=label, token_sha256=hash_of(key), made_at=now, made_by=user)
    row.save(force_insert=True)
    return key


def key_of(header: str, now: datetime.datetime) -> StudyKey | None:
    """Return the key of an Authorization header and note its use; None for anything else."""
    scheme, _, given = header.partition(" ")
    if scheme.lower() != "bearer" or len(given) > MAX_LENGTH:
        return None
    rows = StudyKey.objects.select_related("made_by")
    found = rows.filter(token_sha256=hash_of(given.strip())).first()
    if found is not None and (found.last_used_at is None or now - found.last_used_at >= USE_STEP):
        StudyKey.objects.filter(pk=found.pk).update(last_used_at=now)
    return found


def _key_for(request: HttpRequest, slug: str) -> StudyKey | JsonResponse:
    """Return the key of a request, if it opens the study, or why the request is refused."""
    address, now = address_of(request), time.time()
    if not REFUSED.are_left(address, now):
        return too_many(REFUSED, address, now)
    if not READ.count(address, now):
        return too_many(READ, address, now)
    key = key_of(request.headers.get("Authorization", ""), timezone.now())
    if key is None or key.slug != slug or not may(key.made_by, slug, "researcher"):
        REFUSED.count(address, now)
        detail = "Send “Authorization: Bearer KEY” with a key of this study."
        return problem(401, "wrong_key", detail)
    return key


@never_cache
@require_safe
def study(request: HttpRequest, slug: str) -> JsonResponse:
    """Count the participants of each version of a study by status and by outcome."""
    key = _key_for(request, slug)
    if isinstance(key, JsonResponse):
        return key
    people = Participant.objects.filter(study__slug=slug, kind=ParticipantKind.PARTICIPANT)
    statuses: dict[Any, Counter[str]] = defaultdict(Counter)
    outcomes: dict[Any, Counter[str]] = defaultdict(Counter)
    for version, status, outcome in people.values_list("study", "status", "completion"):
        statuses[version][status] += 1
        if outcome:
            outcomes[version][outcome] += 1
    versions = [
        {
            "version": one.version,
            "status": one.status,
            "published": one.published_at and one.published_at.isoformat(timespec="seconds"),
            "participants": {name: statuses[one.pk][name] for name in Participant.Status.values},
            "outcomes": dict(sorted(outcomes[one.pk].items())),
        }
        for one in Study.objects.filter(slug=slug).order_by("version")
    ]
    return JsonResponse({"apiVersion": VERSION, "study": slug, "versions": versions})


@never_cache
@require_safe
def participants(request: HttpRequest, slug: str) -> JsonResponse:
    """List participants with a recruitment id (`?id=`), or after a code (`?after=`)."""
    key = _key_for(request, slug)
    if isinstance(key, JsonResponse):
        return key
    rows = Participant.objects.filter(study__slug=slug, kind=ParticipantKind.PARTICIPANT)
    if identifier := request.GET.get("id", ""):
        rows = rows.filter(recruitment_id__in=(identifier, withdrawn_as(slug, identifier)))
    else:
        rows = rows.exclude(status=Participant.Status.WITHDRAWN)
    if after := request.GET.get("after", ""):
        rows = rows.filter(code__gt=after)
    found = list(rows.select_related("study").order_by("code")[: MAX_LISTED + 1])
    read = f"{len(found)} participants"
    audit.note("participants_read_by_api", actor=key.made_by, study=slug, detail=read)
    listed = [
        _withdrawn(one, identifier) if one.withdrawn_at else _described(one)
        for one in found[:MAX_LISTED]
    ]
    more = {"next": listed[-1]["participant"]} if len(found) > MAX_LISTED else {}
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


def _withdrawn(one: Participant, identifier: str) -> dict[str, Any]:
    """Describe what is due to a participant who withdrew, for a researcher who knows the id. The
    code of the row that stays would lead to the assigned condition.
    """
    unknown = dict.fromkeys(("started", "lastSeen", "finished", "minutes"))
    due = {"outcome": one.completion or LEFT, "completionCode": one.completion_code}
    return {**_described(one), **unknown, **due, "id": identifier, "participant": "", "step": ""}
