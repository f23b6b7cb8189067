"""The way to the robot control architecture: reached again for ever, watched for silence, and
checked for sense.

Whatever an adapter raises, and whatever it returns that is no velocity and no reading, is that
adapter's fault: named, braked for as far as the base can still be told, and tried again. The
control loop goes on.
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
    RcaState,
    WithLock,
)
from robots.agent.timing import Backoff
from robots.api.floorplan import ChargingDock as Station
from robots.api.messages import Action, Config, FloorPlanUpdate, Velocity
from robots.cancellation import until_one_ends
from robots.logs import reason_of
from robots.world.sensing import Floats

log = structlog.stdlib.get_logger(__name__)
Told = TypeVar("Told")

CONNECT_TIME = 30.0
# from the connection to the first reading: an architecture may need seconds, and nobody drives
# before
FIRST_READING = 10.0
SILENCE = 2.0  # from one reading to the next
START_TIME = 10.0
CANCEL_TIME = 2.0
CLOSE_TIME = 5.0


class AdapterListener(Protocol):
    """Who hears of the RCA. Called on the control loop."""

    def reading(self, reading: RcaState) -> None:
        """Take a sound reading."""

    def progressed(self, progress: ActionProgress) -> None:
        """Take news of an action."""

    def adapter_changed(self, *, up: bool, reason: str = "") -> None:
        """The RCA reports sound readings, or was lost."""


class AdapterLink:
    """One adapter, connected for as long as `run` runs."""

    def __init__(self, adapter: Adapter, *, rng: random.Random) -> None:
        self.adapter = adapter
        self.up = False
        self._navigation = adapter if isinstance(adapter, Navigating) else None
        self._velocities = adapter if isinstance(adapter, PassesVelocities) else None
        self._is_locked: bool | None = None  # as the base's own lock was last set
        self._speed_limit: float | None = None  # as the RCA's navigation was last told
        self._backoff = Backoff(rng, first=0.5)
        self._failure: asyncio.Future[None] | None = None
        self._cancelling: set[asyncio.Task[Any]] = set()

    async def run(self, listener: AdapterListener) -> None:
        """Connect, listen, and begin again when the RCA is lost."""
        while True:
            try:
                async with asyncio.timeout(CONNECT_TIME):
                    with its_fault():
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
        """Send a velocity to the base and return what was really sent; None when the RCA is gone,
        which `run` then reports.
        """
        if not self.up:
            return None
        try:
            with its_fault():
                return sound_velocity(self.adapter.apply(velocity))
        except AdapterError as error:
            self._fail(error)
            return None

    def wanted(self) -> Velocity | None:
        """Return what navigation wants now whose velocities pass through the agent; None when there
        is none, or nothing runs.
        """
        if not self.up or self._velocities is None:
            return None
        try:
            with its_fault():
                wanted = self._velocities.wanted()
                return None if wanted is None else sound_velocity(wanted)
        except AdapterError as error:
            self._fail(error)
            return ZERO

    def set_lock(self, *, locked: bool) -> None:
        """Set the base's own lock, where it has one, at each change and after each connection."""
        adapter = self.adapter
        if self.up and isinstance(adapter, WithLock) and locked != self._is_locked:
            self._is_locked = locked
            self._tell(lambda value: adapter.set_lock(locked=value), locked)

    def limit_speed(self, linear: float) -> None:
        """Tell the RCA's navigation the largest speed, where it can be told."""
        if self.up and isinstance(self.adapter, LimitsSpeed) and linear != self._speed_limit:
            self._speed_limit = linear
            self._tell(self.adapter.limit_speed, linear)

    def located(self, reading: RcaState, points: Floats) -> RcaState:
        """Return a reading with what the agent's own navigation makes of it, and of the points (n,
        2) that stand about the robot.
        """
        if self._navigation is None:
            return reading
        try:
            with its_fault():
                return sound(self._navigation.located(reading, points))
        except (AdapterError, UnsoundReadingError) as error:
            self._fail(AdapterError(str(error)))
            return reading

    @property
    def dock(self) -> Station | None:
        """The dock that the agent's own navigation takes for this robot's, on its map."""
        return self._navigation.dock if self._navigation else None

    def take_floorplan(self, update: FloorPlanUpdate) -> None:
        """Give the server's map to an adapter that can use it."""
        if self._navigation:
            self._tell(self._navigation.take_floorplan, update)

    def configure(self, config: Config) -> None:
        """Tell the adapter what the server has configured."""
        if self.up:
            self._tell(self.adapter.configure, config)

    async def start(self, action: Action, is_wanted: Callable[[], bool] = lambda: True) -> None:
        """Begin an action that still `is_wanted` after the end of all that is being cancelled: not
        every RCA can tell the two apart.

        Raises:
            ActionRefusedError: the RCA has certainly not taken it.
            AdapterError: the RCA did not confirm it.
        """
        if not self.up:
            raise ActionRefusedError("the robot control architecture is not connected")
        try:
            async with asyncio.timeout(START_TIME):
                while self._cancelling:  # OwnedActions takes how these end
                    await asyncio.wait(self._cancelling)
                if not is_wanted():
                    raise ActionRefusedError("cancelled")
                with its_fault():
                    await self.adapter.start(action)
        except TimeoutError as error:
            raise AdapterError("no answer") from error

    async def cancel(self, action_id: str) -> bool:
        """Cancel an action; return whether the RCA has confirmed that it does not run.

        Raises:
            AdapterError: it could not be cancelled.
        """
        if not self.up:
            return False
        cancelling = asyncio.ensure_future(self._cancel(action_id))
        self._cancelling.add(cancelling)
        cancelling.add_done_callback(self._cancelling.discard)
        return await cancelling

    async def close(self) -> None:
        """Leave the robot standing and let go of it."""
        self.up = False
        with contextlib.suppress(AdapterError, TimeoutError):
            async with asyncio.timeout(CLOSE_TIME):
                with its_fault():
                    await self.adapter.close()

    # --- inside -----------------------------------------------------------------------------------

    async def _listen(self, listener: AdapterListener) -> None:
        """Hand on readings and progress until one of them ends or the base refuses a velocity.

        Raises:
            AdapterError: why it ended.
        """
        self._failure = asyncio.get_running_loop().create_future()
        await until_one_ends(self._states(listener), self._progress(listener), self._failure)

    async def _cancel(self, action_id: str) -> bool:
        try:
            async with asyncio.timeout(CANCEL_TIME):
                with its_fault():
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
        states = told_by(self.adapter.states)
        silent = asyncio.timeout(FIRST_READING)
        complaint = "it is silent"
        now = asyncio.get_running_loop().time
        try:
            async with silent:
                async for reading in states:
                    try:
                        checked = sound(reading)
                    except UnsoundReadingError as error:
                        # Only a sound reading postpones the time-out: nonsense is no better than
                        # silence.
                        complaint = f"it reports nonsense: {error}"
                        silent.reschedule(min(silent.when() or now(), now() + SILENCE))
                        continue
                    silent.reschedule(now() + SILENCE)
                    self._came_up(listener)
                    with its_fault():  # what nobody could make anything of
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
        async for progress in told_by(self.adapter.progress):
            with its_fault():
                listener.progressed(sound_progress(progress))
        # an adapter without actions has no more to say, and is not lost for that
        await asyncio.Future()

    def _tell(self, call: Callable[[Told], None], told: Told) -> None:
        try:
            with its_fault():
                call(told)
        except AdapterError as error:
            self._fail(error)

    def _fail(self, error: AdapterError) -> None:
        if self._failure is not None and not self._failure.done():
            self._failure.set_exception(error)


@contextlib.contextmanager
def its_fault() -> Iterator[None]:
    """Turn whatever an adapter raises into an AdapterError; a time-out of ours comes as a
    cancellation, which passes.

    Raises:
        AdapterError: the adapter's own, or one that names what it raised.
    """
    try:
        yield
    except AdapterError:
        raise
    except Exception as error:
        log.exception("adapter_raised")
        raise AdapterError(f"{type(error).__name__}: {error}") from error


async def told_by(source: Callable[[], AsyncIterator[Told]]) -> AsyncIterator[Told]:
    """Yield what an adapter yields.

    Raises:
        AdapterError: the adapter's own, or one that names what it raised.
    """
    with its_fault():
        async for each in source():
            yield each
