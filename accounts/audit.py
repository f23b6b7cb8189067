"""The audit log: who did what to whom, and when. Entries name people by their ids alone, and only
`unlink` changes them, when a person leaves.
"""

import datetime
from collections.abc import Iterable
from typing import Any, Literal

from django.contrib.admin.models import ADDITION, CHANGE, DELETION
from django.db.models import Q, QuerySet
from django.utils import timezone

from accounts.interventions import INTERVENTIONS
from accounts.models import AuditEntry

# The acts that hand out copies of what was recorded of people, with their scope: everybody in the
# study or in the version that the entry's item names, the session that is its item, or all who
# drove or answered. People who withdraw learn of those that may have their data.
COPIES: dict[str, Literal["study", "version", "session", "driver", "respondent"]] = {
    "study_exported": "version",
    "analysis_exported": "version",
    "study_deposited": "version",
    "payments_exported": "study",
    "participants_read_by_api": "study",
    "coding_exported": "session",
    "session_exported": "session",
    "sessions_exported": "driver",
    "answers_exported": "respondent",
}


def note(act: str, **about: Any) -> AuditEntry:
    """Add an entry; the arguments are those of `entry`."""
    row = entry(act, **about)
    row.save(force_insert=True)
    return row


def entry(
    act: str,
    *,
    actor: Any = None,
    person: Any = None,
    robot: Any = "",
    study: str = "",
    thing: Any = "",
    detail: str = "",
    role: str = "",
    data: dict[str, Any] | None = None,
    at: datetime.datetime | None = None,
    pk: Any = None,
) -> AuditEntry:
    """Return an entry that is not stored yet.

    Args:
        act: what was done, in snake_case.
        actor: the user who did it; None for a command or an agent.
        person: the user to whom it was done.
        robot: the robot or its name.
        study: the study's name.
        thing: the id or name of what it was done to.
        detail: a few more words, none of them about a person.
        role: of who intervened in a robot's safety (accounts/interventions.py).
        data: figures and values, none of them about a person.
        at: when; now by default.
        pk: the same for every copy of one message; a new one by default.
    """
    return AuditEntry(
        **({} if pk is None else {"pk": pk}),
        at=at or timezone.now(),
        act=act[:40],
        actor=_key(actor),
        person=_key(person),
        robot=getattr(robot, "name", robot)[:63],
        study=study[:40],
        thing=str(getattr(thing, "pk", thing))[:80],
        detail=detail[:200],
        role=role[:20],
        data=data or {},
    )


def forget(before: datetime.datetime, *, dry_run: bool = False) -> int:
    """Delete the entries that are older, or count them; interventions stay, without the person
    affected. Nothing but this and `forget_interventions` deletes entries.
    """
    rows: QuerySet[AuditEntry] = QuerySet(AuditEntry).filter(at__lt=before)
    others = rows.exclude(act__in=INTERVENTIONS)
    if dry_run:
        return others.count()
    rows.filter(act__in=INTERVENTIONS).exclude(person=None).update(person=None)
    return others.delete()[0]


def forget_interventions(before: datetime.datetime, *, dry_run: bool = False) -> int:
    """Delete the interventions that are older, or count them."""
    rows: QuerySet[AuditEntry] = QuerySet(AuditEntry).filter(at__lt=before, act__in=INTERVENTIONS)
    return rows.count() if dry_run else rows.delete()[0]


def unlink(things: Iterable[str] = (), *, person: Any = None, study: str = "") -> int:
    """Remove from entries what identifies a person who has left: their id, the id of the item, and
    the time of day. The day, the action, the study and the id of staff stay. Return the number of
    entries.

    Args:
        things: the person's items, as `note` was given them.
        person: the user, or the user's id.
        study: the study that was left; empty when the whole account is deleted.
    """
    key = _key(person)
    about = Q(thing__in=list(things))
    if key is not None:
        own = Q(person=key) | Q(actor=key)
        about |= own & Q(study=study) if study else own
    rows: QuerySet[AuditEntry] = QuerySet(AuditEntry)
    found = list(rows.filter(about).values_list("pk", "at", "actor", "person"))
    for entry, at, actor, affected in found:
        day = at.replace(hour=0, minute=0, second=0, microsecond=0)
        staff = None if actor in {key, affected} else actor
        rows.filter(pk=entry).update(at=day, actor=staff, person=None, thing="")
    return len(found)


def _key(user: Any) -> Any:
    return getattr(user, "pk", user) if getattr(user, "is_authenticated", True) else None


def note_administration(instance: Any, created: bool, **_more: Any) -> None:
    """Copy an entry of the administration's own log, without its text, which may name people."""
    if created:
        acts = {ADDITION: "admin_added", CHANGE: "admin_changed", DELETION: "admin_deleted"}
        kind = instance.content_type.model if instance.content_type else ""
        note(
            acts.get(instance.action_flag, "admin_did"),
            actor=instance.user_id,
            thing=f"{kind}:{instance.object_id}",
        )
