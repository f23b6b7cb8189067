"""The simulated bases of agents in other processes (based_robot.py): each follows its last
velocity, and stops when its watchdog expires.
"""

import socket
import threading
import time
from collections import defaultdict
from types import TracebackType
from typing import Self

from tests.support.agents.scripted_robot import WATCHDOG

LONGEST = 200


class Bases:
    """Listens on a thread of its own; `port` is where. Times are Unix time at arrival. Use as a
    context manager.
    """

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port = int(self._socket.getsockname()[1])
        self._velocities: defaultdict[str, list[tuple[float, bool]]] = defaultdict(list)
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as last:
            last.sendto(b"", ("127.0.0.1", self.port))
        self._thread.join()
        self._socket.close()

    def _listen(self) -> None:
        while words := self._socket.recv(LONGEST).decode().split():
            name, linear, angular = words
            self._velocities[name].append((time.time(), bool(float(linear) or float(angular))))

    def moves(self) -> dict[str, list[tuple[float, float]]]:
        return {
            name: motion(list(velocities)) for name, velocities in list(self._velocities.items())
        }


def motion(velocities: list[tuple[float, bool]]) -> list[tuple[float, float]]:
    """Return the spans of motion of a base from its velocities: (time, whether it is not zero)."""
    spans: list[tuple[float, float]] = []
    for number, (at, moves) in enumerate(velocities, 1):
        if not moves:
            continue
        until = min(
            velocities[number][0] if number < len(velocities) else float("inf"), at + WATCHDOG
        )
        if spans and spans[-1][1] >= at:
            spans[-1] = (spans[-1][0], until)
        else:
            spans.append((at, until))
    return spans
