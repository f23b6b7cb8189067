"""Taking somebody out of a study for good.

What stays is listed, and everything else goes: a new row with the fields of `KEPT` takes the place
of the participant's, so that the study's numbers still add up, and theirs is deleted with all that
hangs on it. The new row has another id and another code. docs/explanation/privacy.md says what
stays and why.

A drive that still lives is ended at once. Until the session manager has told everybody so and
closed its record, the participant's row waits for it, without the user.
"""

import datetime
from collections.abc import Iterator
from hashlib import sha256
from typing import Any

from django.contrib.admin.models import LogEntry
from django.db import transaction
from django.db.models import QuerySet
from django.utils import timezone

from accounts import audit
from experiments.export import reports
from experiments.extraction.people import EXPOSED, stages_of
from experiments.models import Contact, Draw, Drive, Participant, PersonalLink, not_drawn
from experiments.participation import progress, questions
from sessions.leases import store
from sessions.models import Session, Snapshot
from sessions.shards.ownership import EVERYTHING, Ownership
from surveys.models import Response

Stage, Status = Participant.Stage, Participant.Status
WITHDRAWN = "withdrawn"  # the reason of a session that was ended by it
# The fields of the row that stays; the others are as in a row that nobody ever filled.
KEPT = (
    "study",
    "kind",
    "access",
    "status",
    "cell",
    "conditions",
    "draws_applied",
    "stage",
    "completion",
    "completion_code",
    "withdrawn_at",
    "withdrawn_step",
    "withdrawn_stage",
)
# Of each of their draws, so that those of others can still be checked: neither time nor seed, nor
# what the participant told of themself.
KEPT_OF_DRAWS = (
    "study_id",
    "kind",
    "number",
    "nth",
    "reason",
    "cell",
    "best",
    "counts",
    "best_probability",
)
LEFT = "withdrawn:"  # begins the slot of such a row
A_REQUEST = datetime.timedelta(minutes=1)  # for which one may take on a busy computer


def withdraw(participant: Participant, now: datetime.datetime) -> Participant:
    """Take somebody out of a study, at any step, also when it is done; return the row that is left.
    A second call does nothing more.
    """
    if participant.slot.startswith(LEFT):
        return participant
    _strip(participant, now)
    clear_settled(now=now)
    reports.forget(participant.study)
    return Participant.objects.get(slot__in=(str(participant.pk), _slot_after(participant)))


def _strip(participant: Participant, now: datetime.datetime) -> None:
    """Delete all that can go at once; the slot says that it is done."""
    _mark(participant, now)
    if participant.user is not None:
        _end_drives(participant, now)
    _unlink(participant)
    responses_of(participant).delete()
    PersonalLink.objects.filter(participant=participant).delete()
    Contact.objects.filter(participant=participant).delete()
    for rows in (participant.consents, participant.step_visits, participant.appointments):
        rows.all().delete()
    Participant.objects.filter(pk=participant.pk).update(
        user=None,
        slot=str(participant.pk),
        recruitment={},
        recruitment_id="",
        recruited_as=not_drawn(),
        age=None,
        language="",
        seen_at=_begin_of(now.date()),
    )


def _mark(participant: Participant, now: datetime.datetime) -> None:
    """Note the day, the step and how far the participant came, and what becomes of the place. The
    completion stays: everybody who ends alike has the same code, and may still need it.
    """
    rows = Participant.objects.filter(pk=participant.pk)
    stage = stages_of(participant.study, [participant])[participant.pk]
    told = {"withdrawn_at": now.date(), "withdrawn_step": participant.step}
    told |= {"status": Status.WITHDRAWN, "seen_at": now, "finished_at": None}
    if rows.exclude(status=Status.WITHDRAWN).update(withdrawn_stage=stage, **told):
        audit.note("withdrawn", study=participant.study.slug, at=_begin_of(now.date()))
    was_exposed = participant.drives.filter(EXPOSED).exists()
    rows.filter(stage=Stage.UNDER_WAY).update(stage=Stage.FILLED if was_exposed else Stage.FREED)


