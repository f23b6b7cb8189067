"""Two pages that flood their robot, a driver's and an observer's: delay of the control loop's ticks
and of another page's stop.

A real control loop and media side, and two pages in Chromium that send frames of every kind at the
rate of `FLOOD`; a page whose connection is closed opens a new one as soon as it may. Pages and
robot share one computer, and the browser uses most of it. The same figures without a flood are
printed beside them.
"""

import asyncio
import functools
import itertools
import resource
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from playwright.async_api import Browser

from benchmarks.table import Figure, keep, quantiles
from robots.agent.media import MediaSide
from robots.agent.media.peers.connections import FLOOD_PAUSE
from robots.agent.thread_priority import SECOND, set_nice
from robots.api import messages as m
from robots.api.codec import encode_frame
from robots.process.interpreter import set_up_for_latency
from tests.support.agents.control_rig import ThreadedControlRig, stamped
from tests.support.browsers.browser_page import BrowserPage, chromium
from tests.support.media.loopback_peer import Exchange
from tests.support.media.synthetic_camera import SyntheticCamera, SyntheticMicrophone
from tests.support.patience import until

SECONDS = 20.0
FLOOD = 10_000  # frames a second and page
STOP_EVERY = 0.25  # s
FRAMES = [
    encode_frame(
        "command/velocity",
        m.VelocityCommand(
            session="s1", epoch=1, seq=1, stamp=1.0, linear=0.3, angular=0.0, method="keyboard"
        ),
    ).replace("{", '{"note":"stop",', 1),
    encode_frame("command/action", m.Stop(action_id="s1", stamp=1.0)),
    encode_frame("command/action", m.EStop(action_id="e1", stamp=1.0)),
    encode_frame("command/action", m.Photo(action_id="p1", stamp=1.0)),
    encode_frame("command/heartbeat", m.CommandHeartbeat(n=1, stamp=1.0, peer="p1")),
    encode_frame("command/point", m.PointCommand(peer="p1", stamp=1.0, at=(0.1, 0.1))),
    "nonsense",
]
SEND = """([frames, rate]) => {
  window.sent = 0;
  const began = performance.now();
  const room = () => window.channel?.readyState === 'open' && channel.bufferedAmount < 1e6;
  window.flood = setInterval(() => {
    while (room() && sent < ((performance.now() - began) * rate) / 1000) {
      channel.send(frames[sent % frames.length]);
      sent += 1;
    }
  }, 2);
}"""


class Watch:
    """The times of the control loop's ticks, and when it received each stop."""

    def __init__(self, rig: ThreadedControlRig) -> None:
        self.ticks: list[float] = []
        self.obeyed: dict[str, float] = {}
        dispatcher = rig.control._dispatcher
        dispatcher.tick = self._noting(dispatcher.tick, self.ticks.append)
        stop = rig.kernel.stop

        def obey(action: m.Stop, *arguments: Any, **options: Any) -> bool:
            self.obeyed.setdefault(action.action_id, time.monotonic())
            return bool(stop(action, *arguments, **options))

        rig.kernel.stop = obey

    @staticmethod
    def _noting(call: Callable[[], None], note: Callable[[float], None]) -> Callable[[], None]:
        def noted() -> None:
            note(time.monotonic())
            call()

        return noted


async def flooding(
    opened: Callable[..., Awaitable[BrowserPage]],
    exchange: Exchange,
    peer: str,
    role: m.Role,
    ends: float,
) -> tuple[int, int]:
    """Flood on one connection after the other; return how many frames were sent, and how many
    connections lost.
    """
    sent = ended = 0
    while time.monotonic() < ends:
        exchange.replies[:] = [reply for reply in exchange.replies if reply[0] != peer]
        page = await opened(exchange, peer, role=role)
        await page.watch()
        await page.page.evaluate(SEND, [FRAMES, FLOOD])
        await until(lambda: time.monotonic() >= ends or exchange.byes(peer), 2 * SECONDS)
        sent += await page.page.evaluate("window.sent")
        ended += exchange.byes(peer) == ["flooded"]
        await page.page.context.close()
        # it is not let in before
        await asyncio.sleep(min(FLOOD_PAUSE, max(0.0, ends - time.monotonic())))
    return sent, ended


async def observed(rig: ThreadedControlRig, watch: Watch, beside: list[Any]) -> list[Figure]:
    """Return the figures of `SECONDS` beside that."""
    first, states = len(watch.ticks), len(rig.link.all("state"))
    sent_at: dict[str, float] = {}
    work = asyncio.gather(*beside)
    ends = time.monotonic() + SECONDS
    for number in itertools.count():
        if time.monotonic() >= ends:
            break
        name = f"stop-{first}-{number}"
        sent_at[name] = time.monotonic()
        rig.act(stamped(m.Stop, name, role="staff"))
        await asyncio.sleep(STOP_EVERY)
    sent, ended = map(sum, zip(*await work, strict=True)) if beside else (0, 0)
    late = [
        1000 * max(0.0, after - before - 0.02)
        for before, after in itertools.pairwise(watch.ticks[first:])
    ]
    stops = [1000 * (watch.obeyed[name] - at) for name, at in sent_at.items()]
    numbers = [state.seq for state in rig.link.all("state")[states:]]
    lost = len(range(numbers[0], numbers[-1] + 1)) - len(set(numbers))
    title = "under a flood" if beside else "quiet"
    bound = 60.0 if beside else None
    return [
        *quantiles(f"{title}: tick late", late, "ms", p50=None, p99=None),
        *quantiles(f"{title}: stop obeyed after", stops, "ms", p50=None, p99=bound),
        Figure(f"{title}: states lost", lost, "", 0),
        Figure(f"{title}: frames sent", sent, ""),
        Figure(f"{title}: connections ended", ended, ""),
    ]


async def measure(directory: Path) -> int:
    async with chromium() as (browser, address):
        set_nice(SECOND)  # as the agent does, and the browser beside it does not
        return await measure_beside(browser, address, directory)


async def measure_beside(browser: Browser, address: str, directory: Path) -> int:
    exchange = Exchange(asyncio.get_running_loop())
    media = MediaSide(
        video=SyntheticCamera(),
        audio=SyntheticMicrophone(),
        viewers=4,
        reply=exchange.reply,
        on_command=lambda peer, role, packet: rig.control.receive(peer, role, packet),
    )
    rig = ThreadedControlRig(directory, media=media)
    media.start()
    set_up_for_latency()
    await asyncio.to_thread(rig.__enter__)
    await asyncio.to_thread(rig.lease, ttl=60.0)
    watch = Watch(rig)
    quiet = await observed(rig, watch, [])
    memory = _megabytes()
    ends = time.monotonic() + SECONDS
    pages = [("p1", "driver"), ("p2", "observer")]
    opened = functools.partial(BrowserPage.open, browser, address, media)
    flooded = await observed(
        rig, watch, [flooding(opened, exchange, peer, role, ends) for peer, role in pages]
    )
    grown = _megabytes() - memory
    await asyncio.to_thread(rig.__exit__)
    await asyncio.to_thread(media.close)
    more = Figure(
        "ticks late by more than quiet, p99", flooded[1].value - quiet[1].value, "ms", 10.0
    )
    return keep("page_floods", [*quiet, *flooded, more, Figure("memory grown", grown, "MB")])


def _megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(asyncio.run(measure(Path(folder))))
