"""`python -m benchmarks.traffic.robots`: robots without bodies, many in one process, with the
traffic of real ones that are being driven.

Each has an MQTT connection of its own and speaks Robot API v1: presence with a will, factsheet,
poses 15 times, heartbeats 5 times and states 4 times a second, with the commands that it took.
Leases and what waits for the broker are decided by the agent's own code
(robots/agent/safety/lease.py, outbox.py), and the nodes of a broker are used as the agent does
(broker_link/mqtt.py); there is no safety kernel and no base, so that nothing of what moves can be
concluded from them.

What they measure is how long commands were on their way: the page's stamp is in the command, and
all processes share one clock.
"""

import asyncio
import random
import secrets
import time
from array import array
from collections import Counter, deque
from dataclasses import asdict, dataclass, field
from typing import Any

from benchmarks.traffic import worker
from benchmarks.traffic.every import Timers
from benchmarks.traffic.mqtt_line import MqttLine, hello
from benchmarks.traffic.packets import PublishPacket
from robots.agent.broker_link.mqtt import TIMEOUT
from robots.agent.broker_link.outbox import OutboundMessage, Outbox, outbound
from robots.agent.safety.lease import LeaseKeeper
from robots.api import codec, messages as m, topics

POSE, STATE, BEAT = 1 / 15, 1 / 4, 1 / 5
STATES_KEPT = 9600
WINDOW = 200  # messages that may await the broker's acknowledgement
AGAIN = (0.2, 1.0)  # s until the next attempt to connect, at random
WORD = TIMEOUT  # s to wait for the broker's answer
LIMITS = m.Limits(
    linear=0.7,
    reverse=0.3,
    angular=0.7,
    linear_acceleration=0.5,
    angular_acceleration=1.0,
    linear_braking=0.8,
    angular_braking=1.6,
)
FOOTPRINT = ((0.3, 0.25), (-0.3, 0.25), (-0.3, -0.25), (0.3, -0.25))
COVARIANCE = (0.01, 0.0, 0.0, 0.01, 0.0, 0.004)


@dataclass
class RobotMeasurements:
    """The measurements of a process's robots: seconds that commands took, and counts."""

    delays: array = field(default_factory=lambda: array("d"))
    counts: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True)
class ObservedLease:
    """A lease, and the Unix time at which a robot first received it."""

    robot: str
    session: str
    epoch: int
    at: float


def factsheet_of(name: str, boot: str) -> m.Factsheet:
    return m.Factsheet(
        name=name,
        series="Light",
        rca="none",
        agent_version="benchmark",
        boot=boot,
        capabilities=("velocity",),
        limits=LIMITS,
        footprint=FOOTPRINT,
        watchdog=0.3,
    )


def is_late_will(payload: bytes, *, retained: bool) -> bool:
    """Tell whether a robot hears that it has gone, which it answers as an agent does: the will of
    a connection that died half open comes after the next one's first word.
    """
    return not retained and codec.decode("connection", payload).state != "ONLINE"


