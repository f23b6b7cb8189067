"""A real Mosquitto, a scripted robot, and session managers that can be killed, for tests of the
record.
"""

import asyncio
import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any, Self

import aiomqtt
from asgiref.sync import sync_to_async
from django.conf import settings

from robots.api import codec, messages, topics
from robots.process.cancellation import cancel, until_one_ends
from sessions.manager.service import SessionManager
from tests.support import words
from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.programs.mosquitto import Mosquitto

HOST = "127.0.0.1"


async def wait_for(condition: Callable[[], Any], within: float = 10.0, what: str = "") -> Any:
    """Return the first truthy value of `condition()`, which runs in a thread where the ORM may be
    used.
    """
    deadline = time.monotonic() + patient(within)
    while not (value := await sync_to_async(condition)()):
        assert time.monotonic() < deadline, f"{what or condition} did not come within {within} s"
        await asyncio.sleep(0.05)
    return value


@contextlib.contextmanager
def running_mosquitto() -> Iterator[Mosquitto]:
    kept = tempfile.TemporaryDirectory(prefix="telepresence-mosquitto-")
    with kept as directory, Mosquitto(Path(directory), persists=True) as broker:
        yield broker


class ScriptedRobot:
    """Speaks as an agent does: states by the number, heartbeats with echoes, and what is asked for
    again from its buffer.

    `loses(seq)` names states that do not reach the broker the first time. `silence` is what it says
    of its visitor.
    """

    def __init__(
        self,
        name: str,
        url: str,
        *,
        boot: str = "boot-1",
        clock_ahead: float = 0.0,
        period: float = 0.05,
        login: tuple[str, str] = ("", ""),
    ) -> None:
        self.name, self.boot, self.period, self._ahead = name, boot, period, clock_ahead
        self._login = {"username": login[0], "password": login[1]} if login[0] else {}
        self.driven: list[messages.VelocityCommand] = []
        self._port = int(url.rpartition(":")[2])
        self.seq = 0
        self.session: str | None = None
        self.epoch = 0
        self.leases: list[messages.Lease | None] = []
        self.silence: float | None = 0.1
        self.drives = False
        self.buffer: dict[int, bytes] = {}
        self.sent: dict[str, list[int]] = {}
        self.asked: list[tuple[int, int]] = []
        self.loses: Callable[[int], bool] = lambda _seq: False
        self.answers = True
        self.speaks = True
        self.safety = messages.Safety()
        self.beats: list[float] = []  # when the server's heartbeats came (monotonic seconds)
        self.ordered: list[messages.Action] = []
        self._beat: messages.CommandHeartbeat | None = None
        self._beat_at = 0.0
        self._task: asyncio.Task[None] | None = None
        self._leaving = False
        self._client: aiomqtt.Client | None = None

    def now(self) -> float:
        return time.time() + self._ahead

    async def __aenter__(self) -> Self:
        ready = asyncio.Event()
        self._task = asyncio.create_task(self._run(ready))
        await asyncio.wait_for(ready.wait(), patient(10))
        return self

    async def __aexit__(self, *_exc: object) -> None:
        self._leaving = True  # leaving a lost broker turns a cancellation into an MqttError
        await cancel(self._task)

    async def _run(self, ready: asyncio.Event) -> None:
        while not self._leaving:
            try:
                async with aiomqtt.Client(
                    HOST,
                    self._port,
                    identifier=f"{self.name}-{random.random()}",
                    timeout=3,
                    **self._login,
                ) as client:
                    self._client = client
                    await client.subscribe(topics.of(self.name, "lease"), 1)
                    await client.subscribe(topics.of(self.name, "command/#"), 1)
                    online = messages.Connection(boot=self.boot, state="ONLINE", stamp=self.now())
                    await client.publish(
                        topics.of(self.name, "connection"), codec.encode(online), 1, retain=True
                    )
                    ready.set()
                    await until_one_ends(self._speak(), self._listen(client))
            except aiomqtt.MqttError:
                self._client = None
                await asyncio.sleep(0.1)

    async def _listen(self, client: aiomqtt.Client) -> None:
        async for message in client.messages:
            await self._hear(str(message.topic), message.payload, message.retain)

    async def publish(self, suffix: str, message: messages.Message | bytes, qos: int = 1) -> None:
        payload = message if isinstance(message, bytes) else codec.encode(message)
        await self._client.publish(topics.of(self.name, suffix), payload, qos)

    async def _speak(self) -> None:
        while True:
            if self.speaks:
                await self.state()
                echoes = ()
                if (beat := self._beat) is not None:
                    about = {"n": beat.n, "stamp": beat.stamp, "received": self._beat_at}
                    echoes = (messages.Echo(peer="server", **about),)
                beat = messages.Heartbeat(n=self.seq, stamp=self.now(), echoes=echoes)
                await self.publish("heartbeat", beat, 0)
            await asyncio.sleep(self.period)

    async def state(self, **changes: Any) -> messages.State:
        self.seq += 1
        is_driven = self.drives and self.session
        now = {
            "stamp": self.now(),
            "boot": self.boot,
            "session": self.session,
            "epoch": self.epoch,
            "distance": self.seq * 0.01,
            "visitor_silence": self.silence if self.session else None,
            "applied": (words.applied(self.seq, stamp=self.now()),) if is_driven else (),
            "safety": self.safety,
        }
        state = words.state(self.seq, **now | changes)
        self.buffer[state.seq] = codec.encode(state)
        if state.session is not None:
            self.sent.setdefault(state.session, []).append(state.seq)
        if not self.loses(state.seq):
            await self.publish("state", self.buffer[state.seq])
        return state

    async def event(self, kind: str, **fields: Any) -> messages.Event:
        event = messages.Event(
            stamp=self.now(),
            boot=self.boot,
            seq=self.seq + 1,
            type=kind,
            **{"session": self.session, "epoch": self.epoch, **fields},
        )
        await self.publish("event", event)
        return event

    async def _hear(self, topic: str, payload: bytes, retained: bool) -> None:
        suffix = topic.removeprefix(topics.of(self.name, ""))
        if suffix == "lease":
            await self._hear_lease(payload, retained)
        elif suffix == "command/heartbeat":
            self._beat, self._beat_at = codec.decode(suffix, payload), self.now()
            self.beats.append(time.monotonic())
        elif suffix == "command/velocity":
            self.driven.append(codec.decode(suffix, payload))
        elif suffix == "command/action":
            action = codec.decode(suffix, payload)
            self.ordered.append(action)
            if isinstance(action, messages.ResendStates) and action.boot == self.boot:
                self.asked.append((action.first, action.last))
                for seq in range(action.first, action.last + 1):
                    if seq in self.buffer and self.answers:
                        await self.publish("state", self.buffer[seq])

    async def _hear_lease(self, payload: bytes, retained: bool) -> None:
        lease = codec.decode("lease", payload) if payload else None
        self.leases.append(lease)
        if retained or (
            lease is not None and (lease.session, lease.epoch) == (self.session, self.epoch)
        ):
            return
        if self.session is not None:
            ended, last = self.session, max(self.sent.get(self.session, [0]))
            self.session, self.epoch = None, 0
            await self.event("session_closed", session=ended, last_seq=last)
        if lease is not None:
            self.session, self.epoch = lease.session, lease.epoch
            await self.event("lease_taken")


