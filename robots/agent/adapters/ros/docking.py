"""Docking by std_srvs/Trigger services: one docks, one undocks, one cancels either.

That a call has timed out does not end the docking. Only the cancel service does, so it is called
until it answers.
"""

import asyncio
from collections.abc import Callable

from robots.agent.adapters.ros.bus import Bus
from robots.agent.robot_interface import ActionRefusedError, AdapterError

TRIGGER = "std_srvs/Trigger"
ANSWER_TIME = 1.0  # seconds that one call of `cancel` waits


class TriggerDocking:
    """`stands` tells whether the robot is measured at rest."""

    def __init__(self, cancel_service: str, bus: Bus, stands: Callable[[], bool]) -> None:
        self._cancel_service, self._bus, self._stands = cancel_service, bus, stands
        self._cancelling: asyncio.Task[bool] | None = None

    async def start(self, service: str) -> None:
        """Call the service that docks or undocks.

        Raises:
            ActionRefusedError: it refuses, or does not exist.
            AdapterError: no answer.
        """
        done, reason = await self._bus.call(service, TRIGGER)
        if not done:
            raise ActionRefusedError(f"{service} refused: {reason or 'it gives no reason'}")

    async def cancel(self) -> bool:
        """Call the cancel service, unless a call is under way; return whether it has answered.

        An answer without success counts while the robot is at rest: there was nothing to cancel.
        """
        if not self._cancel_service:
            return False
        if self._cancelling is None:
            self._cancelling = asyncio.ensure_future(self._call())
        done, _ = await asyncio.wait([self._cancelling], timeout=ANSWER_TIME)
        if not done:
            return False
        cancelling, self._cancelling = self._cancelling, None
        return cancelling.result()

    async def _call(self) -> bool:
        try:
            done, _ = await self._bus.call(self._cancel_service, TRIGGER)
        except ActionRefusedError:
            return True  # there is no docking server
        except (AdapterError, asyncio.CancelledError):
            return False
        return done or self._stands()
