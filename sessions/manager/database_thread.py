"""A database thread, so that the session manager's event loop never waits for the database."""

import asyncio
import functools
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import structlog
from django.db import DatabaseError, InterfaceError, connection

from sessions.disk_full import is_disk_full
from sessions.manager.health import ManagerHealth

logger = structlog.stdlib.get_logger(__name__)


class DatabaseThread:
    """Runs one step after another.

    Args:
        name: of the thread.
        health: receives the begin and end of each step, without its wait for the thread.
        around: creates the context that every step runs in.
    """

    def __init__(
        self,
        name: str,
        health: ManagerHealth,
        around: Callable[[], AbstractContextManager[None]] = nullcontext,
    ) -> None:
        self._health = health
        self._around = around
        self._pool = ThreadPoolExecutor(1, name)

    async def run(self, step: Callable[..., Any], *arguments: Any) -> Any:
        """Run a step and return its result.

        Raises:
            DatabaseError: or InterfaceError, as the step did.
        """
        return await asyncio.get_running_loop().run_in_executor(
            self._pool, functools.partial(self._watched, step, *arguments)
        )

    async def attempt(self, step: Callable[..., Any], *arguments: Any, refused: Any = None) -> Any:
        """Run a step; return `refused` when the database refuses it."""
        try:
            return await self.run(step, *arguments)
        except (DatabaseError, InterfaceError) as error:
            self._health.refused(error, time.monotonic())
            logger.warning("database_step_refused", step=step.__name__, reason=str(error))
            return refused

    def _watched(self, step: Callable[..., Any], *arguments: Any) -> Any:
        begun = object()
        self._health.begun(begun, time.monotonic())
        try:
            with self._around():
                return _with_fresh_connection(step, *arguments)
        finally:
            self._health.ended(begun, time.monotonic())

    async def close(self) -> None:
        """Wait for the last step, and close the thread's connection."""
        self._pool.submit(connection.close)
        await asyncio.to_thread(self._pool.shutdown)


def _with_fresh_connection(step: Callable[..., Any], *arguments: Any) -> Any:
    """Run a step; after a database error the thread's connection is closed, unless the disk is
    full: SQLite needs room to open another one.
    """
    try:
        return step(*arguments)
    except (DatabaseError, InterfaceError) as error:
        if not is_disk_full(error):
            connection.close()
        raise
