"""A safety kernel in virtual time, with a driver whose clock has a known offset."""

from dataclasses import dataclass, field
from typing import Any

from robots.agent.safety.kernel import STANDSTILL, CommandVerdict, Decision, Kernel
from robots.agent.safety.permissions import CommandSender
from robots.api import messages as m
from tests.support import words

LIMITS = m.Limits(
    linear=0.7,
    reverse=0.4,
    angular=0.9,
    linear_acceleration=0.4,
    angular_acceleration=1.0,
    linear_braking=1.2,
    angular_braking=3.0,
)
CAPABILITIES = frozenset(
    {"velocity", "goto", "follow", "dock", "undock", "tilt", "relocalize", "photo", "say", "call"}
)
UNIX = 1_700_000_000.0
DRIVER_CLOCK = 37.25  # s that the driver's Unix time is ahead of the robot's
TICK = 0.02


@dataclass
class Bench:
    """`run` lets time pass; everything else happens at `now`."""

    limits: m.Limits = LIMITS
    watchdog: float = 0.5
    latch: Any = None
    now: float = 1000.0
    seq: int = 0
    wanted: m.Velocity | None = None  # what the agent's own navigation wants
    motion: m.Velocity | None = None  # how the robot moves if not as commanded
    capabilities: frozenset[str] = CAPABILITIES
    monitor: Any = None
    standstill: m.Velocity = STANDSTILL
    outputs: list[tuple[float, Decision]] = field(default_factory=list)

    def __post_init__(self):
        self.kernel = Kernel(
            self.limits,
            self.watchdog,
            self.capabilities,
            latch=self.latch,
            monitor=self.monitor,
            standstill=self.standstill,
        )

    @property
    def unix(self):
        return UNIX + self.now

    def lease(self, *, retained=False, **fields):
        lease = words.lease(stamp=self.unix, **fields)
        return self.kernel.take_lease(lease, retained=retained, now=self.now)

    def know_clock(self, peer="p1", *, offset=DRIVER_CLOCK, echoes=3, every=0.02):
        for _ in range(echoes):
            beat = self.kernel.clocks.beat(self.now, self.unix)
            there = self.unix + 0.01 + offset
            self.now += every
            answer = m.CommandHeartbeat(
                n=beat.n,
                stamp=there,
                peer=peer,
                echo=m.Echo(peer="robot", n=beat.n, stamp=beat.stamp, received=there),
            )
            self.kernel.clocks.on_heartbeat(peer, "mqtt", answer, now=self.now, unix=self.unix)
            self.kernel.heartbeat(peer, "mqtt", self.now)

    def command(self, linear=0.5, angular=0.0, *, age=0.0, frame_age=0.0, **fields):
        values = {"session": "s1", "epoch": 1, "seq": self.seq + 1} | fields
        self.seq = max(self.seq, values["seq"])
        frame = None if frame_age is None else self.unix - frame_age
        values |= {"linear": linear, "angular": angular, "frame": frame}
        return words.velocity(stamp=self.unix - age + DRIVER_CLOCK, **values)

    def drive(self, linear=0.5, angular=0.0, *, sender=None, **fields) -> CommandVerdict:
        verdict = self.kernel.velocity(
            self.command(linear, angular, **fields),
            sender or CommandSender("datachannel", "p1"),
            now=self.now,
            unix=self.unix,
        )
        self.tick()
        return verdict

    def tick(self) -> Decision:
        self.kernel.measured(
            self.kernel.commanded if self.motion is None else self.motion, self.now
        )
        decision = self.kernel.tick(self.now, self.wanted)
        self.outputs.append((self.now, decision))
        return decision

    def run(self, seconds, *, every=None, beats=None, **command):
        """Tick at 50 Hz; with `every` (s) send a command that often; with `beats` send the driver's
        heartbeats on that transport five times a second.
        """
        for step in range(1, round(seconds / TICK) + 1):
            self.now += TICK
            if beats and step % 10 == 0:
                self.kernel.heartbeat("p1", beats, self.now)
            if every and step % max(1, round(every / TICK)) == 0:
                self.drive(**command)
            else:
                self.tick()
        return self.speed

    def at_speed(self, linear=0.5, angular=0.0):
        """Give a driver the lease, and let it drive for two seconds."""
        self.lease()
        self.know_clock()
        return self.run(2.0, every=0.06, linear=linear, angular=angular)

    def navigate(self, action_id="g1", kind="goto", *, by_server=False):
        self.kernel.navigate(action_id, kind, ordered_by_server=by_server, now=self.now)

    def end_lease(self):
        self.kernel.take_lease(None, retained=False, now=self.now)

    @property
    def speed(self):
        return self.kernel.commanded.linear

    def ask(self, action, *, way="mqtt", peer=None, retained=False):
        return self.kernel.permit(
            action, CommandSender(way, peer, retained), now=self.now, unix=self.unix
        )

    def stop(self, *, action_id="stop-1", seq=0, way="datachannel", peer="p1", **fields):
        action = m.Stop(action_id=action_id, stamp=0.0, seq=seq, **fields)
        acted = self.kernel.stop(
            action, CommandSender(way, peer if way == "datachannel" else None), self.now
        )
        self.tick()
        return acted

    def estop(self, *, action_id="estop-1", way="mqtt", peer=None, **fields):
        action = m.EStop(action_id=action_id, stamp=0.0, **fields)
        acted = self.kernel.estop(action, CommandSender(way, peer), now=self.now, unix=self.unix)
        self.tick()
        return acted


def bench_with_driver(**fields) -> Bench:
    """Return a bench whose driver has the lease and a known clock."""
    bench = Bench(**fields)
    bench.lease()
    bench.know_clock()
    return bench
