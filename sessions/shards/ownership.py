"""The shards that one session manager owns, for all its threads, and the fence around its writes.

A shard's epoch is a fencing token: it grows whenever the shard changes hands. Each write of the
session manager carries the epoch that the process knows and is refused when the row of the shard
has another one:

- An update names the epoch in its own condition (`condition`): no statement more.
- Anything else that the threads of scheduler and recorder write, in whichever app, is put into a
  transaction that first reads the epoch (`fenced`, a wrapper of a thread's statements). On
  PostgreSQL this read locks the rows against a change of hands until the transaction ends, and the
  server ends a transaction whose process has stopped. SQLite has one writer at a time, so that
  nothing can change between reading and writing.

With MongoDB, where the backend has neither, only the leases' own epochs and the times of
sessions/shards/division.py keep two owners apart.
"""

import contextlib
import re
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

from django.db import DatabaseError, connection, transaction
from django.db.models import Exists, Q

from sessions.models import Shard
from sessions.shards.division import ALL
from sessions.shards.hashing import N_SHARDS, SITE_SHARD, shard_of

# for which a process may act on its last beat: less than the silence after which others take over
CONFIRMED_SECONDS = 1.0
CONFIRMED_ALONE_SECONDS = 2.5
IDLE_LIMIT = "2000"  # ms for which PostgreSQL lets a stopped process keep its locks
_WRITE = re.compile(r"\s*(?:INSERT|UPDATE|DELETE|REPLACE)\b", re.IGNORECASE)
_TABLE = "telepresence_sessions_shard"
_LOCKED = (  # Django has no FOR SHARE; the limit holds for this transaction
    "SELECT number, epoch, set_config('idle_in_transaction_session_timeout', %s, true)"
    " FROM telepresence_sessions_shard WHERE number = ANY(%s) FOR SHARE"
)


class Fenced(DatabaseError):
    """Another session manager owns the shard by now."""