def _end_drives(participant: Participant, now: datetime.datetime) -> None:
    for drive in participant.drives.exclude(session__state=Session.State.ENDED):
        store.end(str(drive.session_id), Session.Outcome.CANCELLED, WITHDRAWN, now)


def responses_of(participant: Participant) -> "QuerySet[Response]":
    return Response.objects.filter(context__startswith=questions.context_of_all(participant))


def _begin_of(day: datetime.date) -> datetime.datetime:
    return datetime.datetime.combine(day, datetime.time(), datetime.UTC)


# --- logs -----------------------------------------------------------------------------------------


def _unlink(participant: Participant) -> None:
    """Take the participant out of the audit log, and what was theirs out of the administration's
    log, whose words may quote anything.
    """
    items = list(_items(participant))
    things = [name for model, key in items for name in (key, f"{model}:{key}")]
    audit.unlink(things, person=participant.user, study=participant.study.slug)
    LogEntry.objects.filter(object_id__in=[key for _, key in items]).delete()


def _items(participant: Participant) -> Iterator[tuple[str, str]]:
    sessions = Session.objects.filter(drive__participant=participant)
    rows: tuple[QuerySet[Any], ...] = (
        Participant.objects.filter(pk=participant.pk),
        participant.drives.all(),
        participant.links.all(),
        responses_of(participant),
        sessions,
        Snapshot.objects.filter(session__in=sessions),
    )
    for some in rows:
        name = str(some.model._meta.model_name)
        yield from ((name, str(key)) for key in some.values_list("pk", flat=True))


# --- the row that stays ---------------------------------------------------------------------------


def clear_settled(
    *, now: datetime.datetime, ownership: Ownership = EVERYTHING, **_more: Any
) -> None:
    """Delete the drives of those who withdrew, with all that was recorded, once nobody writes on
    them any more; then what is left of the participants themselves. Only the owner of the site does
    so, and leaves alone whom a request is just taking out: without the row it would not find what
    else is theirs. What such a request did not finish is finished here.
    """
    if not ownership.owns_site:
        return
    waiting = Participant.objects.filter(status=Status.WITHDRAWN).exclude(slot__startswith=LEFT)
    for participant in waiting.select_related("study", "user"):
        if participant.slot != str(participant.pk):
            if now - participant.seen_at < A_REQUEST:
                continue
            _strip(participant, now)
        drives = Drive.objects.filter(participant=participant)
        over = drives.filter(settled_at__isnull=False, session__closed_at__isnull=False)
        keys = list(over.values_list("session", flat=True))
        if keys:
            _unlink(participant)
            Session.objects.filter(pk__in=keys).delete()
        if not drives.exists():
            _replace(participant)


def _replace(participant: Participant) -> None:
    """Put a row in the place of the participant's that has nothing of it but `KEPT`.

    Where there are no transactions, the slot of the new row keeps a second one from being made when
    this is cut off and done again.
    """
    begin = _begin_of(participant.withdrawn_at or participant.seen_at.date())
    fields = {name: getattr(participant, name) for name in KEPT}
    told = {**fields, "language": "", "created_at": begin, "seen_at": begin}
    with transaction.atomic():
        row, _made = Participant.objects.get_or_create(slot=_slot_after(participant), defaults=told)
        draws = list(participant.draws.values(*KEPT_OF_DRAWS))
        participant.draws.all().delete()  # their numbers are unique
        Draw.objects.bulk_create(Draw(participant=row, **draw) for draw in draws)
        Participant.objects.filter(pk=participant.pk).delete()


def _slot_after(participant: Participant) -> str:
    return LEFT + sha256(str(participant.pk).encode()).hexdigest()


# --- with the account -----------------------------------------------------------------------------


def withdraw_everywhere(instance: Any, **_more: Any) -> None:
    """Take somebody out of all their studies, and out of the logs what leads to them: a receiver of
    Django's signal before an account is deleted, by whomever.
    """
    for participant in progress.of_user(instance):
        withdraw(participant, timezone.now())
    LogEntry.objects.filter(object_id=str(instance.pk)).delete()
    if instance.is_guest:  # made for one study: when it was made is when they joined
        audit.unlink([f"user:{instance.pk}"], person=instance)
