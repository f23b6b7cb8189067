"""What really happened, asked of a simulated robot over its read-only connection."""

import socket
from dataclasses import dataclass
from typing import Self

from robots.process import framing
from robots.simulator import wire
from tests.support.patience import patient


@dataclass(frozen=True)
class Row:
    """One step of the simulator: command, motion and pose (robot's clock, SI units)."""

    stamp: float
    commanded_linear: float
    commanded_angular: float
    linear: float
    angular: float
    x: float
    y: float
    theta: float


class Onlooker:
    """A blocking observer of a simulator; one question, one answer. A context manager."""

    def __init__(self, port: int, role: wire.Role = "observer") -> None:
        self.port = port
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=patient(10))
        self._ask(wire.SimulatorHello(role))

    @classmethod
    def of(cls, address: str) -> Self:
        """Return an observer of the simulator at host:port."""
        return cls(int(address.rpartition(":")[2]))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_raised: object) -> None:
        self.close()

    def _ask(self, question: wire.SimulatorMessage) -> object:
        self._socket.sendall(framing.pack(question))
        return wire.unpack_answer(self._read(framing.length(self._read(framing.HEADER))))

    def _read(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            piece = self._socket.recv(size - len(data))
            assert piece, "the simulator is gone"
            data += piece
        return data

    def truth(self) -> wire.Truth:
        answer = self._ask(wire.AskTruth())
        assert isinstance(answer, wire.Truth)
        return answer

    def history(self, seconds: float) -> list[Row]:
        answer = self._ask(wire.AskHistory(seconds))
        assert isinstance(answer, wire.History)
        return [Row(*row) for row in answer.rows]

    def at(self, stamp: float, seconds: float = 30.0) -> Row:
        """Return the row nearest to a stamp."""
        return min(self.history(seconds), key=lambda row: abs(row.stamp - stamp))

    def close(self) -> None:
        self._socket.close()


class SimulatorOperator(Onlooker):
    """A blocking operator of a simulator."""

    def __init__(self, port: int) -> None:
        super().__init__(port, "operator")

    def wish(self, wish: wire.CarryTo | wire.Break | wire.SetDoors) -> str:
        """Let something happen; return why not, or nothing when it did."""
        answer = self._ask(wish)
        assert isinstance(answer, wire.Done | wire.RoleRefused)
        return answer.reason if isinstance(answer, wire.RoleRefused) else ""