class LightRobot:
    """One robot. `states` has the number of its states, by session and boot; `grants` every lease
    that it received.
    """

    def __init__(
        self, name: str, token: str, measured: RobotMeasurements, timers: Timers, rng: random.Random
    ) -> None:
        self.name, self._token, self._measured, self._timers, self._rng = (
            name,
            token,
            measured,
            timers,
            rng,
        )
        self.boot = f"{int(time.time() * 1000):012x}-{secrets.token_hex(4)}"
        self.states: Counter[str] = Counter()
        self.grants: list[ObservedLease] = []
        self.online = False
        self._leases, self._outbox = LeaseKeeper(), Outbox()
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=STATES_KEPT)
        self._flying: dict[int, tuple[OutboundMessage, float]] = {}  # and since when
        self._knocked_at: float | None = None
        self._seq = self._beats = self._packet = 0
        self._applied: list[m.AppliedCommand] = []
        self._last = ("", 0, 0)  # session, epoch and number of the newest command
        self._echoes: dict[str, m.Echo] = {}
        self._line: MqttLine | None = None
        self._over = asyncio.Event()

    @property
    def has_lease(self) -> bool:
        return self._leases.announced(time.monotonic()) is not None

    # --- its connection ---------------------------------------------------------------------------

    async def live(self, nodes: deque[tuple[str, int]]) -> None:
        """Connect, and again whenever the connection is lost, for ever, each time with the next of
        the broker's nodes.
        """
        rings = [
            (POSE, self._say_pose),
            (STATE, self._say_state),
            (BEAT, self._say_beat),
            (1.0, self._leave_a_mute_node),
        ]
        for period, act in rings:
            self._timers.every(period, self._rng.random(), act)
        will = PublishPacket(
            topics.of(self.name, "connection"), self._presence("CONNECTIONBROKEN"), 1, retain=True
        )
        filters = [(each, 0) for each in topics.subscriptions(self.name)]
        said = hello(f"{self.name}-{secrets.token_hex(8)}", self.name, self._token, will)
        while True:
            self._over.clear()
            try:
                async with asyncio.timeout(WORD):
                    _, self._line = await asyncio.get_running_loop().create_connection(
                        lambda: MqttLine(self, said, filters), *nodes[0]
                    )
                self._knocked_at = time.monotonic()
                await self._over.wait()
            except OSError:  # a TimeoutError, too
                self._measured.counts["connection_refused"] += 1
            nodes.rotate(-1)
            await asyncio.sleep(self._rng.uniform(*AGAIN))

    def _leave_a_mute_node(self) -> None:
        flying = next(iter(self._flying.values()), None)
        since = flying[1] if flying is not None else self._knocked_at
        if self._line is not None and since is not None and time.monotonic() - since > WORD:
            self._measured.counts["mute"] += 1
            self._line.abort()

    def opened(self) -> None:
        self.online, self._knocked_at = True, None
        self._put("connection", self._presence("ONLINE"))
        self._put("factsheet", codec.encode(factsheet_of(self.name, self.boot)))

    def closed(self) -> None:
        if self.online:
            self._measured.counts["connection_lost"] += 1
        self.online, self._knocked_at = False, None
        self._flying.clear()
        self._outbox.disconnected()
        self._over.set()

    def acknowledged(self, packet_id: int) -> None:
        flying = self._flying.pop(packet_id, None)
        if flying is not None:
            self._outbox.acknowledged(flying[0])
        self._flush()

    def _put(self, suffix: str, payload: bytes) -> None:
        self._outbox.put(outbound(suffix, payload), connected=self.online)
        self._flush()

    def _flush(self) -> None:
        while (
            self.online
            and self._line is not None
            and len(self._outbox)
            and len(self._flying) < WINDOW
        ):
            message = self._outbox.take()
            if message.qos:
                self._packet = self._packet % 0xFFFF + 1
                self._flying[self._packet] = message, time.monotonic()
            self._line.publish(
                topics.of(self.name, message.suffix),
                message.payload,
                self._packet if message.qos else 0,
                retain=message.retained,
            )
            if not message.qos:
                self._outbox.acknowledged(message)

    # --- what it hears ----------------------------------------------------------------------------

    def on_message(self, topic: str, payload: bytes, *, retained: bool) -> None:
        now = time.time()
        suffix = topic.rpartition("/")[2]
        match suffix:
            case "velocity":
                self._command(codec.decode("command/velocity", payload), now)
            case "heartbeat":
                beat = codec.decode("command/heartbeat", payload)
                self._echoes[beat.peer] = m.Echo(
                    peer=beat.peer, n=beat.n, stamp=beat.stamp, received=now
                )
            case "lease":
                self._lease(payload, now, retained=retained)
            case "connection" if is_late_will(payload, retained=retained):
                self._put("connection", self._presence("ONLINE"))
            case "action":
                action = codec.decode("command/action", payload)
                if isinstance(action, m.ResendStates) and action.boot == self.boot:
                    self._say_again(action)

    def _command(self, command: m.VelocityCommand, now: float) -> None:
        self._measured.delays.append(now - command.stamp)
        last = (
            self._last
            if self._last[:2] == (command.session, command.epoch)
            else (command.session, command.epoch, command.seq - 1)
        )
        self._measured.counts["commands_missing"] += max(0, command.seq - last[2] - 1)
        self._last = (command.session, command.epoch, command.seq)
        lease = self._leases.live(time.monotonic())
        if lease is None or (command.session, command.epoch) != (lease.session, lease.epoch):
            self._measured.counts["commands_refused"] += 1
            return
        self._measured.counts["commands"] += 1
        applied = m.AppliedCommand(
            seq=command.seq,
            stamp=command.stamp,
            method=command.method,
            way="mqtt",
            age=now - command.stamp,
            linear=command.linear,
            angular=command.angular,
        )
        self._applied = [*self._applied, applied][-60:]

    def _lease(self, payload: bytes, now: float, *, retained: bool) -> None:
        before = self._leases.announced(time.monotonic())
        if payload:
            self._take(codec.decode("lease", payload), now, retained=retained)
        else:
            self._leases.clear()
        after = self._leases.announced(time.monotonic())
        if before is not None and (after is None or after.session != before.session):
            self._close(before)

    def _take(self, lease: m.Lease, now: float, *, retained: bool) -> None:
        if not self._leases.take(lease, retained=retained, now=time.monotonic()):
            self._measured.counts["leases_late"] += 1
        elif not self.grants or (self.grants[-1].session, self.grants[-1].epoch) != (
            lease.session,
            lease.epoch,
        ):
            self.grants.append(ObservedLease(self.name, lease.session, lease.epoch, now))
            self._say_event("lease_taken", lease)

    def _close(self, lease: m.Lease) -> None:
        last = self._say_state(lease)
        self._say_event("session_closed", lease, last_seq=last)

    def _say_again(self, action: m.ResendStates) -> None:
        for seq, payload in self._kept:
            if action.first <= seq <= action.last:
                self._measured.counts["states_resent"] += 1
                self._put("state", payload)

    # --- what it says -----------------------------------------------------------------------------

    def _say_pose(self) -> None:
        if self._leases.live(time.monotonic()) is not None:  # a robot that stands says none
            self._measured.counts["poses"] += self.online
            self._put(
                "pose",
                codec.encode(
                    m.PoseUpdate(
                        stamp=time.time(),
                        pose=self._pose(),
                        velocity=m.Velocity(linear=0.35, angular=0.1),
                    )
                ),
            )

    def _say_beat(self) -> None:
        self._beats += 1
        newest = sorted(self._echoes.values(), key=lambda echo: echo.received)[-4:]
        self._put(
            "heartbeat",
            codec.encode(m.Heartbeat(n=self._beats, stamp=time.time(), echoes=tuple(newest))),
        )

    def _say_state(self, of: m.Lease | None = None) -> int:
        lapsed = self._leases.lapse(time.monotonic())
        if lapsed is not None:
            self._measured.counts["leases_lapsed"] += 1
            self._close(lapsed)
        lease = of or self._leases.announced(time.monotonic())
        self._seq += 1
        payload = codec.encode(self._state(lease))
        self._applied = []
        self._kept.append((self._seq, payload))
        if lease is not None:
            self.states[lease.session] += 1
        self._put("state", payload)
        return self._seq

    def _say_event(self, kind: Any, lease: m.Lease, **more: Any) -> None:
        event = m.Event(
            stamp=time.time(),
            boot=self.boot,
            seq=self._seq + 1,
            session=lease.session,
            epoch=lease.epoch,
            type=kind,
            **more,
        )
        self._put("event", codec.encode(event))

    def _state(self, lease: m.Lease | None) -> m.State:
        now, beat = time.time(), self._echoes.get(lease.peer) if lease else None
        return m.State(
            stamp=now,
            boot=self.boot,
            seq=self._seq,
            session=lease.session if lease else None,
            epoch=lease.epoch if lease else 0,
            pose=self._pose(),
            velocity=m.Velocity(linear=0.35 * bool(self._applied), angular=0.1),
            battery=m.Battery(charge=0.87, voltage=26.3),
            clearance=0.456,
            distance=self._seq * 0.01,
            visitor_silence=now - beat.received if beat else None,
            applied=tuple(self._applied),
        )

    @staticmethod
    def _pose() -> m.Pose:
        return m.Pose(x=3.14159, y=2.71828, theta=1.41421, covariance=COVARIANCE)

    def _presence(self, state: Any) -> bytes:
        return codec.encode(m.Connection(boot=self.boot, state=state, stamp=time.time()))


