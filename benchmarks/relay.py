"""How long a command takes through the server: page → WebSocket → daphne → MQTT → robot, and the
robot's answer back to the page.

At 50 Hz, in blocks that alternate with the same exchange over MQTT alone, so that the ratio is one
of the same run. The robot answers every velocity with a pose that carries its number.
"""

import asyncio
import contextlib
import json
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import aiomqtt

from robots.api import codec, messages as m, topics
from sessions import protocol
from tests.support.patience import until
from tests.support.sessions.bridge_rig import Rig, RobotDouble, SocketPage

RATE = 50.0
BLOCKS, SAMPLES = 5, 200
RESULTS = Path(__file__).parent / "results" / "relay.json"
LIMIT_MS = 10.0


class EchoRobot(RobotDouble):
    """A robot that answers every velocity at once with a pose whose stamp is the
    command's number.
    """

    async def _read(self) -> None:
        with contextlib.suppress(aiomqtt.MqttError):
            async for message in self.client.messages:
                suffix = str(message.topic).rpartition("/")[2]
                if suffix == "velocity":
                    seq = codec.decode("command/velocity", message.payload).seq
                    await self.say("pose", pose(seq), qos=0)
                elif suffix == "lease":
                    self.got.append(("lease", message.payload))


def pose(seq: int) -> m.PoseUpdate:
    return m.PoseUpdate(
        stamp=float(seq),
        pose=m.Pose(x=0.0, y=0.0, theta=0.0),
        velocity=m.Velocity(linear=0.0, angular=0.0),
    )


def command(seq: int) -> m.VelocityCommand:
    return m.VelocityCommand(
        session="s", epoch=0, seq=seq, stamp=time.time(), linear=0.1, angular=0.0, method="keyboard"
    )


class Stopwatch:
    """Round trips by number, in milliseconds."""

    def __init__(self) -> None:
        self._sent: dict[int, float] = {}
        self.times: list[float] = []
        self._next = 0

    def send(self) -> int:
        self._next += 1
        self._sent[self._next] = time.perf_counter()
        return self._next

    def arrive(self, seq: int) -> None:
        began = self._sent.pop(seq, None)
        if began is not None:
            self.times.append((time.perf_counter() - began) * 1000.0)


async def pace(watch: Stopwatch, send: Callable[[int], object]) -> None:
    """Send a block at 50 Hz and wait for its last answer."""
    wanted = len(watch.times) + SAMPLES
    began = time.perf_counter()
    for number in range(SAMPLES):
        await asyncio.sleep(max(0.0, began + number / RATE - time.perf_counter()))
        sending = send(watch.send())
        if asyncio.iscoroutine(sending):
            await sending
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(2.0):
            while len(watch.times) < wanted:
                await asyncio.sleep(0.01)


async def measure(site: Rig, cookie: str) -> tuple[Stopwatch, Stopwatch, float]:
    """Return both stopwatches and the share of a core that the web process took
    while it relayed.
    """
    through_server, broker_alone, cpu, relayed_for = Stopwatch(), Stopwatch(), 0.0, 0.0
    user, password = site.django(
        "from robots.enrol.credentials import server_credentials as of; print(*of('web'))"
    ).split()
    direct = aiomqtt.Client("127.0.0.1", site.mqtt_port, username=user, password=password)
    async with EchoRobot(site) as robot, SocketPage(site, cookie) as page, direct:
        await direct.subscribe(topics.of("giraff", "pose"))
        await page.say("session/take", protocol.Take())
        await page.expect("session/granted")
        await until(lambda: robot.got)
        readers = [
            asyncio.create_task(read_page(page, through_server)),
            asyncio.create_task(read_direct(direct, broker_alone)),
        ]
        for _ in range(BLOCKS):
            used, began = cpu_seconds(site.processes["web"].pid), time.perf_counter()
            await pace(through_server, lambda seq: page.say("command/velocity", command(seq)))
            cpu, relayed_for = (
                cpu + cpu_seconds(site.processes["web"].pid) - used,
                relayed_for + time.perf_counter() - began,
            )
            await pace(
                broker_alone,
                lambda seq: direct.publish(
                    topics.of("giraff", "command/velocity"), codec.encode(command(seq))
                ),
            )
        for reader in readers:
            reader.cancel()
    return through_server, broker_alone, cpu / relayed_for


async def read_page(page: SocketPage, watch: Stopwatch) -> None:
    while True:
        suffix, message = await page.next()
        if suffix == "pose":
            watch.arrive(int(message.stamp))


async def read_direct(client: aiomqtt.Client, watch: Stopwatch) -> None:
    async for message in client.messages:
        watch.arrive(int(codec.decode("pose", message.payload).stamp))


def cpu_seconds(pid: int) -> float:
    """Return the processor time that a process has taken (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def summary(watch: Stopwatch) -> dict[str, float]:
    """Return count, p50, p99 and maximum in milliseconds."""
    quantiles = statistics.quantiles(watch.times, n=100)
    return {
        "n": len(watch.times),
        "p50_ms": quantiles[49],
        "p99_ms": quantiles[98],
        "max_ms": max(watch.times),
    }


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        site = Rig(Path(folder))
        try:
            site.start_web()
            server, broker, cpu = asyncio.run(measure(site, site.sign_in("bench")))
        finally:
            site.stop_all()
    through, alone = summary(server), summary(broker)
    ratio = through["p50_ms"] / alone["p50_ms"]
    print(f"{'round trip at 50 Hz':32}{'n':>6}{'p50 ms':>9}{'p99 ms':>9}{'max ms':>9}")
    for name, row in (("page, daphne, MQTT, robot, back", through), ("MQTT alone", alone)):
        print(
            f"{name:32}{row['n']:6.0f}{row['p50_ms']:9.2f}{row['p99_ms']:9.2f}{row['max_ms']:9.2f}"
        )
    print(
        f"ratio of the medians {ratio:.2f}; web process {100 * cpu:.1f} % of a core; bound: p50 ≤"
        f" {LIMIT_MS:.0f} ms"
    )
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(
        json.dumps({"relay": through, "mqtt": alone, "ratio_p50": ratio, "web_cpu": cpu}, indent=1)
    )
    return int(through["p50_ms"] > LIMIT_MS or through["n"] < BLOCKS * SAMPLES)


if __name__ == "__main__":
    raise SystemExit(main())
