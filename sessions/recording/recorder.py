"""The recorder: a thread that writes the record, and the bounded buffer in front of it.

The session manager's loop never waits for the database: it puts items into the buffer. While the
database is away, or its disk is full, the thread retries with the same rows and the buffer fills.
When it is full, further items are counted, logged and dropped. Dropped states are noticed by their
numbers, and requested again once there is room.
"""

import functools
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass

import structlog
from django.db import DatabaseError, InterfaceError, close_old_connections, connection

from sessions.disk_full import is_disk_full
from sessions.models import STALE_SECONDS
from sessions.recording.builder import RecordBuilder
from sessions.recording.items import Item, memory_of
from sessions.recording.store import RecordStore
from sessions.shards.ownership import EVERYTHING, Fenced, Ownership

logger = structlog.stdlib.get_logger(__name__)

MIB = 1024 * 1024
LIMIT = 100_000
BATCH = 2000


@dataclass(frozen=True)
class BufferLimits:
    """Limits: items; bytes in total, of one robot or session (`each`), and of one batch."""

    items: int = LIMIT
    total: int = 256 * MIB
    each: int = 64 * MIB
    batch: int = 32 * MIB


LINGER = 0.25  # s between two writes when little comes
FIRST_RETRY, LAST_RETRY = 0.1, 2.0
REPORT_SECONDS = 10.0


class Buffer:
    """A bounded queue between a loop that must not wait and a thread that may; `clock`: Unix
    seconds.
    """

    def __init__(self, limits: BufferLimits, clock: Callable[[], float]) -> None:
        self._limits = limits
        self._clock = clock
        self.dropped = 0
        self._reported_at = 0.0
        self._items: deque[tuple[Item, str, int]] = deque()
        self._used: Counter[str] = Counter()  # bytes of each robot and session
        self._bytes = 0
        self._filled = threading.Condition()

    def put(self, item: Item) -> bool:
        """Add an item; False when there is no room and it was dropped."""
        source, size = memory_of(item)
        with self._filled:
            if (
                len(self._items) >= self._limits.items
                or self._bytes + size > self._limits.total
                or self._used[source] + size > self._limits.each
            ):
                self._drop()
                return False
            self._items.append((item, source, size))
            self._bytes += size
            self._used[source] += size
            if len(self._items) == BATCH:
                self._filled.notify()
        return True

    def _drop(self) -> None:
        self.dropped += 1
        now = self._clock()
        if now - self._reported_at > REPORT_SECONDS:
            self._reported_at = now
            logger.error("record_buffer_full", dropped=self.dropped)

    def wake(self) -> None:
        """Wake the thread that waits in `take`."""
        with self._filled:
            self._filled.notify()

    def take(self, seconds: float) -> list[Item]:
        """Return a batch of items; waits at most `seconds` for a full one."""
        taken, total = list[Item](), 0
        with self._filled:
            if len(self._items) < BATCH and self._bytes < self._limits.batch:
                self._filled.wait(seconds)
            while self._items and len(taken) < BATCH and total < self._limits.batch:
                item, source, size = self._items.popleft()
                self._bytes -= size
                self._used[source] -= size
                if not self._used[source]:
                    del self._used[source]
                taken.append(item)
                total += size
        return taken

    def __len__(self) -> int:
        return len(self._items)


class Recorder:
    """Records the items that are put into it.

    Args:
        ask: called in the recorder's thread with (robot, boot, first, last) to request lost states.
        limits: of the buffer.
        clock: Unix seconds.
        ownership: our robots, and the fence of their record.
    """

    def __init__(
        self,
        ask: Callable[[str, str, int, int], None],
        *,
        limits: BufferLimits = BufferLimits(),
        clock: Callable[[], float] = time.time,
        ownership: Ownership = EVERYTHING,
    ) -> None:
        self._buffer = Buffer(limits, clock)
        self.put = self._buffer.put
        self._clock = clock
        self._ownership = ownership
        self._store = RecordStore(ownership)
        self._builder = RecordBuilder(self._store, ask)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._failures = 0
        self._written_at = time.monotonic()

    @property
    def counts(self) -> Counter[str]:
        """Totals since the start: rows by kind, states, and everything that was dropped."""
        return self._store.counts + Counter(dropped=self._buffer.dropped)

    @property
    def refused(self) -> Counter[str]:
        """The number of commands that the robots have refused, by reason."""
        return self._builder.refused

    @property
    def waiting(self) -> int:
        """The number of items that are not written yet."""
        return len(self._buffer)

    @property
    def is_alive(self) -> bool:
        """Tell whether the thread runs: an error that is not the database's ends it."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self, seconds: float) -> bool:
        """Write all items and end the thread; False when that takes longer than `seconds`."""
        self._stopping.set()
        self._buffer.wake()
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            with self._ownership.fenced():
                while self._run_once():
                    pass
        finally:
            connection.close()

    def _run_once(self) -> bool:
        """Record a batch; False when it was the last."""
        # Read before the batch, so that items put before `stop` are always taken.
        last = self._stopping.is_set()
        for item in self._buffer.take(0.0 if last else LINGER):
            self._retry(functools.partial(self._builder.take, item))
        self._retry(lambda: self._builder.settle(self._clock()))
        if last and not len(self._buffer):
            self._builder.close_all()
        self._retry(self._write)
        self._builder.tell_released()
        self._retry(lambda: self._builder.close_sessions(self._clock()))
        return not (last and not len(self._buffer))

    def _write(self) -> None:
        """Write; carefully after a pause in which another session manager may have taken over."""
        self._builder.write(careful=time.monotonic() - self._written_at > STALE_SECONDS / 2)
        self._written_at = time.monotonic()

    def _retry(self, step: Callable[[], None]) -> None:
        """Repeat a step until the database takes it, or the fence refuses it."""
        pause = FIRST_RETRY
        while True:
            try:
                step()
            except Fenced as error:
                logger.warning("record_fenced", reason=str(error))
                return
            except (DatabaseError, InterfaceError) as error:
                self._failures += 1
                logger.error(
                    "record_not_written",
                    failures=self._failures,
                    waiting=len(self._buffer),
                    reason=str(error),
                )
                time.sleep(pause)
                pause = min(LAST_RETRY, pause * 2)
                if not is_disk_full(error):  # without room SQLite could not open another one
                    close_old_connections()
            else:
                return
