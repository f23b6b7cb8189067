"""A network for one test: a namespace joined to this machine by a cable that can be pulled."""

import contextlib
import ctypes
import os
import shlex
import stat
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

HERE, THERE = "10.177.7.1", "10.177.7.2"
CLONE_NEWNET = 0x40000000


def ip(command: str) -> None:
    """Run a command of `ip` (iproute2)."""
    subprocess.run(["ip", *shlex.split(command)], check=True, capture_output=True, text=True)


def bring_up(interface: str, address: str = "", name: str = "") -> None:
    """Give an interface an address and switch it on, in the namespace of that name or in ours."""
    there = f"-n {name} " if name else ""
    # An address that IPv6 gives itself a second later is a change of network, upon which Chromium
    # drops what it is loading.
    ip(f"{there}link set {interface} addrgenmode none")
    if address:
        ip(f"{there}addr add {address} dev {interface}")
    ip(f"{there}link set {interface} up")


def wrapped(name: str, folder: Path, program: str) -> Path:
    """Return a script that runs a program inside a namespace."""
    script = folder / f"in-{name}"
    script.write_text(f'#!/bin/sh\nexec ip netns exec {name} {program} "$@"\n')
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    return script


@dataclass(frozen=True)
class Namespace:
    """`name` of the namespace, and the interface on our side of the cable."""

    name: str
    cable: str

    def pull(self) -> None:
        ip(f"link set {self.cable} down")

    def plug(self) -> None:
        ip(f"link set {self.cable} up")

    def wrapper(self, folder: Path, program: str) -> Path:
        """Return a script that runs a program inside."""
        return wrapped(self.name, folder, program)


@contextlib.contextmanager
def namespace() -> Iterator[Namespace]:
    tag = f"{os.getpid() % 100000}"
    made = Namespace(f"tele-{tag}", f"tv{tag}a")
    ip(f"netns add {made.name}")
    try:
        ip(f"link add {made.cable} type veth peer name tv{tag}b netns {made.name}")
        bring_up(made.cable, f"{HERE}/24")
        bring_up("lo", name=made.name)
        bring_up(f"tv{tag}b", f"{THERE}/24", made.name)
        yield made
    finally:
        with contextlib.suppress(subprocess.CalledProcessError):
            ip(f"link del {made.cable}")
        ip(f"netns del {made.name}")


@contextlib.contextmanager
def inside(name: str) -> Iterator[None]:
    """Put this thread and all that it starts into a namespace until the end of the block."""
    outside = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
    try:
        within = os.open(Path("/run/netns") / name, os.O_RDONLY)
        _enter(within)
        os.close(within)
        yield
    finally:
        _enter(outside)
        os.close(outside)


def _enter(namespace: int) -> None:
    library = ctypes.CDLL(None, use_errno=True)
    if library.setns(namespace, CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "setns")
