"""A computer without any network: the test itself, and every process that it starts meanwhile, in a
namespace where only lo is up.
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
        """Give the computer a network after all: a cable from itself to itself, with an address at
        each end, and a way out that leads nowhere.

        Without a way out Chromium tells nobody its address; and one that was started before never
        notices.
        """
        ip("-n", self.name, "link", "add", "cable0", "type", "veth", "peer", "name", "cable1")
        for interface, address in (("cable0", FIRST), ("cable1", SECOND)):
            ip("-n", self.name, "addr", "add", address, "dev", interface)
            ip("-n", self.name, "link", "set", interface, "up")
        ip("-n", self.name, "route", "add", "default", "via", GATEWAY, "dev", "cable0")

    def close_udp(self) -> None:
        """Let no datagram reach this computer, as a firewall in front of it would. A rule of
        routing, since not every kernel can filter.
        """
        ip("-n", self.name, "rule", "add", "pref", "5", "lookup", "local")
        for network in NETWORKS:
            ip(
                "-n",
                self.name,
                "rule",
                "add",
                "pref",
                "1",
                "ipproto",
                "udp",
                "to",
                network,
                "blackhole",
            )
        ip("-n", self.name, "rule", "del", "pref", "0")

    def let_through(self, user: str) -> None:
        """Let datagrams of one user's programs through all the same: those of a relay, which stands
        outside of the firewall.
        """
        number = pwd.getpwnam(user).pw_uid
        ip(
            "-n",
            self.name,
            "rule",
            "add",
            "pref",
            "0",
            "uidrange",
            f"{number}-{number}",
            "lookup",
            "local",
        )

    def open_udp(self) -> None:
        """Let datagrams through again."""
        for _ in NETWORKS:
            ip("-n", self.name, "rule", "del", "pref", "1")


@contextlib.contextmanager
def loopback_only() -> Iterator[LoopbackOnly]:
    """Put this thread, and all that it starts, into a network namespace of its own until the end of
    the block.
    """
    name = f"lo-{os.getpid() % 100000}"
    ip("netns", "add", name)
    try:
        ip("-n", name, "link", "set", "lo", "up")
        with inside(name):
            yield LoopbackOnly(name)
    finally:
        ip("netns", "del", name)
