"""`python -m benchmarks.traffic.idle_robots`: thousands of idle robots in one process, each with
its own MQTT connection, user and will.

They follow robots/api/idle.py with the agent's constants: its keep-alive, a state every half
minute, four states and five heartbeats a second while they are needed, and its pauses before they
reconnect (robots/agent/broker_link/reconnection.py). They have no safety kernel and no base.
"""

import asyncio
import random
import resource
import secrets
import time
from typing import Any

from benchmarks.traffic import worker
from benchmarks.traffic.mqtt_line import MqttLine, hello
from benchmarks.traffic.packets import PublishPacket
from benchmarks.traffic.robots import factsheet_of, is_late_will
from robots.agent.broker_link.mqtt import KEEPALIVE
from robots.agent.broker_link.reconnection import Reconnection
from robots.api import codec, messages as m, topics
from robots.api.idle import IDLE_STATE_SECONDS, INTEREST_SECONDS

STATE, BEAT = 1 / 4, 1 / 5
CONNECT_SECONDS = 10.0  # after which an attempt has failed
FLEET_PER_S = 400.0  # connections a second when the benchmark begins


class IdleRobot:
    """One robot. Times are monotonic seconds."""

    def __init__(self, name: str, token: str, seed: int) -> None:
        self.name, self._token = name, token
        self.boot = f"{int(time.time() * 1000):012x}-{secrets.token_hex(4)}"
        self.is_open = False
        self.attempts = 0
        self.woken_after: float | None = None
        self._rng = random.Random(seed)
        self._seq = self._beats = self._packet = 0
        self._needed_until = float("-inf")
        self._line: MqttLine | None = None
        self._timers: list[asyncio.TimerHandle] = []
        self._over = asyncio.Event()
        self._opened = asyncio.Event()

    async def live(self, host: str, port: int) -> None:
        """Connect, and again whenever the connection is lost, for ever."""
        pauses = Reconnection(self._rng)
        while True:
            began = time.monotonic()
            await self._connect(host, port)
            held = time.monotonic() - began if self.is_open else 0.0
            self._end()
            await asyncio.sleep(pauses.pause(held, time.monotonic()))

    async def _connect(self, host: str, port: int) -> None:
        self._over.clear()
        self._opened.clear()
        self.attempts += 1
        will = PublishPacket(
            topics.of(self.name, "connection"), self._presence("CONNECTIONBROKEN"), 1, retain=True
        )
        filters = [(each, 0) for each in topics.subscriptions(self.name)]
        said = hello(f"idle-{self.boot}", self.name, self._token, will, KEEPALIVE)
        try:
            async with asyncio.timeout(CONNECT_SECONDS):
                _, self._line = await asyncio.get_running_loop().create_connection(
                    lambda: MqttLine(self, said, filters, KEEPALIVE),
                    host,
                    port,
                )
                await self._opened.wait()
        except (OSError, TimeoutError):
            return
        await self._over.wait()

    def _end(self) -> None:
        self.is_open = False
        if self._line is not None:
            self._line.abort()
        self._line = None
        for timer in self._timers:
            timer.cancel()
        self._timers.clear()

    # --- its connection ---------------------------------------------------------------------------

    def opened(self) -> None:
        self.is_open = True
        self._say("factsheet", codec.encode(factsheet_of(self.name, self.boot)))
        self._say("connection", self._presence("ONLINE"))
        self._say_state()
        self._opened.set()

    def closed(self) -> None:
        """Try again, later."""
        self._over.set()
        self._opened.set()

    def acknowledged(self, packet_id: int) -> None:
        pass

    def on_message(self, topic: str, payload: bytes, *, retained: bool) -> None:
        """Wake up at the first heartbeat of a command, and correct a will that arrives late."""
        if topic.endswith("/connection") and is_late_will(payload, retained=retained):
            self._say("connection", self._presence("ONLINE"))
        if retained or not topic.endswith("/command/heartbeat"):
            return
        beat = codec.decode("command/heartbeat", payload)
        if beat.needed:
            self.woken_after = self.woken_after or time.time() - beat.stamp
            self._wake()

    def _wake(self) -> None:
        now = time.monotonic()
        was_idle = now >= self._needed_until
        self._needed_until = now + INTEREST_SECONDS
        if was_idle:
            self._say_state()
            self._say_beat()

    # --- what it says -----------------------------------------------------------------------------

    def _say(self, suffix: str, payload: bytes) -> None:
        line = topics.find(suffix)
        if line is None or self._line is None:
            return
        self._packet = self._packet % 0xFFFF + 1
        self._line.publish(
            topics.of(self.name, suffix),
            payload,
            self._packet if line.qos else 0,
            retain=line.retained,
        )

    def _say_state(self) -> None:
        self._seq += 1
        state = m.State(
            stamp=time.time(),
            boot=self.boot,
            seq=self._seq,
            pose=m.Pose(x=3.14159, y=2.71828, theta=1.41421),
            velocity=m.Velocity(linear=0.0, angular=0.0),
            battery=m.Battery(charge=0.87, voltage=26.3),
            docked=True,
        )
        self._say("state", codec.encode(state))
        needed = time.monotonic() < self._needed_until
        self._later(0, STATE if needed else IDLE_STATE_SECONDS, self._say_state)

    def _say_beat(self) -> None:
        self._beats += 1
        self._say("heartbeat", codec.encode(m.Heartbeat(n=self._beats, stamp=time.time())))
        if time.monotonic() < self._needed_until:
            self._later(1, BEAT, self._say_beat)

    def _later(self, place: int, seconds: float, act: Any) -> None:
        handle = asyncio.get_running_loop().call_later(seconds, act)
        if place < len(self._timers):
            self._timers[place].cancel()
            self._timers[place] = handle
        else:
            self._timers.append(handle)

    def _presence(self, state: Any) -> bytes:
        return codec.encode(m.Connection(boot=self.boot, state=state, stamp=time.time()))


class IdleRobots:
    """The benchmark's requests to this process; see worker.py."""

    def __init__(self) -> None:
        hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
        self._robots: list[IdleRobot] = []
        self._living: set[asyncio.Task[None]] = set()

    def add(self, port: int, robots: list[list[str]]) -> int:
        """Let robots live, given as [name, token], one after the other; return how many there
        are.
        """
        loop = asyncio.get_running_loop()
        for number, (name, token) in enumerate(robots):
            robot = IdleRobot(name, token, len(self._robots))
            self._robots.append(robot)
            loop.call_later(number / FLEET_PER_S, self._start, robot, port)
        return len(self._robots)

    def _start(self, robot: IdleRobot, port: int) -> None:
        self._living.add(asyncio.create_task(robot.live("127.0.0.1", port)))

    def online(self) -> int:
        return sum(robot.is_open for robot in self._robots)

    def attempts(self) -> int:
        return sum(robot.attempts for robot in self._robots)

    def woken(self) -> list[float]:
        """Return the seconds after which each woken robot received its first heartbeat."""
        return [robot.woken_after for robot in self._robots if robot.woken_after is not None]


if __name__ == "__main__":
    worker.serve(IdleRobots)
