"""How late honest messages are while a client floods the broker (NATS) as fast as it can, next to
how late they are without a flood.

The broker is `manage.py run_broker` in a process of its own, with users from a database. An
attacker in another process (benchmarks/traffic/flooder.py) has the key of one robot, on one
connection and on ten, or none at all. This process plays another robot and a server that exchange
commands and poses by QoS 0 and states by QoS 1, and lets newcomers in beside them. Neither listens
to the robot that floods: the broker limits no sender, so that its listeners get all of it. Every
flood comes after a time of peace, so that the two stand side by side.

Attacker, broker and honest clients share the cores of this computer, where an attacker would have a
computer of its own: it is given what the others leave (nice 19), and a delay contains what broker
and honest clients wait for a core. On a computer with other work the figures are that work's.
`FLOODS` (with commas) chooses what is tried, `FLOODS_SECONDS` how long.
"""

import asyncio
import gc
import os
import random
import ssl
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from benchmarks.table import Figure, keep
from benchmarks.traffic import shares
from benchmarks.traffic.flooder import HOST, KEY_FLOODS, STRANGER_FLOODS
from benchmarks.traffic.mqtt_line import MqttLine, hello
from robots.api import topics
from robots.process.cancellation import cancel
from tests.support.programs.server import certificate

ROOT = Path(__file__).resolve().parents[1]
HONEST, HOSTILE = "honest", "hostile"
SECONDS = float(os.environ.get("FLOODS_SECONDS", "4"))
WARM_SECONDS = 1.0
RATE = 50.0  # Hz of each kind of message
NEWCOMER_SECONDS = 0.25
SERVER_SUBSCRIPTIONS = (("pose", 0), ("state", 1), ("connection", 1))
STRANGERS = 20  # connections without a key; `SILENT`: those that send nothing
SILENT = 70
KEY_BOUND_MS, STRANGER_BOUND_MS = 500.0, 250.0  # more than in peace, 99 of 100 messages
NEWCOMER_BOUND_MS = 1000.0
MEMORY_BOUND_MB = 64.0  # 200 strangers in the handshake of TLS have 50 MB of buffers
LOG_BOUND_KB = 64.0
LATEST_SECONDS = 10.0  # a message that takes longer is lost


@dataclass
class FloodDelays:
    """Seconds that messages took, and that newcomers waited to be let in."""

    delays: list[float] = field(default_factory=list)
    first_time_users: list[float] = field(default_factory=list)
    lost: int = 0


class Client:
    """One honest connection: says when it is open, and hands messages on."""

    def __init__(self, name: str, user: str, token: str, filters: list[tuple[str, int]]) -> None:
        self.is_open = asyncio.Event()
        self.arrived: list[tuple[float, float]] = []  # (sent, seconds)
        self.line = MqttLine(self, hello(name, user, token), filters)

    def opened(self) -> None:
        self.is_open.set()

    def on_message(self, topic: str, payload: bytes, *, retained: bool) -> None:
        if f"/{HONEST}/" in topic and len(payload) == 8:
            (sent,) = struct.unpack("d", payload)
            self.arrived.append((sent, time.perf_counter() - sent))

    def acknowledged(self, packet_id: int) -> None:
        pass

    def closed(self) -> None:
        """Be closed, which no flood may do to us."""
        self.is_open.clear()


