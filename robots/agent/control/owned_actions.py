"""Actions that may move the robot: the agent owns each from its start until the RCA has confirmed
its end. A cancel is repeated until then, even if the connection is lost in between.
"""

import asyncio
import contextlib
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

import structlog

from robots.agent.control.supervised_adapter import AdapterLink
from robots.agent.robot_interface import AdapterError

log = structlog.stdlib.get_logger(__name__)

CANCEL_PERIOD = 0.5  # s between two attempts to cancel
UNCONFIRMED = "the robot's navigation has not confirmed that it ended"


class OwnedActions:
    """Running actions, and those whose end is unconfirmed.

    `spawn` runs a coroutine in the background. `changed` is called when an end becomes unconfirmed
    or confirmed, with the reason why the last cancel failed ("" for none).
    """

    def __init__(
        self,
        adapter: AdapterLink,
        spawn: Callable[[Coroutine[Any, Any, None]], None],
        changed: Callable[[str], None],
    ) -> None:
        self._adapter, self._spawn, self._changed = adapter, spawn, changed
        self._running: set[str] = set()
        self._ending: set[str] = set()
        self._starting: set[str] = set()

    @property
    def is_end_unconfirmed(self) -> bool:
        return bool(self._ending)

    def begin(self, action_id: str) -> None:
        self._running.add(action_id)

    def is_wanted(self, action_id: str) -> bool:
        return action_id in self._running

    @contextlib.contextmanager
    def starting(self, action_id: str) -> Iterator[None]:
        """Ignore confirmations of an action's end while it is being started: the adapter may not
        know it yet.
        """
        self._starting.add(action_id)
        try:
            yield
        finally:
            self._starting.discard(action_id)

    def ended(self, action_id: str) -> None:
        """Note that an action has ended, or certainly never started."""
        self._running.discard(action_id)
        if action_id in self._ending:
            self._ending.discard(action_id)
            self._changed("")

    def cancel(self, action_id: str) -> None:
        """Cancel an action until its end is confirmed."""
        self._running.discard(action_id)
        if action_id not in self._ending:
            self._ending.add(action_id)
            self._changed("")
            self._spawn(self._cancel(action_id))

    def cancel_all(self) -> None:
        for action_id in sorted(self._running):
            self.cancel(action_id)

    async def _cancel(self, action_id: str) -> None:
        """Repeat a cancel until the end is confirmed, here or through `ended`. A confirmation while
        the action is being started does not count: the order may reach the robot afterwards.
        """
        attempts = 0
        while action_id in self._ending:
            reason = ""
            try:
                if await self._adapter.cancel(action_id) and action_id not in self._starting:
                    self.ended(action_id)
                    return
            except AdapterError as error:
                reason = str(error)
            attempts += 1
            if action_id in self._ending and (reason or attempts > 1):
                log.warning("cancel_unconfirmed", action=action_id, reason=reason)
                self._changed(reason or UNCONFIRMED)
            await asyncio.sleep(CANCEL_PERIOD)
