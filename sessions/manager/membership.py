"""The membership of one process among the session managers: its slot, heartbeats and shards.

A process takes the lowest free slot, after it has seen every lower one beat. A member that stops
cleanly gives its slot back. One that is killed is dismissed at once by a member on the same
computer, which knows that it is dead (sessions/manager/lock_file.py), and by any other when its
beats have stopped (sessions/shards/division.py). A process that has lost its slot ends its work,
and joins again under another name.
"""

import os
import secrets
import socket
import time
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import structlog
from django.db import DatabaseError, InterfaceError
from django.utils import timezone

from sessions.disk_full import is_disk_full
from sessions.leases.absences import note_manager_absence
from sessions.manager.database_thread import DatabaseThread
from sessions.manager.health import ManagerHealth
from sessions.manager.lock_file import LockFile
from sessions.models import STALE_SECONDS
from sessions.shards import rows
from sessions.shards.division import ALL, Holding, ManagerSlot, Observer, claims, gifts, occupied
from sessions.shards.hashing import N_SHARDS, share_of
from sessions.shards.ownership import Ownership

logger = structlog.stdlib.get_logger(__name__)

ALONE_INTERVAL_S = 1.0  # between two beats
SHARED_INTERVAL_S = 0.4  # of several members: a takeover takes less than 2 s
WAIT_SECONDS = 0.5  # between two attempts to join


