"""Docking by std_srvs/Trigger services: one docks, one undocks, one cancels either.

A call that times out does not end the docking: its service may answer, and the robot move, at any
later time. Only the cancel service ends it, and only a cancel that was sent after the answer.

ROS keeps no order between two services: a cancel that is under way may arrive after the call of the
next docking, and would end it unnoticed. So that call waits for the cancel's answer.
"""

import asyncio
import time
from collections.abc import Callable

from robots.agent.adapters.common.pending_actions import LONGEST_DOCKING
from robots.agent.adapters.ros.bus import ANSWER_TIME, Bus, UnansweredError
from robots.agent.robot_interface import ActionRefusedError, AdapterError
from robots.api.reasons import ReasonCode

TRIGGER = "std_srvs/Trigger"
CANCEL_TIME = 1.0  # seconds that one call of `cancel` waits
SETTLED_WITHIN = 6.0  # seconds within which the cancel before a docking must be answered
LOST_FOR = 30.0  # seconds in which a call that ended without an answer may still start the robot


class TriggerDocking:
    """`is_at_rest` returns whether the robot is measured at rest."""

    def __init__(self, cancel_service: str, bus: Bus, is_at_rest: Callable[[], bool]) -> None:
        self._cancel_service, self._bus, self._is_at_rest = cancel_service, bus, is_at_rest
        self._start: asyncio.Future[tuple[bool, str]] | None = None
        self._ended_at = 0.0  # when that call ended
        self._is_cancelled = False
        self._cancelling: asyncio.Future[bool] | None = None
        self._may_arrive = False  # a cancel has no answer

    async def start(self, service: str) -> None:
        """Call the service that docks or undocks. Raises ActionRefusedError when it refuses or does
        not exist, or a cancel has no answer, AdapterError without an answer of its own.
        """
        self._is_cancelled = False
        await self._settle()
        if self._is_cancelled:
            raise ActionRefusedError(ReasonCode.CANCELLED)
        call = self._bus.call(service, TRIGGER, within=LONGEST_DOCKING)
        start = self._start = asyncio.ensure_future(call)
        self._cancelling = None  # a cancel that was sent earlier does not end this call
        start.add_done_callback(self._ended)
        await asyncio.wait([start], timeout=ANSWER_TIME)
        if not start.done() or start.cancelled():
            raise AdapterError(f"{service} does not answer")
        done, reason = start.result()
        if not done:
            raise ActionRefusedError(ReasonCode.RCA.of(f"{service}: {reason or 'refused'}"))

    async def cancel(self) -> bool:
        """Call the cancel service, unless a call waits for its answer; return whether it has
        answered, and no call can start the robot afterwards.

        An answer without success counts while the robot is at rest: there was nothing to cancel.
        """
        if not self._cancel_service:
            return False
        self._is_cancelled = True
        cancelling = self._cancelling or self._send_cancel()
        done, _ = await asyncio.wait([cancelling], timeout=CANCEL_TIME)
        if not done:
            return False
        if self._cancelling is cancelling:
            self._cancelling = None
        return cancelling.result()

    async def _settle(self) -> None:
        """Wait until no cancel can arrive any more; raises ActionRefusedError."""
        if self._may_arrive:
            await asyncio.wait([self._send_cancel()], timeout=SETTLED_WITHIN)
        if self._may_arrive:
            why = f"{self._cancel_service} does not answer"
            raise ActionRefusedError(ReasonCode.RCA.of(why))

    def _may_start(self) -> bool:
        """Return whether an unanswered call may still start the robot."""
        start = self._start
        if start is None:
            return False
        if not start.done():
            return True
        # it was cancelled with its connection
        is_unanswered = start.cancelled() or isinstance(start.exception(), UnansweredError)
        return is_unanswered and time.monotonic() - self._ended_at < LOST_FOR

    def _ended(self, start: asyncio.Future[tuple[bool, str]]) -> None:
        """Cancel again at once a call that was cancelled before its answer."""
        self._ended_at = time.monotonic()
        if start.cancelled() or start.exception() is not None or not self._is_cancelled:
            return
        self._send_cancel()

    def _send_cancel(self) -> asyncio.Future[bool]:
        """Return the cancel that is under way, a new one when there is none."""
        if self._cancelling is None or self._cancelling.done():
            self._may_arrive = True
            self._cancelling = asyncio.ensure_future(self._call())
        return self._cancelling

    async def _call(self) -> bool:
        may_start = self._may_start()
        try:
            done, _ = await self._bus.call(self._cancel_service, TRIGGER)
        except ActionRefusedError:
            done = True  # there is no docking server
        except (AdapterError, asyncio.CancelledError):
            return False
        self._may_arrive = False
        return (done or self._is_at_rest()) and not may_start
