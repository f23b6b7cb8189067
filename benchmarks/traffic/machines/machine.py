"""Computers of a cluster, each a namespace on one cable with this process. Linux, as root; cuts
need Debian's `nftables`.
"""

import contextlib
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.support.programs.namespace import inside
from tests.support.programs.networks import Computer, internet

NETWORK = "10.177.9.0/24"
# What comes from those is dropped without a word, as by a switch that has lost a cable.
CUT = """
table ip cut {{
  chain in {{ type filter hook input priority filter; ip saddr {{ {others} }} drop; }}
}}
"""


@dataclass(frozen=True)
class Machine:
    """One computer: its number, its namespace, and a folder of its own."""

    number: int
    computer: Computer
    folder: Path

    @property
    def address(self) -> str:
        return self.computer.address

    @contextlib.contextmanager
    def within(self) -> Iterator[None]:
        """Put this thread, and all that it starts, onto the computer until the end of the block."""
        with inside(self.computer.name):
            yield

    def cut(self, others: Sequence["Machine"]) -> None:
        """Hear nothing more of these."""
        addresses = ", ".join(other.address for other in others)
        self._nft("-f", "-", rules=CUT.format(others=addresses))

    def heal(self) -> None:
        """Hear everybody again."""
        self._nft("delete", "table", "ip", "cut")

    def _nft(self, *words: str, rules: str = "") -> None:
        command = self.computer.command("nft", *words)
        subprocess.run(command, input=rules, text=True, check=True, capture_output=True)


@dataclass(frozen=True)
class Partition:
    """A cable between two halves of the machines; robots and visitors reach both."""

    one: Sequence[Machine]
    other: Sequence[Machine]

    def begin(self) -> None:
        for half, others in ((self.one, self.other), (self.other, self.one)):
            for machine in half:
                machine.cut(others)

    def end(self) -> None:
        for machine in (*self.one, *self.other):
            machine.heal()


@contextlib.contextmanager
def machines(count: int, folder: Path) -> Iterator[list[Machine]]:
    """Make that many machines. This process and whatever it starts elsewhere share their cable, as
    robots and visitors.
    """
    with internet() as switch:
        made = []
        for number in range(count):
            own = folder / f"machine-{number}"
            own.mkdir()
            made.append(Machine(number, switch.join_lan(own.name), own))
        yield made
