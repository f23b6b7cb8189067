"""The heartbeats of a rehearsal's process in its row, with its progress; they also find out that it
was ended there.

While the database is away they go on, so that an hour's findings can be stored when it is back.
"""

import json
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import UUID

import structlog
from django.db import DatabaseError, InterfaceError, connection
from django.utils import timezone

from experiments.rehearsal import runs

log = structlog.stdlib.get_logger(__name__)
PERIOD_SECONDS = 2.0
DATABASE_SECONDS = 600.0  # for which a database that is away is waited for


@contextmanager
def heartbeats(key: UUID, progress: Path) -> Iterator[None]:
    """Send heartbeats to a rehearsal's row inside. When the rehearsal was ended there, the main
    thread receives SIGTERM.

    Args:
        key: of the row.
        progress: the file in which the sandbox writes its progress.
    """

    def beat(ended: threading.Event) -> None:
        changes = {}
        with suppress(OSError, ValueError):
            changes = {"progress": json.loads(progress.read_text(encoding="utf-8"))}
        if not runs.sign(key, timezone.now(), **changes):
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
            ended.set()

    with repeated(beat):
        yield


@contextmanager
def repeated(work: Callable[[threading.Event], object]) -> Iterator[None]:
    """Inside, call `work` every PERIOD_SECONDS in a thread, also while the database is away; it may
    set its argument to end this.
    """
    ended = threading.Event()

    def repeat() -> None:
        while not ended.wait(PERIOD_SECONDS):
            attempt(lambda: work(ended))
        connection.close()

    thread = threading.Thread(target=repeat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(PERIOD_SECONDS)


def retry_until_written(write: Callable[[], object]) -> None:
    """Write to the database; repeat it while the database is away, for DATABASE_SECONDS at most."""
    deadline = time.monotonic() + DATABASE_SECONDS
    while (error := attempt(write)) is not None:
        if time.monotonic() > deadline:
            raise error
        time.sleep(PERIOD_SECONDS)


def attempt(write: Callable[[], object]) -> DatabaseError | InterfaceError | None:
    """Return why the database could not be written to; the next attempt reconnects."""
    try:
        write()
    except (DatabaseError, InterfaceError) as error:
        log.warning("rehearsal_database_retry", reason=str(error))
        connection.close()
        return error
    return None
