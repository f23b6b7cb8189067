"""Deletes the data of participants who withdraw.

A new row with only the fields of `KEPT`, another id and another code replaces the participant's, so
that the study's numbers still add up; theirs is deleted with all that refers to it.
docs/explanation/privacy.md says what stays and why.

A living drive is ended at once. Until the session manager has informed its pages and closed its
record, the participant's row waits for it, without the user.
"""

from collections.abc import Iterator
from datetime import UTC, date, datetime, time, timedelta
from hashlib import sha256
from typing import Any

from django.contrib.admin.models import LogEntry
from django.contrib.auth import SESSION_KEY
from django.contrib.sessions.models import Session as BrowserSession
from django.db import transaction
from django.db.models import Max, QuerySet
from django.utils import timezone

from accounts import audit
from experiments.export import reports
from experiments.extraction.people import EXPOSED, stages_of
from experiments.models import (
    Contact,
    Draw,
    Drive,
    Participant,
    ParticipantKind,
    PersonalLink,
    Study,
    not_drawn,
)
from experiments.participation import completion, progress, questions
from experiments.recruitment import recognition
from sessions.leases import store
from sessions.models import Session, Snapshot
from sessions.shards.ownership import EVERYTHING, Ownership
from surveys.models import Response

Stage, Status = Participant.Stage, Participant.Status
WITHDRAWN = "withdrawn"  # the reason of a session that was ended by it
# The fields of the row that stays; all others have their defaults.
KEPT = (
    *("study", "kind", "access", "status", "cell", "conditions", "draws_applied", "stage"),
    "recruitment_id",  # only a keyed hash: experiments/recruitment/recognition.py
    *("completion", "completion_code", "withdrawn_at", "withdrawn_step", "withdrawn_stage"),
)
# Of each of their draws, so that those of others can still be checked; not the time, the seed, and
# the participant's answers.
KEPT_OF_DRAWS = (
    *("study_id", "kind", "number", "nth", "reason", "cell", "best", "counts"),
    "best_probability",
)
LEFT = "withdrawn:"  # prefix of the slot of a row that stays
MAX_REQUEST = timedelta(minutes=1)  # duration of a withdrawal on a busy computer


def withdraw(participant: Participant, now: datetime) -> Participant:
    """Withdraw a participant, at any time; return the row that stays. May be repeated."""
    if participant.slot.startswith(LEFT):
        return participant
    _strip(participant, now)
    clear_settled(now=now)
    reports.forget(participant.study)
    return Participant.objects.get(slot__in=(str(participant.pk), _slot_after(participant)))


def leave(participant: Participant, now: datetime) -> None:
    """Withdraw a participant. A guest's account, of no other use, goes with the last study."""
    user = participant.user
    withdraw(participant, now)
    if user is not None and user.is_guest and not progress.of_user(user).exists():
        delete_everything(user, now)


def is_driving(user: Any) -> bool:
    return Session.objects.filter(visitor=user).exclude(state=Session.State.ENDED).exists()


def delete_everything(user: Any, now: datetime) -> bool:
    """Delete an account; False while the user drives, and for the site's administrators."""
    if is_driving(user) or user.is_staff:
        return False
    for participant in progress.of_user(user):
        withdraw(participant, now)
    audit.note("account_deleted", actor=user, person=user, at=now)
    # the browser sessions contain the user's id, and other data of pages
    for session in BrowserSession.objects.iterator():
        if session.get_decoded().get(SESSION_KEY) == str(user.pk):
            session.delete()
    user.delete()
    return True


def withdraw_everywhere(instance: Any, **_more: Any) -> None:
    """Withdraw a user from all studies: a receiver of the signal before an account's deletion."""
    for participant in progress.of_user(instance):
        withdraw(participant, timezone.now())
    LogEntry.objects.filter(object_id=str(instance.pk)).delete()
    if instance.is_guest:  # made for one study: when it was made is when they joined
        audit.unlink([f"user:{instance.pk}"], person=instance)


def forget_undecided(before: datetime, *, dry_run: bool) -> int:
    """Delete who those are who did not agree to the consent and were last seen before a moment, and
    by which link they came; return their number. Their rows still count who came.
    """
    rows = Participant.objects.filter(seen_at__lt=before, consents=None, cell="").exclude(user=None)
    undecided = [
        one
        for one in rows.filter(kind=ParticipantKind.PARTICIPANT).select_related("study")
        if one.study.as_definition().consent is not None
    ]
    for one in () if dry_run else undecided:
        none: dict[str, Any] = {"user": None, "recruitment": {}, "recruitment_id": ""}
        own = {"slot": str(one.pk), "recruited_as": not_drawn()}
        Participant.objects.filter(pk=one.pk).update(**none, **own)
    return len(undecided)


