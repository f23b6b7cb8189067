"""Supervises the adapter of the robot control architecture: reconnects it, watches for silence, and
checks its values.

Whatever an adapter raises, and every invalid value, is a fault of that adapter: it is reported, the
base is braked if it still can be reached, and the adapter reconnects. The control loop continues.
"""

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Any, Protocol, TypeVar

import structlog

from robots.agent.control.state_validation import (
    UnsoundReadingError,
    sound,
    sound_progress,
    sound_velocity,
)
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import (
    ActionProgress,
    ActionRefusedError,
    Adapter,
    AdapterError,
    LimitsSpeed,
    Navigating,
    PassesVelocities,
    PreviewsRoutes,
    RcaState,
    WithLock,
)
from robots.agent.timing import Backoff
from robots.api.floorplan import ChargingDock as Station
from robots.api.messages import Action, Config, FloorPlanUpdate, Point, Velocity
from robots.api.reasons import ReasonCode
from robots.process.cancellation import until_one_ends
from robots.process.logs import reason_of
from robots.world.sensing import Floats

log = structlog.stdlib.get_logger(__name__)
Value = TypeVar("Value")

CONNECT_TIME = 30.0
FIRST_READING = 10.0  # after the connection: an architecture may need seconds to report
SILENCE = 2.0  # between two readings
START_TIME = 10.0
CANCEL_TIME = 2.0
PREVIEW_TIME = 2.0
CLOSE_TIME = 5.0


class AdapterListener(Protocol):
    """Receives news of the RCA on the control loop."""

    def reading(self, reading: RcaState) -> None:
        """Take a checked reading."""

    def progressed(self, progress: ActionProgress) -> None:
        """Take the progress of an action."""

    def adapter_changed(self, *, up: bool, reason: str = "") -> None:
        """The RCA reports valid readings, or was lost."""


