"""Networks as visitors and robots have them, and an internet between them, all in namespaces of
this process. Linux, as root.

The internet is a namespace with the addresses of a server and of a relay. Each network has a router
and one computer behind it. Routers drop what they do not let through, as firewalls do, by rules of
routing, which every kernel has; only NAT needs Debian's `nftables`.
"""

import contextlib
import itertools
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tests.support.programs.namespace import bring_up, inside, ip, wrapped

SERVER, RELAY = "203.0.113.2", "203.0.113.3"  # RFC 5737: addresses for examples
AT_HOME, ROUTER_AT_HOME = "192.168.1.2", "192.168.1.1"  # the same in every home, as they are
LAN_SERVER = "10.177.9.1"

# `usual` keeps a computer's port for all peers, `strict` takes another for each (RFC 4787: address
# and port-dependent mapping). Both drop unsolicited packets.
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
            ip(f"-n {self.name} addr add {address}/32 dev lo")
        ip(f"-n {self.name} link add lan type bridge")
        bring_up("lan", f"{LAN_SERVER}/24", self.name)

    def close(self) -> None:
        """Delete everything; cables are deleted with their namespaces."""
        for name in reversed(self._made):
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)

    def join(self, name: str, kind: Kind) -> Computer:
        """Connect a network with one computer to the internet."""
        number = next(self._count)
        computer, router = f"{name}-{self._tag}", f"{name}-{self._tag}-router"
        here, there = f"198.51.100.{4 * number + 1}", f"198.51.100.{4 * number + 2}"
        inner, gateway = (
            (AT_HOME, ROUTER_AT_HOME)
            if kind.nat != "none"
            else (f"192.0.2.{4 * number + 2}", f"192.0.2.{4 * number + 1}")
        )
        self._add(computer)
        self._add(router)
        self._cable((self.name, f"net{number}", f"{here}/30"), (router, "wan", f"{there}/30"))
        self._cable((router, "lan", f"{gateway}/30"), (computer, "eth0", f"{inner}/30"))
        ip(f"-n {router} route add default via {here}")
        ip(f"-n {computer} route add default via {gateway}")
        if kind.nat == "none":
            ip(f"-n {self.name} route add {inner}/32 via {there}")
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
        """Connect a computer to the server, at LAN_SERVER, and to nothing else."""
        number = next(self._count)
        computer = f"{name}-{self._tag}"
        self._add(computer)
        port, address = f"port{number}", f"10.177.9.{number + 1}"
        ip(f"-n {self.name} link add {port} type veth peer name eth0 netns {computer}")
        ip(f"-n {self.name} link set {port} addrgenmode none master lan")
        ip(f"-n {self.name} link set {port} up")
        bring_up("eth0", f"{address}/24", computer)
        return Computer(computer, address)

    def _add(self, name: str) -> None:
        ip(f"netns add {name}")
        self._made.append(name)
        bring_up("lo", name=name)
        ip(f"netns exec {name} sh -c 'echo 1 > /proc/sys/net/ipv4/ip_forward'")

    def _cable(self, one: tuple[str, str, str], other: tuple[str, str, str]) -> None:
        """Join two namespaces; each end is (namespace, interface, address)."""
        ip(f"-n {one[0]} link add {one[1]} type veth peer name {other[1]} netns {other[0]}")
        for namespace, interface, address in (one, other):
            bring_up(interface, address, namespace)

    def _close(self, router: str, passes: str) -> None:
        add = f"-n {router} rule add pref"
        if passes == "no udp":
            for side in ("lan", "wan"):
                ip(f"{add} 10 iif {side} ipproto udp blackhole")
        elif passes == "tcp 443":
            for side, port in (("lan", "dport"), ("wan", "sport")):
                ip(f"{add} 10 iif {side} ipproto tcp {port} 443 lookup main")
                ip(f"{add} 11 iif {side} blackhole")


@contextlib.contextmanager
def internet() -> Iterator[Internet]:
    """Make an internet; this thread and all that it starts are in it until the block ends."""
    made = Internet(f"{os.getpid() % 100000}")
    try:
        made.open()
        with inside(made.name):
            yield made
    finally:
        made.close()