def _strip(participant: Participant, now: datetime) -> None:
    """Delete all that can be deleted at once; the slot marks that it is done."""
    _mark(participant, now)
    if participant.user is not None:
        for drive in participant.drives.exclude(session__state=Session.State.ENDED):
            store.end(str(drive.session_id), Session.Outcome.CANCELLED, WITHDRAWN, now)
    _unlink(participant)
    responses_of(participant).delete()
    PersonalLink.objects.filter(participant=participant).delete()
    Contact.objects.filter(participant=participant).delete()
    for rows in (participant.consents, participant.step_visits, participant.appointments):
        rows.all().delete()
    none: dict[str, Any] = {
        "user": None,
        "age": None,
        "language": "",
        "recruitment": {},
    }
    slot = str(participant.pk)
    Participant.objects.filter(pk=participant.pk).exclude(slot=slot).update(
        slot=slot,
        recruited_as=not_drawn(),
        recruitment_id=recognition.kept_after_withdrawal(participant),
        seen_at=_begin_of(now.date()),
        **none,
    )


def _mark(participant: Participant, now: datetime) -> None:
    """Store the day, the step and the stage of the withdrawal, and release or fill the place. The
    completion and its code, or else the code of leaving, stay: all with the same ending have the
    same code, and may still need it.
    """
    rows = Participant.objects.filter(pk=participant.pk)
    stage = stages_of(participant.study, [participant])[participant.pk]
    place = {"withdrawn_step": participant.step, "withdrawn_stage": stage}
    _ending, code = completion.on_leaving(participant)
    times = {"seen_at": now, "finished_at": None, "withdrawn_at": now.date()}
    left = {"status": Status.WITHDRAWN, "completion_code": code, **times, **place}
    staying = rows.exclude(status=Status.WITHDRAWN)
    if staying.update(**left):
        audit.note("withdrawn", study=participant.study.slug, at=_begin_of(now.date()))
    was_exposed = participant.task_drives.filter(EXPOSED).exists()
    rows.filter(stage=Stage.UNDER_WAY).update(stage=Stage.FILLED if was_exposed else Stage.FREED)


def responses_of(participant: Participant) -> "QuerySet[Response]":
    return Response.objects.filter(context__startswith=questions.context_of_all(participant))


def _begin_of(day: date) -> datetime:
    return datetime.combine(day, time(), UTC)


def _unlink(participant: Participant) -> None:
    """Remove the participant from the audit log, and their rows from the administration's log,
    whose texts may quote anything.
    """
    rows = list(_log_names(participant))
    things = [name for model, key in rows for name in (key, f"{model}:{key}")]
    audit.unlink(things, person=participant.user, study=participant.study.slug)
    LogEntry.objects.filter(object_id__in=[key for _, key in rows]).delete()


def _log_names(participant: Participant) -> Iterator[tuple[str, str]]:
    """Yield (model, key) of the participant's rows."""
    sessions = Session.objects.filter(drive__participant=participant)
    own = Participant.objects.filter(pk=participant.pk)
    snapshots = Snapshot.objects.filter(session__in=sessions)
    linked = (participant.drives.all(), participant.links.all(), responses_of(participant))
    for rows in (own, *linked, sessions, snapshots):
        name = str(rows.model._meta.model_name)
        yield from ((name, str(key)) for key in rows.values_list("pk", flat=True))


def clear_settled(*, now: datetime, ownership: Ownership = EVERYTHING, **_more: Any) -> None:
    """Delete the drives of withdrawn participants, with all that was recorded, once their records
    are closed; then replace the participants' rows. Only the owner of the site does so. It finishes
    interrupted withdrawals, but leaves those alone that a request may still be working on: without
    the row, the request would not find the rest of the data.
    """
    if not ownership.owns_site:
        return
    waiting = Participant.objects.filter(status=Status.WITHDRAWN).exclude(slot__startswith=LEFT)
    for participant in waiting.select_related("study", "user"):
        if participant.slot != str(participant.pk):
            if now - participant.seen_at < MAX_REQUEST:
                continue
            _strip(participant, now)
        drives = Drive.objects.filter(participant=participant)
        closed = drives.filter(settled_at__isnull=False, session__closed_at__isnull=False)
        keys = list(closed.values_list("session", flat=True))
        if keys:
            _unlink(participant)
            Session.objects.filter(pk__in=keys).delete()
        if not drives.exists():
            _replace(participant)


def _replace(participant: Participant) -> None:
    """Replace the participant's row by one with only `KEPT`. Without transactions, the slot of the
    new row keeps a second one from being made when this is repeated after an interruption.
    """
    begin = _begin_of(participant.withdrawn_at or participant.seen_at.date())
    kept = {name: getattr(participant, name) for name in KEPT}
    times = {"created_at": _published_before(participant) or begin, "seen_at": begin}
    fields = {**kept, "language": "", **times}
    slot = _slot_after(participant)
    with transaction.atomic():
        row, _made = Participant.objects.get_or_create(slot=slot, defaults=fields)
        draws = list(participant.draws.values(*KEPT_OF_DRAWS))
        participant.draws.all().delete()  # their numbers are unique
        Draw.objects.bulk_create(Draw(participant=row, **draw) for draw in draws)
        Participant.objects.filter(pk=participant.pk).delete()


def _published_before(participant: Participant) -> datetime | None:
    """Return when the version was published that was the newest when a participant joined: it tells
    which plans are older than their data, and nothing about the person.
    """
    versions = Study.objects.filter(slug=participant.study.slug)
    before = versions.filter(published_at__lte=participant.created_at)
    return before.aggregate(last=Max("published_at"))["last"]


def _slot_after(participant: Participant) -> str:
    return LEFT + sha256(str(participant.pk).encode()).hexdigest()
