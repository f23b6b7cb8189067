"""Members and shards in the database. Every change is one conditional update, so that of several
processes that try the same change one succeeds.
"""

import datetime
from collections.abc import Collection
from typing import Any

from django.db import IntegrityError, transaction
from django.db.models import F

from sessions.models import ManagerBeat, Shard
from sessions.shards.division import ALL, Holding, ManagerSlot

NAME = "session_manager"  # the row of slot 0; the others' end with a dash and the slot
LEFT = "left_at"  # in the report of a slot that was given back: Unix seconds
LONG_AGO = datetime.datetime(2000, 1, 1, tzinfo=datetime.UTC)


def name_of(slot: int) -> str:
    """Return the name of a slot's row."""
    return f"{NAME}-{slot}" if slot else NAME


def _slot_of(name: str) -> int:
    return int(name.removeprefix(NAME).removeprefix("-") or 0)


def members() -> list[ManagerSlot]:
    """Read every slot that was ever occupied, in the order of their numbers."""
    rows = ManagerBeat.objects.filter(name__startswith=NAME).values_list(
        "name", "holder", "beats", "report"
    )
    return sorted(
        (
            ManagerSlot(_slot_of(name), holder, beats, tuple(report.get("prepared", ())))
            for name, holder, beats, report in rows
        ),
        key=lambda member: member.slot,
    )


def occupy(slot: int, before: ManagerSlot | None, holder: str, now: datetime.datetime) -> bool:
    """Take a slot from the member read in it (None: no row); False when it has changed."""
    if before is None:
        try:
            with transaction.atomic():
                ManagerBeat.objects.create(name=name_of(slot), holder=holder, beat_at=now, beats=1)
        except IntegrityError:
            return False
        return True
    return bool(
        _unchanged(before).update(holder=holder, beat_at=now, beats=before.beats + 1, report={})
    )


def dismiss(member: ManagerSlot) -> bool:
    """Free the slot of a member that counts as dead; False when it has beaten since."""
    return bool(_unchanged(member).update(holder="", beats=member.beats + 1, report={}))


def _unchanged(member: ManagerSlot) -> Any:
    return ManagerBeat.objects.filter(
        name=name_of(member.slot), holder=member.holder, beats=member.beats
    )


def beat(slot: int, holder: str, beats: int, now: datetime.datetime, report: Any) -> bool:
    """Count a holder's beat; False when the slot is not its own any more.

    `report` is how the holder does (ActiveManager.report), for the web processes that answer
    /readyz and /metrics.
    """
    mine = ManagerBeat.objects.filter(name=name_of(slot), holder=holder)
    return bool(mine.update(beats=beats, beat_at=now, report=report))


def give_back(holder: str) -> None:
    """Free a holder's slot at once; the report says when it was last alive."""
    mine = ManagerBeat.objects.filter(holder=holder)
    for beat_at in mine.values_list("beat_at", flat=True):
        mine.update(holder="", beat_at=LONG_AGO, report={LEFT: beat_at.timestamp()})


def last_alive() -> datetime.datetime | None:
    """Return when any session manager was last alive; None when there never was any."""
    times = []
    for beat_at, report in ManagerBeat.objects.values_list("beat_at", "report"):
        if beat_at != LONG_AGO:
            times.append(beat_at)
        elif LEFT in report:
            times.append(datetime.datetime.fromtimestamp(report[LEFT], datetime.UTC))
    return max(times, default=None)


def holdings() -> list[Holding]:
    """Read every shard; rows that are missing are made, without an owner."""
    rows = [Holding(*row) for row in Shard.objects.values_list("number", "owner", "epoch")]
    missing = set(ALL) - {row.number for row in rows}
    if not missing:
        return rows
    try:
        with transaction.atomic():
            Shard.objects.bulk_create(Shard(number=number) for number in sorted(missing))
    except IntegrityError:
        return holdings()
    return [*rows, *(Holding(number, "", 0) for number in sorted(missing))]


def take_over(numbers: Collection[int], owners: Collection[str], holder: str) -> None:
    """Take those of these shards that still have one of these owners, under new epochs."""
    orphans = Shard.objects.filter(number__in=numbers, owner__in=owners)
    orphans.update(owner=holder, epoch=F("epoch") + 1)


def hand_over(numbers: Collection[int], giver: str, heir: str) -> None:
    """Give one's own shards to another member, under new epochs."""
    mine = Shard.objects.filter(number__in=numbers, owner=giver)
    mine.update(owner=heir, epoch=F("epoch") + 1)