class Ownership:
    """Which shards are ours. One thread changes it, any other may read it at any time.

    Args:
        clock: monotonic seconds.
    """

    is_fenced = True

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.epochs: Mapping[int, int] = MappingProxyType({})
        self.wanted: frozenset[int] = (
            frozenset()
        )  # ours, or soon ours: we subscribe to their topics
        self.slots: tuple[int, ...] = ()  # by whose division they are wanted
        self.was_shared = False  # whether there ever was another slot
        # Given up, but another process gets them only when everything received is written.
        self.leaving: Mapping[int, int] = MappingProxyType({})
        self.version = 0  # grows with every change of `epochs`
        self._clock = clock
        self._confirmed_until = float("-inf")
        self._local = threading.local()

    # --- our shards -------------------------------------------------------------------------------

    def become(self, epochs: Mapping[int, int]) -> None:
        """Own exactly these shards from now on."""
        if dict(self.epochs) != dict(epochs):
            self.epochs = MappingProxyType(dict(epochs))
            self.version += 1

    def owns(self, robot: str) -> bool:
        """Tell whether the robot of this name is ours."""
        return shard_of(robot) in self.epochs

    def wants(self, robot: str) -> bool:
        """Tell whether to subscribe to the robot's topics."""
        return shard_of(robot) in self.wanted

    def records(self, robot: str) -> bool:
        """Tell whether this process may still write the record of a robot."""
        return self._epoch(shard_of(robot)) is not None

    def _epoch(self, number: int) -> int | None:
        return self.epochs.get(number, self.leaving.get(number))

    @property
    def owns_site(self) -> bool:
        """Whether the work that belongs to the whole site is ours."""
        return SITE_SHARD in self.epochs

    @property
    def is_whole(self) -> bool:
        """Whether every robot is ours and none is about to be given away."""
        return len(self.epochs) == len(self.wanted) == N_SHARDS

    def confirm(self, at: float) -> None:
        """Note a beat that began at `at` and succeeded, or that no process could have made."""
        lasts = CONFIRMED_SECONDS if len(self.slots) > 1 else CONFIRMED_ALONE_SECONDS
        self._confirmed_until = at + lasts

    @property
    def is_confirmed(self) -> bool:
        """Whether no other process can have taken our shards since the last beat: false in a
        process that has just resumed after a stop.
        """
        return self._clock() < self._confirmed_until

    # --- the fence --------------------------------------------------------------------------------

    def condition(self, robot: str) -> Q:
        """Return the condition of an update about a robot: its shard has our epoch."""
        number = shard_of(robot)
        epoch = self._epoch(number)
        if not self.is_fenced or connection.vendor == "mongodb":
            return Q()
        return Q(Exists(Shard.objects.filter(number=number, epoch=-1 if epoch is None else epoch)))

    def _check(self, numbers: Collection[int]) -> None:
        """Refuse the transaction that this is called in if one of these shards is not ours."""
        known = {number: self._epoch(number) for number in numbers}
        if not known:
            raise Fenced("no shard is ours")
        if None in known.values() or dict(_epochs(known)) != known:
            raise Fenced(f"shards {sorted(numbers)} have new epochs")

    @contextlib.contextmanager
    def about(self, *robots: str) -> Iterator[None]:
        """Have the writes in this block, in this thread, carry the epochs of these robots' shards;
        without any, of all shards that are ours.
        """
        before = getattr(self._local, "numbers", None)
        self._local.numbers = {shard_of(robot) for robot in robots}
        try:
            yield
        finally:
            self._local.numbers = before

    @contextlib.contextmanager
    def fenced(self) -> Iterator[None]:
        """Have every write in this block, in this thread, carry epochs: of the robots that it is
        about, otherwise of all shards that are ours. A write that is refused raises Fenced.
        """
        if not self.is_fenced:
            yield
            return
        with connection.execute_wrapper(self._carry):
            yield

    def _carry(
        self,
        execute: Callable[..., Any],
        sql: str,
        params: Any,
        many: bool,
        context: dict[str, Any],
    ) -> Any:
        if not _WRITE.match(sql) or _TABLE in sql:
            return execute(sql, params, many, context)
        numbers = getattr(self._local, "numbers", None) or set(self.epochs or self.leaving)
        with contextlib.nullcontext() if connection.in_atomic_block else transaction.atomic():
            self._check(numbers)
            return execute(sql, params, many, context)


def _epochs(numbers: Collection[int]) -> list[tuple[int, int]]:
    """Read epochs; what has been read does not change before the transaction ends."""
    rows = Shard.objects.filter(number__in=sorted(numbers)).values_list("number", "epoch")
    if connection.vendor != "postgresql":
        return list(rows)
    with connection.cursor() as cursor:
        cursor.execute(_LOCKED, [IDLE_LIMIT, sorted(numbers)])
        return [(number, epoch) for number, epoch, _ in cursor.fetchall()]


class _Everything(Ownership):
    """Owns every robot, without a row: for what runs without a session manager's process."""

    is_fenced = False

    def __init__(self) -> None:
        super().__init__()
        self.become(dict.fromkeys(ALL, 0))
        self.wanted = frozenset(ALL)

    @property
    def is_confirmed(self) -> bool:
        return True


EVERYTHING: Ownership = _Everything()


class ShardChanges:
    """The changes of ownership that one part of the session manager has yet to act on; true while
    there are any.
    """

    def __init__(self, ownership: Ownership) -> None:
        self._ownership, self._epochs = ownership, ownership.epochs

    def __bool__(self) -> bool:
        return self._epochs is not self._ownership.epochs

    def take(self, robots: Iterable[str] = ()) -> tuple[list[str], list[str]]:
        """Return those of these robots that we have gained since the last call, and those that are
        not ours.
        """
        before, self._epochs = self._epochs, self._ownership.epochs
        shards = {robot: shard_of(robot) for robot in robots}
        gained = self._epochs.keys() - before.keys()
        return (
            [robot for robot, shard in shards.items() if shard in gained],
            [robot for robot, shard in shards.items() if shard not in self._epochs],
        )
