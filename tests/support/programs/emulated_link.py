"""A namespace behind a link with a rate, delay and loss: two TUN interfaces and the lines of the
network lab between them, in user space because not every kernel has netem.
"""

import asyncio
import contextlib
import fcntl
import os
import struct
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

from robots.agent.lab.timed import TimedLine
from robots.api.messages import NetworkLab
from tests.support.programs.namespace import HERE, THERE, Namespace, bring_up, inside, ip

TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
TCP, UDP = 6, 17
IDEAL = NetworkLab()


def open_tun(name: str) -> int:
    tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(tun, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TUN | IFF_NO_PI))
    return tun


def kind_of(packet: bytes) -> str:
    """Return what an IPv4 packet carries; RFC 7983 tells what shares a port of WebRTC."""
    if packet[0] >> 4 != 4 or packet[9] not in {TCP, UDP}:
        return "other"
    if packet[9] == TCP:
        return "server"
    first, second = packet[4 * (packet[0] & 15) + 8 :][:2]
    if first < 128:
        return "data" if 20 <= first < 64 else "ICE"
    return "RTCP" if 192 <= second < 224 else f"RTP {second & 127}"


@dataclass
class EmulatedLink:
    """`network` is the namespace; `bits` counts what was sent there, by kind."""

    network: Namespace
    bits: Counter[str] = field(default_factory=Counter)
    _tuns: tuple[int, int] = (-1, -1)
    _lines: list[TimedLine] = field(default_factory=list)
    _loop: asyncio.AbstractEventLoop = field(default_factory=asyncio.new_event_loop)

    def set(self, there: NetworkLab, back: NetworkLab = IDEAL) -> None:
        """Replace both directions; packets in transit are lost."""
        asyncio.run_coroutine_threadsafe(self._set(there, back), self._loop).result(5)

    async def _set(self, there: NetworkLab, back: NetworkLab) -> None:
        for line in self._lines:
            line.close()
        self._lines[:] = TimedLine(there), TimedLine(back)

    def run(self) -> None:
        here, there = self._tuns
        asyncio.set_event_loop(self._loop)
        self._loop.add_reader(here, self._forward, here, there, 0)
        self._loop.add_reader(there, self._forward, there, here, 1)
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(2))  # of this thread
        self._loop.run_forever()

    def stop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)

    def _forward(self, source: int, target: int, direction: int) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                packet = os.read(source, 4096)
                if direction == 0:
                    self.bits[kind_of(packet)] += 8 * len(packet)
                deliver: Callable[[], object] = partial(os.write, target, packet)
                self._lines[direction].offer(len(packet), lambda deliver=deliver: deliver())


@contextlib.contextmanager
def emulated_link() -> Iterator[EmulatedLink]:
    """Linux, as root."""
    tag = f"{os.getpid() % 100000}"
    network = Namespace(f"tele-{tag}", f"tl{tag}")
    ip(f"netns add {network.name}")
    tuns: list[int] = []
    try:
        tuns.append(open_tun(network.cable))
        with inside(network.name):
            tuns.append(open_tun(f"tl{tag}b"))
        bring_up(network.cable, f"{HERE}/24")
        bring_up("lo", name=network.name)
        bring_up(f"tl{tag}b", f"{THERE}/24", network.name)
        link = EmulatedLink(network, _tuns=(tuns[0], tuns[1]))
        thread = threading.Thread(target=link.run, daemon=True)
        thread.start()
        link.set(IDEAL)
        yield link
        link.stop()
        thread.join(5)
    finally:
        for tun in tuns:
            os.close(tun)
        ip(f"netns del {network.name}")
