"""What pages have said and the control loop has not heard yet: a bounded place for each of them, so
that nobody waits behind another.

A page has one slot for each kind of message of which only the newest counts, and a small queue of
actions. However much it says while the loop is held up, what is heard afterwards is the newest, and
every page's stop comes before everything else. What the same page said before its stop, and what
would move the robot, is void.
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
    Stop,
    Velocity,
    VelocityCommand,
)

ACTIONS_WAITING = 16  # of one page
NEWEST_COUNTS = (Stop, EStop, VelocityCommand, CommandHeartbeat, PointCommand)


class Ingress:
    """Filled from any thread, emptied by the control loop, which is woken by `wake` when there is
    something.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._said: dict[str, dict[type | str, tuple[Role, Command]]] = {}
        self._rejected: Counter[str] = Counter()
        self._woken = False

    def put(self, peer: str, role: Role, heard: ReceivedPacket) -> None:
        """Take what a page has said, or count why it could not be read."""
        with self._lock:
            if isinstance(heard, Rejection):
                self._rejected[heard.reason] += 1
            else:
                self._keep(self._said.setdefault(peer, {}), role, heard)
            woken, self._woken = self._woken, True
        if not woken:
            self._wake()

    def _keep(
        self, slots: "dict[type | str, tuple[Role, Command]]", role: Role, command: Command
    ) -> None:
        if isinstance(command, Stop | EStop):
            void = [
                each
                for each, (_, said) in slots.items()
                if isinstance(said, (VelocityCommand, *MOVING))
            ]
            for each in void:
                del slots[each]
                self._rejected["stopped"] += 1
        if isinstance(command, VelocityCommand) and command.linear == command.angular == 0.0:
            # to let go is said once, and must not be lost to the key pressed next
            slot: type | str = Velocity
        elif isinstance(command, NEWEST_COUNTS):
            slot = type(command)
        else:
            slot = command.action_id
            if (
                slot not in slots
                and sum(isinstance(name, str) for name in slots) >= ACTIONS_WAITING
            ):
                self._rejected["too_many"] += 1
                return
        if slots.pop(slot, None) is not None and isinstance(command, VelocityCommand):
            self._rejected["replaced"] += 1
        slots[slot] = role, command  # the newest comes after what was said before it

    def drain(self) -> tuple[list[tuple[str, Role, Command]], Counter[str]]:
        """Return (peer, role, command) of all that waits, stops first, and how many could not be
        read or kept for which reason.
        """
        with self._lock:
            said, self._said = self._said, {}
            rejected, self._rejected = self._rejected, Counter()
            self._woken = False
        waiting = [
            (peer, role, command)
            for peer, slots in said.items()
            for role, command in slots.values()
        ]
        return sorted(waiting, key=lambda each: not isinstance(each[2], Stop | EStop)), rejected