@contextlib.asynccontextmanager
async def running_manager(url: str) -> AsyncIterator[SessionManager]:
    """A session manager in this process; leaving it stops it properly."""
    manager = SessionManager(url, ("session-manager", "unused"), random.Random(1))
    running = asyncio.create_task(manager.run())
    try:
        await asyncio.wait_for(manager.connected.wait(), patient(15))
        yield manager
    finally:
        manager.stop()
        await asyncio.wait_for(running, patient(30))


class ManagerProcess:
    """A session manager as a process, on the test's own database."""

    def __init__(self, url: str) -> None:
        name = settings.DATABASES["default"]["NAME"]
        environment = {
            **os.environ,
            "MQTT_URL": url,
            "DATABASE_URL": f"sqlite:///{name}",
            "DJANGO_SETTINGS_MODULE": "tests.settings",
            "LOG_LEVEL": "INFO",
        }
        self.directory = tempfile.TemporaryDirectory(prefix="session-manager-")
        self.log = Path(self.directory.name) / "log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "manage.py", "run_session_manager"],
                cwd=ROOT,
                env=environment,
                stderr=log,
            )

    @property
    def output(self) -> str:
        return self.log.read_text()

    async def connected(self) -> None:
        await wait_for(
            lambda: "session_manager_connected" in self.output,
            30,
            "the session manager's connection",
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exc: object) -> None:
        try:
            self.stop()
        finally:
            self.kill()
            self.directory.cleanup()

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(patient(10))

    def stop(self) -> str:
        """End it properly, if it still runs, and return what it said."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        self.process.wait(patient(15))
        return self.output