class Membership:
    """From joining to leaving, again and again.

    Args:
        lock_files: the folder of the lock files of this computer.
        health: receives the outcome of beats.
        clock: monotonic seconds.
        table: the functions of sessions/shards/rows.py.
    """

    def __init__(
        self,
        lock_files: Path,
        health: ManagerHealth,
        clock: Callable[[], float] = time.monotonic,
        table: Any = rows,
    ) -> None:
        self._folder = lock_files
        self._table = table
        self._thread = DatabaseThread("heartbeat", health)
        self._clock = clock
        self._locks: dict[int, LockFile] = {}
        self._begin_anew()

    def _begin_anew(self) -> None:
        self.holder = f"{socket.gethostname()}:{os.getpid()}:{secrets.token_hex(4)}"
        self.slot = -1
        self.ownership = Ownership(self._clock)
        self.gifts: Mapping[str, frozenset[int]] = MappingProxyType({})
        self.departed: set[int] = set()  # slots that were left; read and cleared by the service
        self._beats = 1
        self._observer = Observer()
        self._others: set[int] = set()

    @property
    def interval(self) -> float:
        """Seconds until the next beat."""
        return SHARED_INTERVAL_S if self._others else ALONE_INTERVAL_S

    async def join(self) -> bool:
        """Take a slot; False while none is known to be free, or the database is away."""
        return bool(await self._thread.attempt(self._join, refused=False))

    async def beat(self, report: dict[str, Any]) -> bool:
        """Store that this process is alive, with its report; False when it has lost its slot.

        While the database is away, no process can take the slot, and this one continues.
        """
        return bool(await self._thread.attempt(self._beat, report, refused=True))

    async def release(self, numbers: Collection[int]) -> None:
        """Give up these shards, except for writing what was received of them."""
        await self._thread.run(self._release, numbers)

    async def hand_over(self, given: Mapping[str, frozenset[int]]) -> None:
        """Give released shards to others; those that the database refuses stay here."""
        await self._thread.attempt(self._hand_over, given)

    async def leave(self) -> None:
        """Give the slot back."""
        self.ownership.become({})
        self.ownership.leaving = MappingProxyType({})
        await self._thread.attempt(self._table.give_back, self.holder)
        self._free_locks()
        self._begin_anew()

    async def close(self) -> None:
        """End the thread."""
        await self._thread.close()

    # --- in the thread ----------------------------------------------------------------------------

    def _join(self) -> bool:
        """Take the first slot without a living holder; False while it cannot be determined.

        Several processes may try at once: `occupy` compares with the row that was read, so that
        one of them gets the slot. A holder counts as dead if its lock file on this machine is free,
        or if its beat has not changed for long enough by our own clock; clocks of two machines are
        never compared. A slot is passed over only if its holder is known to be alive.
        """
        members = self._table.members()
        self._observer.see(members, self._clock())
        slot, before = 0, {member.slot: member for member in members}
        while (there := before.get(slot)) is not None and not self._is_free(there):
            if not self._observer.is_alive(there, self._clock()):
                return False
            slot += 1
        last, began, now = self._table.last_alive(), self._clock(), timezone.now()
        self._lock_of(slot).predecessor()
        if not self._table.occupy(slot, before.get(slot), self.holder, now):
            return False
        self.slot = slot
        self._free_locks(but=slot)
        self._lock_of(slot).sign(self.holder)
        self._observer = Observer()  # others have the longer time until they know of this one
        self._settle(self._table.members(), began)
        if not self._others and last and (now - last).total_seconds() > STALE_SECONDS:
            note_manager_absence(last, now)
        return True

    def _is_free(self, member: ManagerSlot) -> bool:
        """Tell whether a slot has no living holder."""
        return (
            not member.holder
            or self._lock_of(member.slot).predecessor() == member.holder
            or self._observer.is_silent(member, self._clock())
        )

    def _beat(self, report: dict[str, Any]) -> bool:
        """Store this process's beat, dismiss dead processes and settle the shards; False when
        another process has taken the slot.

        Shards are owned for a limited time from the beginning of a successful beat. If the database
        fails and no other process is known, none can have taken the slot, and ownership continues.
        """
        began = self._clock()
        self._beats += 1
        report |= {"shards": len(self.ownership.epochs)}
        try:
            if not self._table.beat(self.slot, self.holder, self._beats, timezone.now(), report):
                return False
        except (DatabaseError, InterfaceError) as error:
            if not self._others or is_disk_full(error):  # no other process can have taken our slot
                self.ownership.confirm(self._clock())
            raise
        self._lock_of(self.slot).predecessor()  # if another process looked at it when we joined
        self._lock_of(self.slot).sign(self.holder)
        members = self._table.members()
        self._observer.see(members, self._clock())
        dead = [one for one in members if self._is_other(one) and self._is_free(one)]
        for one in dead:
            self._dismiss(one)
        self._free_locks(but=self.slot)
        members = self._table.members() if dead else members
        self._settle(members, began)
        return True

    def _is_other(self, member: ManagerSlot) -> bool:
        return bool(member.holder) and member.slot != self.slot

    def _dismiss(self, member: ManagerSlot) -> None:
        if self._table.dismiss(member):
            logger.warning("session_manager_dismissed", slot=member.slot, holder=member.holder)

    def _settle(self, members: list[ManagerSlot], began: float) -> None:
        """Take the shards that are due to this process, and find those that are due to others."""
        slots = tuple(sorted(occupied(members)))
        others = set(slots) - {self.slot}
        self.departed |= self._others - others
        self._others = others
        ownership = self.ownership
        ownership.was_shared = ownership.was_shared or len(members) > 1
        if others or slots != ownership.slots or not ownership.is_whole:
            held = self._take_due(members)
            ownership.slots = slots
            share = ALL if not others else share_of(self.slot, slots, ALL)
            epochs = {one.number: one.epoch for one in held if one.owner == self.holder}
            ownership.become({n: e for n, e in epochs.items() if n not in ownership.leaving})
            ownership.wanted = frozenset(share) | ownership.epochs.keys()
            self.gifts = gifts(held, members, self.holder)
        ownership.confirm(began)

    def _take_due(self, members: list[ManagerSlot]) -> list[Holding]:
        held: list[Holding] = self._table.holdings()
        due = claims(held, members, self.slot)
        if not due:
            return held
        self._table.take_over(due, {one.owner for one in held if one.number in due}, self.holder)
        logger.info("shards_taken", holder=self.holder, shards=len(due), of=N_SHARDS)
        now_held: list[Holding] = self._table.holdings()
        return now_held

    def _release(self, numbers: Collection[int]) -> None:
        ownership = self.ownership
        ownership.leaving = MappingProxyType(
            {number: ownership.epochs[number] for number in numbers if number in ownership.epochs}
        )
        ownership.become(
            {number: epoch for number, epoch in ownership.epochs.items() if number not in numbers}
        )

    def _hand_over(self, given: Mapping[str, frozenset[int]]) -> None:
        try:
            for heir, numbers in given.items():
                self._table.hand_over(numbers & self.ownership.leaving.keys(), self.holder, heir)
                logger.info("shards_given", heir=heir, shards=len(numbers), of=N_SHARDS)
        finally:
            self.ownership.leaving = MappingProxyType({})

    # --- lock files -------------------------------------------------------------------------------

    def _lock_of(self, slot: int) -> LockFile:
        if slot not in self._locks:
            number = f"-{slot}" if slot else ""
            self._locks[slot] = LockFile(self._folder / f"session-manager{number}.lock")
        return self._locks[slot]

    def _free_locks(self, but: int = -1) -> None:
        for slot in [slot for slot in self._locks if slot != but]:
            self._locks.pop(slot).release()