class FloodedBroker:
    """A broker with its users, and honest clients at it."""

    def __init__(
        self,
        port: int,
        process: "subprocess.Popen[bytes]",
        log: IO[bytes],
        tokens: dict[str, tuple[str, str]],
        ca: str,
    ) -> None:
        self.port, self.process, self.log, self.tokens, self.ca = port, process, log, tokens, ca
        self._tls = ssl.create_default_context(cafile=ca) if ca else None

    async def enter(self, name: str, who: str, filters: list[tuple[str, int]]) -> Client:
        client = Client(name, *self.tokens[who], filters)
        await asyncio.get_running_loop().create_connection(
            lambda: client.line, HOST, self.port, ssl=self._tls
        )
        await asyncio.wait_for(client.is_open.wait(), LATEST_SECONDS)
        return client

    async def measure(self, seconds: float) -> FloodDelays:
        try:
            robot = await self.enter(
                "the-robot", HONEST, [(topics.of(HONEST, "command/velocity"), 0)]
            )
            filters = [(topics.of(HONEST, suffix), qos) for suffix, qos in SERVER_SUBSCRIPTIONS]
            server = await self.enter("the-server", "web", filters)
        except (OSError, TimeoutError):
            return FloodDelays([LATEST_SECONDS], [LATEST_SECONDS], 1)  # no client can connect
        sample = FloodDelays()
        coming = asyncio.create_task(self._newcomers(sample))
        sent, until = 0, time.perf_counter() + seconds
        rng = random.Random(7)
        while time.perf_counter() < until and robot.is_open.is_set() and server.is_open.is_set():
            server.line.publish(topics.of(HONEST, "command/velocity"), _stamp())
            robot.line.publish(topics.of(HONEST, "pose"), _stamp())
            robot.line.publish(topics.of(HONEST, "state"), _stamp(), 1 + sent % 60000)
            sent += 3
            await asyncio.sleep(rng.uniform(0.5, 1.5) / RATE)
        latest = time.perf_counter() + LATEST_SECONDS
        while len(robot.arrived) + len(server.arrived) < sent and time.perf_counter() < latest:
            await asyncio.sleep(0.01)
        await cancel(coming)
        sample.delays = [delay for _, delay in robot.arrived + server.arrived]
        sample.lost = sent - len(sample.delays)
        sample.first_time_users = sample.first_time_users or [LATEST_SECONDS]
        for client in (robot, server):
            client.line.leave()
        return sample

    async def _newcomers(self, sample: FloodDelays) -> None:
        while True:
            began = time.perf_counter()
            try:
                first_time_user = await self.enter(
                    f"newcomer-{len(sample.first_time_users)}",
                    HONEST,
                    [(topics.of(HONEST, "config"), 1)],
                )
                first_time_user.line.leave()
            except (OSError, TimeoutError):
                sample.first_time_users.append(LATEST_SECONDS)
                continue
            sample.first_time_users.append(time.perf_counter() - began)
            await asyncio.sleep(NEWCOMER_SECONDS)

    @contextmanager
    def flooded(self, flood: str, connections: int) -> Iterator[None]:
        words = [
            sys.executable,
            "-m",
            "benchmarks.traffic.flooder",
            flood,
            str(self.port),
            *self.tokens[HOSTILE],
            str(connections),
        ]
        attacker = subprocess.Popen(
            ["nice", "-n", "19", *words, *([self.ca] if self.ca else [])], cwd=ROOT
        )
        try:
            time.sleep(WARM_SECONDS)
            yield
            assert attacker.poll() is None, "the attacker gave up"
        finally:
            attacker.kill()
            attacker.wait()


def _stamp() -> bytes:
    return struct.pack("d", time.perf_counter())


def prepare() -> dict[str, tuple[str, str]]:
    """Make a database with two robots; return (user, password) of each, and of the server."""
    import django

    django.setup()
    from django.core.management import call_command
    from django.utils import timezone

    from robots.enrol.credentials import make_credentials, server_credentials
    from robots.models import Robot

    call_command("migrate", verbosity=0)
    robots = {name: Robot.objects.create(name=name, title=name) for name in (HONEST, HOSTILE)}
    return {"web": server_credentials("web")} | {
        name: (name, make_credentials(robot, timezone.now()).token)
        for name, robot in robots.items()
    }


@contextmanager
def running_broker(
    folder: Path, tokens: dict[str, tuple[str, str]], *, tls: bool
) -> Iterator[FloodedBroker]:
    """Run the broker as a site does."""
    more, ca = [], ""
    if tls:
        key, chain = certificate(folder)
        more, ca = ["--certificate", str(chain), "--key", str(key)], str(chain)
    words = [
        sys.executable,
        "manage.py",
        "run_broker",
        "--port",
        "0",
        "--engine",
        "nats",
        *more,
    ]
    with (folder / f"broker-{tls}.log").open("wb+") as log:
        process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=log)
        assert process.stdout is not None, "a pipe was asked for"
        try:
            line = process.stdout.readline().decode()
            yield FloodedBroker(
                int(line.rpartition(" (")[0].rpartition(":")[2]), process, log, tokens, ca
            )
        finally:
            process.terminate()
            process.wait(30)