class AdapterLink:
    """One adapter, connected for as long as `run` runs."""

    def __init__(self, adapter: Adapter, *, rng: random.Random) -> None:
        self.adapter = adapter
        self.up = False
        self._navigation = adapter if isinstance(adapter, Navigating) else None
        self._velocities = adapter if isinstance(adapter, PassesVelocities) else None
        self._is_locked: bool | None = None  # the base's own lock, as last set
        self._speed_limit: float | None = None  # of the RCA's navigation, as last set
        self._backoff = Backoff(rng, first=0.5)
        self._failure: asyncio.Future[None] | None = None
        self._cancelling: set[asyncio.Task[Any]] = set()

    async def run(self, listener: AdapterListener) -> None:
        """Connect, listen, and reconnect when the RCA is lost."""
        while True:
            try:
                async with asyncio.timeout(CONNECT_TIME):
                    with adapter_errors():
                        await self.adapter.connect()
                await self._listen(listener)
                reason = "it stopped reporting"
            except TimeoutError:
                reason = f"no answer within {CONNECT_TIME:.0f} s"
            except AdapterError as error:
                reason = reason_of(error)
            was_up, self.up = self.up, False
            log.warning("adapter_lost", reason=reason)
            listener.adapter_changed(up=False, reason=reason)
            await asyncio.sleep(self._backoff.failed(self._backoff.settled if was_up else 0.0))

    def apply(self, velocity: Velocity) -> Velocity | None:
        """Send a velocity and return what was really sent; None when the RCA is lost, which `run`
        reports.
        """
        if not self.up:
            return None
        with self._reported():
            return sound_velocity(self.adapter.apply(velocity))
        return None

    def wanted(self) -> Velocity | None:
        """Return the velocity of navigation that passes through the agent, None without one."""
        if not self.up or self._velocities is None:
            return None
        with self._reported():
            wanted = self._velocities.wanted()
            return None if wanted is None else sound_velocity(wanted)
        return ZERO

    def set_lock(self, *, locked: bool) -> None:
        """Set the base's own lock, where it has one, at each change and after each connection."""
        adapter = self.adapter
        if self.up and isinstance(adapter, WithLock) and locked != self._is_locked:
            self._is_locked = locked
            with self._reported():
                adapter.set_lock(locked=locked)

    def limit_speed(self, linear: float) -> None:
        """Limit the speed of the RCA's navigation, where it can be limited."""
        if self.up and isinstance(self.adapter, LimitsSpeed) and linear != self._speed_limit:
            self._speed_limit = linear
            with self._reported():
                self.adapter.limit_speed(linear)

    def located(self, reading: RcaState, points: Floats) -> RcaState:
        """Return a reading with what the agent's own navigation makes of it and of the points (n,
        2) around the robot.
        """
        if self._navigation is None:
            return reading
        try:
            with adapter_errors():
                return sound(self._navigation.located(reading, points))
        except (AdapterError, UnsoundReadingError) as error:
            self._fail(AdapterError(str(error)))
            return reading

    @property
    def dock(self) -> Station | None:
        """This robot's dock on the map of the agent's own navigation."""
        return self._navigation.dock if self._navigation else None

    def take_floorplan(self, update: FloorPlanUpdate) -> None:
        if self._navigation:
            with self._reported():
                self._navigation.take_floorplan(update)

    def configure(self, config: Config) -> None:
        if self.up:
            with self._reported():
                self.adapter.configure(config)

    async def start(self, action: Action, is_wanted: Callable[[], bool] = lambda: True) -> None:
        """Start an action that is still wanted after all cancels have ended: not every RCA can tell
        the two apart. Raises ActionRefusedError when it certainly does not run, AdapterError when
        that is not confirmed.
        """
        if not self.up:
            raise ActionRefusedError(ReasonCode.NOT_CONNECTED)
        try:
            async with asyncio.timeout(START_TIME):
                while self._cancelling:  # OwnedActions takes how these end
                    await asyncio.wait(self._cancelling)
                if not is_wanted():
                    raise ActionRefusedError(ReasonCode.CANCELLED)
                with adapter_errors():
                    await self.adapter.start(action)
        except TimeoutError as error:
            raise AdapterError("no answer") from error

    async def cancel(self, action_id: str) -> bool:
        """Cancel an action; return whether the RCA has confirmed that it does not run. Raises
        AdapterError.
        """
        if not self.up:
            return False
        cancelling = asyncio.ensure_future(self._cancel(action_id))
        self._cancelling.add(cancelling)
        cancelling.add_done_callback(self._cancelling.discard)
        return await cancelling

    async def preview(self, x: float, y: float) -> tuple[tuple[Point, ...], str]:
        """Return the points and the reason of `messages.RoutePreview`. Raises AdapterError."""
        adapter = self.adapter
        if not self.up or not isinstance(adapter, PreviewsRoutes):
            raise AdapterError(ReasonCode.NOT_CONNECTED if not self.up else ReasonCode.UNSUPPORTED)
        try:
            async with asyncio.timeout(PREVIEW_TIME):
                with adapter_errors():
                    return await adapter.preview(x, y)
        except TimeoutError as error:
            raise AdapterError(ReasonCode.NAVIGATION_LOST.of("silent")) from error

    async def close(self) -> None:
        """Leave the robot at rest and disconnect."""
        self.up = False
        with contextlib.suppress(AdapterError, TimeoutError):
            async with asyncio.timeout(CLOSE_TIME):
                with adapter_errors():
                    await self.adapter.close()

    # --- inside -----------------------------------------------------------------------------------

    async def _listen(self, listener: AdapterListener) -> None:
        """Pass on readings and progress until one ends or the base refuses a velocity. Raises
        AdapterError.
        """
        self._failure = asyncio.get_running_loop().create_future()
        await until_one_ends(self._states(listener), self._progress(listener), self._failure)

    async def _cancel(self, action_id: str) -> bool:
        """Cancel an action at the adapter; return whether its end is confirmed.

        An adapter may cancel its own pending calls when its connection ends, which looks like a
        cancellation of this task; only the latter is raised on.

        Raises:
            AdapterError: it failed or did not answer; the action may still run.
        """
        try:
            async with asyncio.timeout(CANCEL_TIME):
                with adapter_errors():
                    return bool(await self.adapter.cancel(action_id))
        except asyncio.CancelledError as error:
            task = asyncio.current_task()
            if task is not None and task.cancelling():
                raise
            raise AdapterError("an action could not be cancelled: the connection ended") from error
        except TimeoutError as error:
            raise AdapterError(
                f"an action could not be cancelled: no answer within {CANCEL_TIME:.0f} s"
            ) from error
        except AdapterError as error:
            raise AdapterError(f"an action could not be cancelled: {error}") from error

    async def _states(self, listener: AdapterListener) -> None:
        """Pass on valid readings. Invalid ones are dropped, and the adapter counts as silent when
        no valid one arrives for `SILENCE` seconds.

        Raises:
            AdapterError: it was silent for too long, or a reading could not be handled.
        """
        states = guarded(self.adapter.states)
        silent = asyncio.timeout(FIRST_READING)
        complaint = "it is silent"
        now = asyncio.get_running_loop().time
        try:
            async with silent:
                async for reading in states:
                    try:
                        checked = sound(reading)
                    except UnsoundReadingError as error:
                        # only a valid reading postpones the time-out
                        complaint = f"it reports nonsense: {error}"
                        silent.reschedule(min(silent.when() or now(), now() + SILENCE))
                        continue
                    silent.reschedule(now() + SILENCE)
                    self._came_up(listener)
                    with adapter_errors():  # a reading that cannot be handled
                        listener.reading(checked)
        except TimeoutError as error:
            raise AdapterError(complaint) from error

    def _came_up(self, listener: AdapterListener) -> None:
        if not self.up:
            self.up = True
            self._is_locked = self._speed_limit = None
            log.info("adapter_connected", series=self.adapter.profile.series)
            listener.adapter_changed(up=True)

    async def _progress(self, listener: AdapterListener) -> None:
        async for progress in guarded(self.adapter.progress):
            with adapter_errors():
                listener.progressed(sound_progress(progress))
        # an adapter without actions ends here, and is not lost
        await asyncio.Future()

    @contextlib.contextmanager
    def _reported(self) -> Iterator[None]:
        """Have `run` report what the adapter raises in this block, and reconnect it."""
        try:
            with adapter_errors():
                yield
        except AdapterError as error:
            self._fail(error)

    def _fail(self, error: AdapterError) -> None:
        if self._failure is not None and not self._failure.done():
            self._failure.set_exception(error)


@contextlib.contextmanager
def adapter_errors() -> Iterator[None]:
    """Turn whatever an adapter raises into an AdapterError. Our own time-outs arrive as
    cancellations, which pass.
    """
    try:
        yield
    except AdapterError:
        raise
    except Exception as error:
        log.exception("adapter_raised")
        raise AdapterError(f"{type(error).__name__}: {error}") from error


async def guarded(source: Callable[[], AsyncIterator[Value]]) -> AsyncIterator[Value]:
    """Iterate over an adapter's items; whatever it raises becomes an AdapterError."""
    with adapter_errors():
        async for each in source():
            yield each
