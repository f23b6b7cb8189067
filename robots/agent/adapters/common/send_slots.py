"""Messages that wait for a slow connection to an RCA; of velocities only the newest waits.

A velocity that was delayed here must not move the robot later: many RCAs obey a command whenever
it arrives.
"""

import asyncio
import time
from collections import deque
from typing import Generic, TypeVar

from robots.agent.robot_interface import AdapterError

COMMAND_AGE = 0.25  # seconds after which a velocity that still waits is dropped
STUCK = 0.5  # seconds that velocities may wait before the connection counts as gone
MAX_MESSAGES = 200

SlotMessage = TypeVar("SlotMessage")


class SendSlots(Generic[SlotMessage]):
    """Messages in order, and one place for the newest velocity. For one loop."""

    def __init__(self) -> None:
        self._messages: deque[SlotMessage] = deque()
        self._velocity: tuple[float, SlotMessage] | None = None
        self._waiting_since = 0.0
        self._wake = asyncio.Event()

    def say(self, message: SlotMessage) -> None:
        """Queue a message; raises AdapterError when too many wait already."""
        if len(self._messages) >= MAX_MESSAGES:
            raise AdapterError("the robot control architecture does not accept messages")
        self._messages.append(message)
        self._wake.set()

    def drive(self, message: SlotMessage) -> None:
        """Replace the waiting velocity; raises AdapterError when none was taken for a while."""
        now = time.monotonic()
        if self._velocity is None:
            self._waiting_since = now
        elif now - self._waiting_since > STUCK:
            raise AdapterError("the robot control architecture does not accept commands")
        self._velocity = (now, message)
        self._wake.set()

    def __len__(self) -> int:
        return len(self._messages) + (self._velocity is not None)

    def clear(self) -> None:
        self._messages.clear()
        self._velocity = None

    async def take(self) -> SlotMessage:
        """Wait for the next message; velocities go first."""
        while True:
            if self._velocity is not None:
                (at, message), self._velocity = self._velocity, None
                if time.monotonic() - at <= COMMAND_AGE:
                    return message
            elif self._messages:
                return self._messages.popleft()
            else:
                self._wake.clear()
                await self._wake.wait()
