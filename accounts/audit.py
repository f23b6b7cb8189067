"""The audit log: who did what to whom, when. Entries are added and name people by their ids alone.
Nothing changes them but `unlink`, when somebody leaves a study.
"""

import datetime
from collections.abc import Iterable
from typing import Any

from django.db.models import Q, QuerySet
from django.utils import timezone

from accounts.models import AuditEntry


def note(
    act: str,
    *,
    actor: Any = None,
    person: Any = None,
    robot: Any = "",
    study: str = "",
    thing: Any = "",
    detail: str = "",
    at: datetime.datetime | None = None,
) -> AuditEntry:
    """Add an entry.

    Args:
        act: what was done, in snake_case.
        actor: the user who did it; None for a command, an agent, or nobody in particular.
        person: the user to whom it was done.
        robot: the robot or its name.
        study: the study's name.
        thing: the id or name of what it was done to.
        detail: a few words more, none of them about a person.
        at: when; now by default.
    """
    return AuditEntry.objects.create(
        at=at or timezone.now(),
        act=act[:40],
        actor=_key(actor),
        person=_key(person),
        robot=getattr(robot, "name", robot)[:63],
        study=study[:40],
        thing=str(getattr(thing, "pk", thing))[:80],
        detail=detail[:200],
    )


def forget(before: datetime.datetime, *, dry_run: bool = False) -> int:
    """Delete the entries that are older; the one way to lose some. Return how many there are, or
    were.
    """
    rows: QuerySet[AuditEntry] = QuerySet(AuditEntry).filter(at__lt=before)
    return rows.count() if dry_run else rows.delete()[0]


def unlink(things: Iterable[str] = (), *, person: Any = None, study: str = "") -> int:
    """Take out of entries what leads to somebody who has left: their id, the id of the item, and
    the time of day. The day, the action, the study and who of the staff did it stay. Return how
    many entries there were.

    Args:
        things: the items that were theirs, as `note` was given them.
        person: the user, or the user's id.
        study: the study that was left; empty when the whole account goes.
    """
    key = _key(person)
    about = Q(thing__in=list(things))
    if key is not None:
        own = Q(person=key) | Q(actor=key)
        about |= own & Q(study=study) if study else own
    rows: QuerySet[AuditEntry] = QuerySet(AuditEntry)
    found = list(rows.filter(about).values_list("pk", "at", "actor", "person"))
    for entry, at, actor, whom in found:
        day = at.replace(hour=0, minute=0, second=0, microsecond=0)
        staff = None if actor in {key, whom} else actor
        rows.filter(pk=entry).update(at=day, actor=staff, person=None, thing="")
    return len(found)


def _key(user: Any) -> Any:
    return (
        None
        if user is None or not getattr(user, "is_authenticated", True)
        else getattr(user, "pk", user)
    )


def note_administration(instance: Any, created: bool, **_more: Any) -> None:
    """Note what the administration writes into its own log, whose words may name people."""
    if created:
        kind = instance.content_type
        act = {1: "admin_added", 2: "admin_changed", 3: "admin_deleted"}.get(
            instance.action_flag, "admin_did"
        )
        note(
            act, actor=instance.user_id, thing=f"{kind.model if kind else ''}:{instance.object_id}"
        )
