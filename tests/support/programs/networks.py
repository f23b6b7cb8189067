"""Networks as visitors and robots have them, and an internet between them, all in namespaces of
this process. Linux, as root.

The internet is a namespace with the addresses of a server and of a relay. A network hangs on it by
a router of its own, with one computer behind. What a router does not let through it drops without a
word, as firewalls do, by rules of routing, which every kernel has; only a router that gives its
network one address (NAT) needs Debian's `nftables`.
"""

import contextlib
import itertools
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tests.support.programs.namespace import inside, ip, wrapped

SERVER, RELAY = "203.0.113.2", "203.0.113.3"  # RFC 5737: addresses for examples
AT_HOME, ROUTER_AT_HOME = "192.168.1.2", "192.168.1.1"  # the same in every home, as they are
LAN_SERVER = "10.177.9.1"

# What a NAT asks of the router: `usual` keeps a computer's port for all whom it talks to, `strict`
# takes another for each (RFC 4787: address and port-dependent mapping). Neither lets in what was
# not asked for, nor remembers having seen it.
MASQUERADE = {"usual": "masquerade", "strict": "masquerade fully-random"}
NAT = """
table ip home {{
  chain out {{ type nat hook postrouting priority srcnat; oifname "wan" {masquerade}; }}
  chain in {{ type filter hook input priority filter; iifname "wan" ct state new drop; }}
  chain through {{ type filter hook forward priority filter; iifname "wan" ct state new drop; }}
}}
"""


@dataclass(frozen=True)
class Kind:
    """What a router does to its network: which NAT, and what it lets through."""

    nat: Literal["none", "usual", "strict"] = "none"
    passes: Literal["all", "no udp", "tcp 443"] = "all"


OPEN, HOME, STRICT = Kind(), Kind(nat="usual"), Kind(nat="strict")
NO_UDP, WEB_ONLY = Kind(nat="usual", passes="no udp"), Kind(nat="usual", passes="tcp 443")


@dataclass(frozen=True)
class Computer:
    """One computer in a network; `name` is its namespace, `address` where its cable ends."""

    name: str
    address: str

    def wrapper(self, folder: Path, program: str) -> Path:
        """Return a script that runs a program on it."""
        return wrapped(self.name, folder, program)

    def command(self, *words: str) -> list[str]:
        """Return the command that runs another one on it."""
        return ["ip", "netns", "exec", self.name, *words]


class Internet:
    """Use with `internet()`."""

    def __init__(self, tag: str) -> None:
        self.name, self._tag = f"inet-{tag}", tag
        self._made: list[str] = []
        self._count = itertools.count(1)

    def open(self) -> None:
        self._add(self.name)
        for address in (SERVER, RELAY):
            ip("-n", self.name, "addr", "add", f"{address}/32", "dev", "lo")
        ip("-n", self.name, "link", "add", "lan", "type", "bridge")
        self._address(self.name, "lan", f"{LAN_SERVER}/24")

    def close(self) -> None:
        """Take everything away; cables go with their namespaces."""
        for name in reversed(self._made):
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)

    def join(self, name: str, kind: Kind) -> Computer:
        """Hang a network with one computer on the internet."""
        number = next(self._count)
        computer, router, uplink = (
            f"{name}-{self._tag}",
            f"{name}-{self._tag}-router",
            f"net{number}",
        )
        here, there = f"198.51.100.{4 * number + 1}", f"198.51.100.{4 * number + 2}"
        inner, gateway = (
            (AT_HOME, ROUTER_AT_HOME)
            if kind.nat != "none"
            else (f"192.0.2.{4 * number + 2}", f"192.0.2.{4 * number + 1}")
        )
        self._add(computer)
        self._add(router)
        self._cable((self.name, uplink, f"{here}/30"), (router, "wan", f"{there}/30"))
        self._cable((router, "lan", f"{gateway}/30"), (computer, "eth0", f"{inner}/30"))
        ip("-n", router, "route", "add", "default", "via", here)
        ip("-n", computer, "route", "add", "default", "via", gateway)
        if kind.nat == "none":
            ip("-n", self.name, "route", "add", f"{inner}/32", "via", there)
        else:
            rules = NAT.format(masquerade=MASQUERADE[kind.nat])
            subprocess.run(
                ["ip", "netns", "exec", router, "nft", "-f", "-"],
                input=rules,
                text=True,
                check=True,
                capture_output=True,
            )
        self._close(router, kind.passes)
        return Computer(computer, inner)

    def join_lan(self, name: str) -> Computer:
        """Put a computer on one cable with the server, at LAN_SERVER, and nothing else: no router,
        no way out.
        """
        number = next(self._count)
        computer = f"{name}-{self._tag}"
        self._add(computer)
        ip(
            "-n",
            self.name,
            "link",
            "add",
            f"port{number}",
            "type",
            "veth",
            "peer",
            "name",
            "eth0",
            "netns",
            computer,
        )
        ip("-n", self.name, "link", "set", f"port{number}", "addrgenmode", "none", "master", "lan")
        ip("-n", self.name, "link", "set", f"port{number}", "up")
        address = f"10.177.9.{number + 1}"
        self._address(computer, "eth0", f"{address}/24")
        return Computer(computer, address)

    def _add(self, name: str) -> None:
        ip("netns", "add", name)
        self._made.append(name)
        ip("-n", name, "link", "set", "lo", "addrgenmode", "none")
        ip("-n", name, "link", "set", "lo", "up")
        ip("netns", "exec", name, "sh", "-c", "echo 1 > /proc/sys/net/ipv4/ip_forward")

    def _cable(self, one: tuple[str, str, str], other: tuple[str, str, str]) -> None:
        """Join two namespaces; each end is (namespace, interface, address)."""
        ip(
            "-n",
            one[0],
            "link",
            "add",
            one[1],
            "type",
            "veth",
            "peer",
            "name",
            other[1],
            "netns",
            other[0],
        )
        for end in (one, other):
            self._address(*end)

    def _address(self, name: str, interface: str, address: str) -> None:
        # An address that IPv6 gives itself a second later is a change of network, upon which
        # Chromium drops what it is loading.
        ip("-n", name, "link", "set", interface, "addrgenmode", "none")
        ip("-n", name, "addr", "add", address, "dev", interface)
        ip("-n", name, "link", "set", interface, "up")

    def _close(self, router: str, passes: str) -> None:
        if passes == "no udp":
            for side in ("lan", "wan"):
                ip(
                    "-n",
                    router,
                    "rule",
                    "add",
                    "pref",
                    "10",
                    "iif",
                    side,
                    "ipproto",
                    "udp",
                    "blackhole",
                )
        elif passes == "tcp 443":
            for side, port in (("lan", "dport"), ("wan", "sport")):
                ip(
                    "-n",
                    router,
                    "rule",
                    "add",
                    "pref",
                    "10",
                    "iif",
                    side,
                    "ipproto",
                    "tcp",
                    port,
                    "443",
                    "lookup",
                    "main",
                )
                ip("-n", router, "rule", "add", "pref", "11", "iif", side, "blackhole")


@contextlib.contextmanager
def internet() -> Iterator[Internet]:
    """Make an internet, and put this thread and all that it starts into it until the end of the
    block.
    """
    made = Internet(f"{os.getpid() % 100000}")
    try:
        made.open()
        with inside(made.name):
            yield made
    finally:
        made.close()
