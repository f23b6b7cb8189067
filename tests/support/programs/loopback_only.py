"""A computer without any network: a test and all processes that it starts are in a namespace where
only lo is up.
"""

import contextlib
import os
import pwd
from collections.abc import Iterator
from dataclasses import dataclass

from tests.support.programs.namespace import inside, ip

FIRST, SECOND, GATEWAY = "10.177.8.1/24", "10.177.8.2/24", "10.177.8.254"
NETWORKS = "10.177.8.0/24", "127.0.0.0/8"


@dataclass(frozen=True)
class LoopbackOnly:
    """The namespace that this thread is in."""

    name: str

    def plug(self) -> None:
        """Give the computer a network: a cable from itself to itself, with an address at each end,
        and a default route that leads nowhere.

        Chromium hides its address without a default route, and does not notice one that is added
        after it has started.
        """
        self._ip("link add cable0 type veth peer name cable1")
        for interface, address in (("cable0", FIRST), ("cable1", SECOND)):
            self._ip(f"addr add {address} dev {interface}")
            self._ip(f"link set {interface} up")
        self._ip(f"route add default via {GATEWAY} dev cable0")

    def close_udp(self) -> None:
        """Drop all datagrams to this computer, as a firewall in front of it would. A rule of
        routing, since not every kernel can filter.
        """
        self._ip("rule add pref 5 lookup local")
        for network in NETWORKS:
            self._ip(f"rule add pref 1 ipproto udp to {network} blackhole")
        self._ip("rule del pref 0")

    def let_through(self, user: str) -> None:
        """Exempt the programs of one user: a relay, which is outside of the firewall."""
        number = pwd.getpwnam(user).pw_uid
        self._ip(f"rule add pref 0 uidrange {number}-{number} lookup local")

    def open_udp(self) -> None:
        """Undo `close_udp`."""
        for _ in NETWORKS:
            self._ip("rule del pref 1")

    def _ip(self, command: str) -> None:
        ip(f"-n {self.name} {command}")


@contextlib.contextmanager
def loopback_only() -> Iterator[LoopbackOnly]:
    """Put this thread and all that it starts into a namespace of its own until the block ends."""
    name = f"lo-{os.getpid() % 100000}"
    ip(f"netns add {name}")
    try:
        ip(f"-n {name} link set lo up")
        with inside(name):
            yield LoopbackOnly(name)
    finally:
        ip(f"netns del {name}")
