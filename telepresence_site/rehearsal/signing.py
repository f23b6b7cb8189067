"""The sign of life that the process of a rehearsal gives in its row, with how far it is, and how it
hears there that it is to end.

It never gives up for a database that is away: what bots found in an hour is kept when it is back.
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
SIGN_SECONDS = 2.0
PATIENCE_SECONDS = 600.0  # for a database that is away


@contextmanager
def signed(key: UUID, progress: Path) -> Iterator[None]:
    """Sign a rehearsal's row inside; SIGTERM comes to the main thread when somebody ended it.

    Args:
        key: of the row.
        progress: the file in which the sandbox leaves how far it is.
    """
    ended = threading.Event()
    thread = threading.Thread(target=_sign, args=(key, progress, ended), daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(SIGN_SECONDS)


def _sign(key: UUID, progress: Path, ended: threading.Event) -> None:
    def sign_once() -> None:
        told = {}
        with suppress(OSError, ValueError):
            told = {"progress": json.loads(progress.read_text(encoding="utf-8"))}
        if not runs.sign(key, timezone.now(), **told):
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)
            ended.set()

    while not ended.wait(SIGN_SECONDS):
        _attempt(sign_once)
    connection.close()


def patiently(write: Callable[[], object]) -> None:
    """Write to the database, once it is there."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while (error := _attempt(write)) is not None:
        if time.monotonic() > deadline:
            raise error
        time.sleep(SIGN_SECONDS)


def _attempt(write: Callable[[], object]) -> DatabaseError | InterfaceError | None:
    """Return why the database could not be written to; the next attempt connects anew."""
    try:
        write()
    except (DatabaseError, InterfaceError) as error:
        log.warning("rehearsal_database_retry", reason=str(error))
        connection.close()
        return error
    return None
