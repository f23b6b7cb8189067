"""The test of the safety functions that a person starts from the robot's page.

It runs in the agent that controls the robot, and moves it: a driver on the robot's own side sends
heartbeats, velocities and stops by the path that those of a page take over the broker, under a
lease that no page has. The kernel therefore does what it does in every drive,
and the test only reads the kernel.

A docked robot first leaves its station. Three times the robot drives slowly and is stopped: by
silence of the driver, by a stop, by an emergency stop. Measured from the last velocity, or from the
stop, until the base's own readings show it at rest: seconds and metres. After the two stops the
driver's velocities must not move the robot before the stop is released. All the while the driver
asks for more than the lease allows.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

from robots.agent.control.stopping import SpeedSample, stopped_after, travelled
from robots.agent.safety.kernel import Kernel
from robots.agent.timing import Cadence
from robots.api.messages import (
    ENDED,
    Action,
    ActionState,
    ActionStatus,
    ClearEStop,
    CommandHeartbeat,
    Echo,
    EStop,
    Heartbeat,
    Lease,
    SafetyTest,
    Stop,
    Undock,
    VelocityCommand,
)
from robots.api.reasons import ReasonCode

DETAIL = "safety_test"  # of the emergency stop that the test presses

Injected = VelocityCommand | Action
Course = Generator[tuple[Injected, ...], None, None]
Result = dict[str, float | str | bool | None]


@dataclass(frozen=True)
class SafetyTestParams:
    period: float = 0.1  # s between two velocities
    excess: float = 2.0  # times the lease's limit: what the driver asks for
    moving: float = 0.04  # m/s from which the robot drives
    driving: float = 1.0  # s for which it drives before it is stopped
    starting: float = 6.0  # s after which it does not drive at all
    farthest: float = 0.3  # m that it drives before it is stopped
    stood: float = 0.4  # s at rest that show that it stays so
    stopping: float = 4.0  # s after which it does not stop at all
    held: float = 0.6  # s in which velocities must not move a stopped robot
    waiting: float = 5.0  # s for a clock, rest, or a release
    undocking: float = 60.0  # s
    tolerance: float = 0.25  # s of braking and between two readings, beyond what is computed
    overspeed: float = 1.1  # times the limit that counts as exceeded


class EndedEarlyError(Exception):
    """The test ends before all is measured, or failed; the message is its reason."""


class SafetyTestRun:
    """One test. `messages` is called in every tick of the control loop until `state` is an end.

    `status_of` returns the newest status of an action by its id; a `docked` robot is undocked.
    """

    def __init__(
        self,
        action: SafetyTest,
        kernel: Kernel,
        lease: Lease,
        now: float,
        *,
        status_of: Callable[[str], ActionStatus | None],
        docked: bool,
        params: SafetyTestParams | None = None,
    ) -> None:
        self.action, self._kernel, self._lease = action, kernel, lease
        self._status_of, self._docked = status_of, docked
        self._params = params or SafetyTestParams()
        self.state: ActionState = "RUNNING"
        self.reason = ""
        self.result: Result = {}
        self._samples: list[SpeedSample] = []
        self._now = self._began = now
        self._unix = 0.0
        self._seq = 0
        self._stops = {kernel.stop_id}  # the last one before, and the test's own
        self._due = Cadence(self._params.period)
        self._course = self._run()

    def fail(self, reason: str) -> None:
        """End the test at the next `messages`."""
        self.reason = reason

    def measured(self, speed: float, now: float) -> None:
        """Take a reading of the base's linear velocity in m/s."""
        self._samples.append(SpeedSample(now, speed))

    def answer(self, beat: Heartbeat, unix: float) -> CommandHeartbeat:
        """Return the heartbeat of this driver, whose clock is the robot's own."""
        peer = self._lease.peer
        echo = Echo(peer=peer, n=beat.n, stamp=beat.stamp, received=unix)
        return CommandHeartbeat(n=beat.n, stamp=unix, peer=peer, echo=echo)

    def messages(self, now: float, unix: float) -> tuple[Injected, ...]:
        """Return what the driver sends now. `now` is monotonic, `unix` this computer's time."""
        self._now, self._unix = now, unix
        try:
            self._check()
            return next(self._course)
        except StopIteration:
            self.state = "FINISHED"
        except EndedEarlyError as error:
            self.state, self.reason = "FAILED", str(error)
        return (self._stop("driver"),)

    def _check(self) -> None:
        """Raise if a person, or a fault, has ended the test."""
        if self.reason:
            raise EndedEarlyError(self.reason)
        lease, latch = self._kernel.leases.live(self._now), self._kernel.latch
        if lease is None or (lease.peer, lease.epoch) != (self._lease.peer, self._lease.epoch):
            raise EndedEarlyError(ReasonCode.NO_LEASE)
        if self._kernel.fault is not None:
            raise EndedEarlyError(ReasonCode.FAULT)
        if self._kernel.button_pressed or (latch is not None and latch.detail != DETAIL):
            raise EndedEarlyError(ReasonCode.ESTOP)
        if self._kernel.stop_id not in self._stops:
            raise EndedEarlyError(ReasonCode.STOPPED)

    # --- the course -------------------------------------------------------------------------------

    def _run(self) -> Course:
        # an agent that has just started waits for its first driver to release the controls
        yield from self._wait(
            lambda: self._clock_known and self._kernel.is_released, ReasonCode.CLOCK_UNKNOWN
        )
        yield from self._wait(lambda: self._kernel.is_at_rest, ReasonCode.SETTLING)
        if self._docked:
            yield from self._undock()
        limits, asked = self._kernel.limits, self._kernel.caps(self._now)
        self.result = {"limit": min(asked.linear, asked.reverse), "deadman": limits.deadman}
        yield from self._drive(1.0)
        yield from self._measure("silence", limits.deadman, ())
        yield from self._drive(-1.0)
        yield from self._measure("stop", 0.0, (self._stop(self.action.role),))
        yield from self._stay("stop", ())
        yield from self._drive(1.0)
        press = EStop(**self._signed("e"), detail=DETAIL)
        yield from self._measure("estop", 0.0, (press,))
        yield from self._stay("estop", (ClearEStop(**self._signed("c")),))
        self._judge()

    def _undock(self) -> Course:
        """Leave the charging station, as a driver would."""
        fields = self._signed("u") | {"role": "driver", "stamp": self._unix}
        order = Undock(**fields, session=self._lease.session, epoch=self._lease.epoch)
        yield (order,)
        ends = self._now + self._params.undocking
        while (status := self._status_of(order.action_id)) is None or status.status not in ENDED:
            if self._now > ends:
                raise EndedEarlyError(ReasonCode.NO_ANSWER)
            yield ()
        if status.status != "FINISHED":
            raise EndedEarlyError(status.reason or ReasonCode.FAILED)

    def _drive(self, direction: float) -> Course:
        """Drive for `driving` seconds, or `farthest` metres, whatever the first."""
        self._samples.clear()
        speed = direction * self._params.excess * self._kernel.caps(self._now).linear
        began = self._now
        moving_since: float | None = None
        while moving_since is None or self._now - moving_since < self._params.driving:
            yield self._velocity(speed)
            fastest = max((abs(sample.speed) for sample in self._samples), default=0.0)
            self.result["fastest"] = max(float(self.result.get("fastest") or 0.0), fastest)
            if moving_since is None and fastest >= self._params.moving:
                moving_since = self._now
            if travelled(self._samples) >= self._params.farthest:
                return
            if moving_since is None and self._now - began > self._params.starting:
                raise EndedEarlyError(ReasonCode.DID_NOT_MOVE)

    def _measure(self, name: str, delay: float, stop: tuple[Injected, ...]) -> Course:
        """Stop the robot, by silence if there is no `stop`; note how long and how far it went on.

        `delay` is the time in seconds after which the kernel brakes.
        """
        params, last = self._params, self._samples[-1]
        stopped_at, speed = self._now, abs(last.speed)
        self._samples = [last]
        yield stop
        while True:
            at_rest = max(self._kernel.standstill.linear, 0.001)
            took = stopped_after(self._samples[1:], stopped_at, at_rest)
            if took is not None and self._now - stopped_at - took >= params.stood:
                break
            if self._now - stopped_at > params.stopping:
                raise EndedEarlyError(ReasonCode.DID_NOT_STOP.of(name))
            yield ()
        braking = speed / self._kernel.limits.linear_braking
        self.result |= {
            f"{name}_s": round(took, 3),
            f"{name}_m": round(travelled(self._samples), 3),
            f"{name}_within_s": round(delay + braking + params.tolerance, 3),
        }

    def _stay(self, name: str, release: tuple[Injected, ...]) -> Course:
        """Ask a stopped robot to drive, which must not move it; then release it."""
        self._samples.clear()
        ends = self._now + self._params.held
        while self._now < ends:
            yield self._velocity(self._kernel.caps(self._now).linear)
        is_still = all(
            abs(sample.speed) <= self._kernel.standstill.linear for sample in self._samples
        )
        self.result[f"{name}_holds"] = is_still and not self._kernel.is_released
        yield release
        self._due = Cadence(self._params.period)
        yield from self._wait(lambda: self._kernel.is_released, ReasonCode.NOT_RELEASED)
        yield from self._wait(lambda: self._kernel.is_at_rest, ReasonCode.SETTLING)

    def _wait(self, condition: Callable[[], bool], reason: str) -> Course:
        """Send zeros until a condition holds."""
        ends = self._now + self._params.waiting
        while not condition():
            if self._now > ends:
                raise EndedEarlyError(reason)
            yield self._velocity(0.0)

    def _judge(self) -> None:
        """Fail with the first function that did not do what it must."""
        result = self.result
        for name in ("silence", "stop", "estop"):
            if float(result[f"{name}_s"] or 0.0) > float(result[f"{name}_within_s"] or 0.0):
                raise EndedEarlyError(ReasonCode.TOO_LATE.of(name))
        for name in ("stop", "estop"):
            if result[f"{name}_holds"] is not True:
                raise EndedEarlyError(ReasonCode.NOT_HELD.of(name))
        largest = self._params.overspeed * float(result["limit"] or 0.0)
        if float(result["fastest"] or 0.0) > largest + self._kernel.standstill.linear:
            raise EndedEarlyError(ReasonCode.TOO_FAST)

    # --- messages ---------------------------------------------------------------------------------

    @property
    def _clock_known(self) -> bool:
        return self._kernel.clocks.of(self._lease.peer) is not None

    def _velocity(self, linear: float) -> tuple[Injected, ...]:
        """Return the next velocity when it is due; its video frame is as old as itself."""
        if not self._due.due(self._now):
            return ()
        self._seq += 1
        bounded = max(-10.0, min(10.0, linear))
        return (
            VelocityCommand(
                session=self._lease.session,
                epoch=self._lease.epoch,
                seq=self._seq,
                stamp=self._unix,
                linear=bounded,
                angular=0.0,
                method="script",
                frame=self._unix,
            ),
        )

    def _stop(self, role: str) -> Stop:
        self._seq += 1
        own = {"session": self._lease.session, "epoch": self._lease.epoch, "seq": self._seq}
        named = self._signed(f"s{self._seq}") | {"role": role}
        self._stops.add(named["action_id"])
        return Stop(**named | (own if role == "driver" else {}))

    def _signed(self, suffix: str) -> dict[str, Any]:
        """Return the fields of who asked for the test; the server's clock judges the stamp."""
        return {
            "action_id": f"{self.action.action_id[:50]}-{suffix}",
            "stamp": self.action.stamp + self._now - self._began,
            "role": self.action.role,
            "user": self.action.user,
        }