def p99(seconds: list[float]) -> float:
    """Return the 99th percentile in ms."""
    return float(np.percentile(seconds, 99)) * 1000 if seconds else float("inf")


def compare(
    place: FloodedBroker, flood: str, connections: int
) -> tuple[list[Figure], dict[str, Any]]:
    peace = asyncio.run(place.measure(SECONDS))
    process = {"broker": place.process.pid}
    before, logged = shares.memory(process)["broker"], place.log.seek(0, os.SEEK_END)
    with place.flooded(flood, connections):
        taken = shares.read(process)
        war = asyncio.run(place.measure(SECONDS))
        share = shares.between(taken, shares.read(process))["broker"]
        grown, logged = (
            shares.memory(process)["broker"] - before,
            (place.log.seek(0, os.SEEK_END) - logged) / 1024,
        )
    what = f"{flood}, {connections}" + (", TLS" if place.ca else "")
    cells = [
        f"{1000 * float(np.percentile(s.delays, q)):8.2f}"
        for s in (peace, war)
        for q in (50, 99, 100)
    ]
    come = [f"{1000 * max(s.first_time_users):7.0f}" for s in (peace, war)]
    print(
        f"{what:24} {' '.join(cells)}   {' '.join(come)}  {war.lost:5d}  {share:5.2f}  {grown:6.1f}"
        f"  {logged:6.1f}",
        flush=True,
    )
    bound = KEY_BOUND_MS if flood in KEY_FLOODS else STRANGER_BOUND_MS
    figures = [
        Figure(
            f"{what}: p99 of delays, more than in peace",
            max(0.0, p99(war.delays) - p99(peace.delays)),
            "ms",
            bound,
        ),
        Figure(
            f"{what}: newcomers, the slowest",
            1000 * max(war.first_time_users),
            "ms",
            NEWCOMER_BOUND_MS,
        ),
        Figure(f"{what}: messages lost", war.lost, "", 0),
        Figure(f"{what}: memory grown", grown, "MB", MEMORY_BOUND_MB),
        Figure(f"{what}: logged", logged, "kB", LOG_BOUND_KB),
    ]
    return figures, {"what": what, "peace": asdict(peace), "flood": asdict(war), "share": share}


def plan(*, tls: bool) -> list[tuple[str, int]]:
    """Return the (flood, connections) to try."""
    chosen = (
        os.environ.get("FLOODS", "").split(",")
        if os.environ.get("FLOODS")
        else [*KEY_FLOODS, *STRANGER_FLOODS]
    )
    by_key = (
        []
        if tls
        else [(flood, count) for flood in chosen if flood in KEY_FLOODS for count in (1, 10)]
    )
    return by_key + [
        (flood, SILENT if flood == "silent" else STRANGERS)
        for flood in chosen
        if flood in STRANGER_FLOODS
    ]


def main() -> int:
    gc.freeze()
    figures, samples = [], []
    with tempfile.TemporaryDirectory(prefix="telepresence-floods-") as name:
        settings = {
            "VAR_DIR": name,
            "HTTP_ONLY": "1",
            "LOG_LEVEL": "INFO",
            "DJANGO_SETTINGS_MODULE": "telepresence_site.settings",
        }
        os.environ |= settings
        os.environ.pop("DATABASE_URL", None)
        tokens = prepare()
        print(
            "delays in ms: p50, p99, max in peace; p50, p99, max under the flood; slowest newcomer"
            " in peace, under it (ms); messages lost;"
        )
        print("share of a core that the broker took; memory grown (MB); logged (kB)")
        for tls in (False, True):
            with running_broker(Path(name), tokens, tls=tls) as place:
                for flood, connections in plan(tls=tls):
                    found, sample = compare(place, flood, connections)
                    figures += found
                    samples.append(sample)
    return keep("floods", figures, samples=samples)


if __name__ == "__main__":
    sys.exit(main())