class Robots:
    """The benchmark's requests to this process; see worker.py."""

    def __init__(self) -> None:
        self._measured, self._timers, self._rng = RobotMeasurements(), Timers(), random.Random(1)
        self._robots: list[LightRobot] = []
        self._living: set[asyncio.Task[None]] = set()

    def add(self, brokers: list[tuple[str, int]], robots: list[list[str]]) -> int:
        """Let robots live, given as [name, token], spread over the nodes of the broker, each given
        as [host, port]; returns how many there are.
        """
        for name, token in robots:
            nodes = deque((host, port) for host, port in brokers)
            nodes.rotate(-len(self._robots))
            self._robots.append(LightRobot(name, token, self._measured, self._timers, self._rng))
            self._living.add(asyncio.create_task(self._robots[-1].live(nodes)))
        return len(self._robots)

    def online(self) -> int:
        return sum(robot.online for robot in self._robots)

    def leased(self) -> int:
        """Return the number of robots that have a lease, by their own record."""
        return sum(robot.has_lease for robot in self._robots)

    def measured(self) -> dict[str, Any]:
        found = {
            "delays": list(self._measured.delays),
            "counts": dict(self._measured.counts),
            "late": list(self._timers.late),
        }
        del self._measured.delays[:], self._timers.late[:]
        self._measured.counts.clear()
        return found

    def record(self) -> dict[str, Any]:
        """Return the robots' own record: states by session, and grants in the order of arrival."""
        states = {
            session: count for robot in self._robots for session, count in robot.states.items()
        }
        return {
            "states": states,
            "grants": [asdict(grant) for robot in self._robots for grant in robot.grants],
        }


if __name__ == "__main__":
    worker.serve(Robots)
