"""Commands of pages that wait for the control loop, in bounded space for each page, so that no page
delays another.

A page has one slot for each kind of message of which only the newest counts, and a short queue of
actions. After a delay of the loop each page's newest message is handled, and the stops of all pages
first. A stop voids what the same page sent before it and what would move the robot.
"""

import threading
from collections import Counter
from collections.abc import Callable

from robots.agent.media.webrtc.packet_gate import Command, ReceivedPacket
from robots.agent.safety.permissions import MOVING
from robots.api.errors import Rejection
from robots.api.messages import (
    CommandHeartbeat,
    EStop,
    PointCommand,
    Role,
    RouteRequest,
    Stop,
    Velocity,
    VelocityCommand,
)

Slots = dict[type | str, tuple[Role, Command]]
ACTIONS_WAITING = 16  # of one page
NEWEST_COUNTS = (Stop, EStop, VelocityCommand, CommandHeartbeat, PointCommand, RouteRequest)


class Ingress:
    """Filled from any thread, drained by the control loop, which `wake` wakes."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._waiting: dict[str, Slots] = {}  # by peer
        self._rejected: Counter[str] = Counter()
        self._woken = False

    def put(self, peer: str, role: Role, received: ReceivedPacket) -> None:
        """Take a packet of a page, or count why it could not be read."""
        with self._lock:
            if isinstance(received, Rejection):
                self._rejected[received.reason] += 1
            else:
                self._keep(self._waiting.setdefault(peer, {}), role, received)
            woken, self._woken = self._woken, True
        if not woken:
            self._wake()

    def _keep(self, slots: Slots, role: Role, command: Command) -> None:
        """Put a command into its slot of a page; the lock is held.

        A page that floods the robot fills a bounded number of slots: of a velocity, a release and
        other streams only the newest counts, and actions are limited in number. A stop removes the
        earlier commands that would move the robot, so that none of them runs after it.
        """
        if isinstance(command, Stop | EStop):
            for slot, (_, earlier) in list(slots.items()):
                if isinstance(earlier, (VelocityCommand, *MOVING)):
                    del slots[slot]
                    self._rejected["stopped"] += 1
        if isinstance(command, VelocityCommand) and command.linear == command.angular == 0.0:
            # a release is sent once, and the next key press must not replace it
            slot = Velocity
        elif isinstance(command, NEWEST_COUNTS):
            slot = type(command)
        else:
            slot = command.action_id
            actions = sum(isinstance(name, str) for name in slots)
            if slot not in slots and actions >= ACTIONS_WAITING:
                self._rejected["too_many"] += 1
                return
        if slots.pop(slot, None) is not None and isinstance(command, VelocityCommand):
            self._rejected["replaced"] += 1
        slots[slot] = role, command  # the newest is the last

    def drain(self) -> tuple[list[tuple[str, Role, Command]], Counter[str]]:
        """Return (peer, role, command) of all that waits, stops first, and counts of rejections by
        reason.
        """
        with self._lock:
            waiting, self._waiting = self._waiting, {}
            rejected, self._rejected = self._rejected, Counter()
            self._woken = False
        commands = [(peer, *kept) for peer, slots in waiting.items() for kept in slots.values()]
        return sorted(commands, key=lambda each: not isinstance(each[2], Stop | EStop)), rejected
