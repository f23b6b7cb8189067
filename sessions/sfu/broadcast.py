"""One robot's stream for any number of pages, through Janus.

Every web process that has such pages has a `Broadcast` for their robot. One of them owns the
mountpoint: the process that created it renews its label every two seconds, connects the robot to
it, and destroys it when no page watches. When the label no longer changes, another process destroys
the mountpoint and creates a new one; only one process can succeed. `mountpoint.py` has the media.
"""

import asyncio
import contextlib
import functools
import random
import secrets
import time
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any

import structlog
from django.conf import settings

from robots.api.messages import Bye, Candidate, SdpAnswer, SdpOffer
from robots.bridge.bridge import Bridge
from robots.bridge.delivery import ReceivedMessage
from sessions.protocol import WantOffer
from sessions.sfu import janus
from sessions.sfu.mountpoint import (
    CANNOT_CREATE,
    MOUNTPOINT_EXISTS,
    NO_SUCH_MOUNTPOINT,
    Mountpoint,
    MountpointInfo,
    mountpoint_of,
    read_info,
    some_port,
)
from sessions.sfu.robot_leg import RobotLeg

log = structlog.stdlib.get_logger(__name__)

STREAMING = "streaming"
STEP_SECONDS = 2.0
PORTS_TRIED = 5  # at a time, for a mountpoint
RETRY_SECONDS = 2.0  # between two attempts to reach Janus, or the robot
LINGER_SECONDS = 10.0  # without a viewer: a page that reconnects need not wait for the robot
HEARTBEAT_TIMEOUT_S = 8.0  # without a new label, the owner of a mountpoint counts as dead
OFFERS_AT_ONCE = 32
SFU_LOST, FULL = "sfu_lost", "full"

ToSfu = WantOffer | SdpAnswer | Candidate | Bye
Send = Callable[[SdpOffer | Bye], None]


@dataclass(eq=False)
class SfuViewer:
    """A page that watches; `wants` while it waits for an offer."""

    send: Send
    wants: bool = False
    has_left: bool = False
    handle: janus.Handle | None = None


class Broadcast:
    """A robot's stream for the pages of this process; lives on its loop while a page watches.

    Args:
        mountpoint: where Janus has the robot's stream.
        open_session: connects to Janus, as `janus.open_session` does.
        on_over: called at the end; later pages need a new Broadcast.

    `fault` is why pages get no offer, empty while they do.
    """

    def __init__(
        self,
        robot: str,
        mountpoint: Mountpoint,
        bridge: Bridge,
        open_session: Callable[[], contextlib.AbstractAsyncContextManager[janus.JanusSession]],
        on_over: Callable[[], None],
    ) -> None:
        self._robot, self._mountpoint, self._bridge = robot, mountpoint, bridge
        self._open_session, self._on_over = open_session, on_over
        self._name = secrets.token_hex(8)  # begins our labels
        self._rng = random.Random(self._name)
        self._labels = 0
        self._seen = ("", 0.0)  # another owner's label, and since when it is unchanged
        self._viewers: dict[str, SfuViewer] = {}
        self._left_at = time.monotonic()  # when the last viewer left
        self._leg: RobotLeg | None = None
        self._next_leg_at = 0.0
        self.fault = ""
        self._wake = asyncio.Event()
        self._turns = asyncio.Semaphore(OFFERS_AT_ONCE)
        self._tasks: set[asyncio.Task[None]] = set()
        self._known = bridge.listen(robot, self)
        self._task = asyncio.ensure_future(self._run())
        self._task.add_done_callback(self._ended)

    # --- pages ------------------------------------------------------------------------------------

    def join(self, peer: str, send: Send) -> None:
        """Add a page, which requests an offer when it is ready for one."""
        self._viewers.setdefault(peer, SfuViewer(send))

    def take(self, peer: str, message: ToSfu) -> None:
        """Handle a signalling message of a page."""
        viewer = self._viewers.get(peer)
        if viewer is None:
            return
        match message:
            case WantOffer() if self.fault:
                viewer.send(Bye(reason=self.fault))
            case WantOffer():
                viewer.wants = True
                self._wake.set()
            case Bye():
                self._hang_up(viewer)
            case SdpAnswer() | Candidate() if viewer.handle is not None:
                self._launch(self._pass_on, viewer, viewer.handle, message)

    def leave(self, peer: str) -> None:
        """Remove a page."""
        viewer = self._viewers.pop(peer, None)
        if viewer is not None:
            viewer.has_left = True
            self._hang_up(viewer)
        if not self._viewers:
            self._left_at = time.monotonic()

    async def close(self) -> None:
        """End at once, even if pages watch."""
        self._task.cancel()
        await asyncio.wait([self._task])

    def handle_message(self, inbound: ReceivedMessage) -> None:
        """Handle a message of the robot."""
        leg = self._leg
        if leg is not None and inbound.suffix == f"{leg.suffix}/reply":
            self._launch(self._take_reply, leg, inbound.message)
        elif inbound.suffix == "connection":
            self._wake.set()

    # --- the connection to Janus ------------------------------------------------------------------

    async def _run(self) -> None:
        try:
            while True:
                try:
                    async with self._open_session() as session:
                        await self._serve(session)
                except (janus.JanusError, janus.JanusLostError) as error:
                    log.warning("sfu_lost", robot=self._robot, reason=str(error))
                    self._lose()
                    await asyncio.sleep(RETRY_SECONDS * (0.5 + self._rng.random()))
                if not self._viewers:
                    return
        finally:
            self._bridge.ignore(self._robot, self)
            for task in self._tasks:
                task.cancel()
            self._on_over()

    def _ended(self, task: asyncio.Task[None]) -> None:
        """Log an error of ours, and let the pages request offers of a new Broadcast."""
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("sfu_failed", robot=self._robot, exc_info=error)
            self._lose()

    def _lose(self) -> None:
        """Report to all pages that Janus is lost; until it is back, their requests are refused."""
        self.fault = SFU_LOST
        if self._leg is not None:
            self._bridge.send(self._robot, self._leg.suffix, Bye(reason="left"))
            self._leg = None
        for viewer in self._viewers.values():
            viewer.handle, viewer.wants = None, False
            viewer.send(Bye(reason=SFU_LOST))

    async def _serve(self, session: janus.JanusSession) -> None:
        control = await session.attach(STREAMING)
        log.info("sfu_connected", robot=self._robot)
        self.fault = ""
        lost = asyncio.ensure_future(session.closed.wait())
        try:
            while not await self._step(session, control, time.monotonic()):
                wake = asyncio.ensure_future(self._wake.wait())
                await asyncio.wait(
                    {lost, wake}, timeout=STEP_SECONDS, return_when=asyncio.FIRST_COMPLETED
                )
                wake.cancel()
                self._wake.clear()
                if lost.done():
                    raise janus.JanusLostError("the connection was closed")
        finally:
            lost.cancel()

    async def _step(self, session: janus.JanusSession, control: janus.Handle, now: float) -> bool:
        """Maintain the mountpoint; return whether it is not needed any more."""
        info = await self._read(control)
        if info is None:
            info = await self._make(control)
        if info is None:
            return False
        owned = info.label.startswith(self._name)
        alone = not self._viewers and now - self._left_at > LINGER_SECONDS
        if alone and (not owned or info.viewers == 0):
            await self._end_leg()
            if owned:
                await control.ask(self._mountpoint.destroy())
            return True
        if owned:
            self._labels += 1
            await control.ask(self._mountpoint.sign(self._label()))
            await self._keep_leg(session, info, now)
        else:
            await self._watch_owner(control, info, now)
        if not owned or (self._leg is not None and self._leg.is_up):
            self._offer_all(session)
        return False

    async def _read(self, control: janus.Handle) -> MountpointInfo | None:
        try:
            return read_info((await control.ask(self._mountpoint.info())).data)
        except janus.JanusError as error:
            if error.code != NO_SUCH_MOUNTPOINT:
                raise
            return None

    async def _make(self, control: janus.Handle) -> MountpointInfo | None:
        """Create the mountpoint; None when Janus cannot, and the next step is to try again."""
        for _ in range(PORTS_TRIED):
            try:
                request = self._mountpoint.create(some_port(self._rng), self._label())
                await control.ask(request)
            except janus.JanusError as error:
                if error.code == CANNOT_CREATE:
                    continue  # its ports may be taken
                if error.code != MOUNTPOINT_EXISTS:
                    raise
            return await self._read(control)  # also if another process was quicker
        log.warning("sfu_mountpoint_refused", robot=self._robot)
        return None

    def _label(self) -> str:
        return f"{self._name} {self._labels}"

    async def _watch_owner(self, control: janus.Handle, info: MountpointInfo, now: float) -> None:
        """Leave the mountpoint to its owner, and destroy it when the owner counts as dead."""
        await self._end_leg()
        label, since = self._seen
        if info.label != label:
            self._seen = info.label, now
        elif now - since > HEARTBEAT_TIMEOUT_S:
            log.warning("sfu_owner_gone", robot=self._robot)
            with contextlib.suppress(janus.JanusError):  # another process was quicker
                await control.ask(self._mountpoint.destroy())
            self._wake.set()

    # --- the robot's side -------------------------------------------------------------------------

    async def _keep_leg(
        self, session: janus.JanusSession, info: MountpointInfo, now: float
    ) -> None:
        if self._leg is not None and self._leg.is_lost(self._known.online_boot, now):
            log.warning("sfu_robot_lost", robot=self._robot, reason=self._leg.ended)
            if self._leg.ended == FULL and info.viewers == 0:
                self._turn_away(FULL)
            await self._end_leg()
        if self._leg is None and now >= self._next_leg_at and self._known.online is not False:
            self._next_leg_at = now + RETRY_SECONDS
            boot = self._known.online_boot
            self._leg = RobotLeg(self._robot, boot, self._bridge, self._wake.set)
            await self._leg.begin(session, info.first_port)
        elif self._leg is not None:
            self._leg.vouch(info.viewers, now)

    async def _take_reply(self, leg: RobotLeg, reply: Any) -> None:
        try:
            await leg.take_reply(reply)
        except janus.JanusError as error:
            leg.ended = str(error)
        self._wake.set()

    async def _end_leg(self) -> None:
        leg, self._leg = self._leg, None
        if leg is not None:
            await leg.end()

    def _turn_away(self, reason: str) -> None:
        for viewer in self._viewers.values():
            if viewer.wants:
                viewer.wants = False
                viewer.send(Bye(reason=reason))

    # --- the pages' side --------------------------------------------------------------------------

    def _offer_all(self, session: janus.JanusSession) -> None:
        for viewer in self._viewers.values():
            if viewer.wants:
                viewer.wants = False
                self._launch(self._offer, session, viewer)

    async def _offer(self, session: janus.JanusSession, viewer: SfuViewer) -> None:
        """Have Janus make an offer to a page, and end its earlier connection."""
        async with self._turns:
            self._hang_up(viewer)
            try:
                on_event = functools.partial(self._on_event, viewer)
                handle = await session.attach(STREAMING, on_event)
                if viewer.has_left:
                    await handle.detach()
                    return
                viewer.handle = handle
                offer = await handle.ask(self._mountpoint.watch())
            except janus.JanusError as error:
                log.warning("sfu_offer_refused", robot=self._robot, reason=str(error))
                self._hang_up(viewer)
                viewer.send(Bye(reason="failed"))
                return
            if viewer.handle is handle:
                viewer.send(SdpOffer(sdp=offer.sdp or ""))

    def _on_event(self, viewer: SfuViewer, kind: str, _reason: str) -> None:
        if kind != janus.UP and viewer.handle is not None:
            self._hang_up(viewer)
            viewer.send(Bye(reason="failed"))

    async def _pass_on(
        self, viewer: SfuViewer, handle: janus.Handle, message: SdpAnswer | Candidate
    ) -> None:
        try:
            if isinstance(message, SdpAnswer):
                await handle.ask({"request": "start"}, kind="answer", sdp=message.sdp)
            else:
                await handle.trickle(_candidate(message))
        except janus.JanusError as error:
            log.info("sfu_viewer_refused", robot=self._robot, reason=str(error))
            self._hang_up(viewer)
            viewer.send(Bye(reason="failed"))

    def _hang_up(self, viewer: SfuViewer) -> None:
        handle, viewer.handle = viewer.handle, None
        if handle is not None:
            self._launch(handle.detach)

    def _launch(self, work: Callable[..., Coroutine[Any, Any, None]], *values: Any) -> None:
        task = asyncio.ensure_future(_unless_lost(work, *values))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


async def _unless_lost(work: Callable[..., Coroutine[Any, Any, None]], *values: Any) -> None:
    # `_run` reports it to all pages
    with contextlib.suppress(janus.JanusLostError):
        await work(*values)


def _candidate(message: Candidate) -> dict[str, Any]:
    if not message.candidate:
        return {"completed": True}
    place = (
        {"sdpMid": message.sdp_mid}
        if message.sdp_mid is not None
        else {"sdpMLineIndex": message.sdp_m_line_index or 0}
    )
    return {"candidate": message.candidate, **place}


_broadcasts: dict[str, Broadcast] = {}  # of this process, by robot


def has_sfu() -> bool:
    """Tell whether this site has an SFU."""
    return bool(settings.JANUS_URL)


def broadcast_of(robot: str, bridge: Bridge) -> Broadcast:
    """Return the broadcast of a robot, started for its first page."""
    found = _broadcasts.get(robot)
    if found is None:
        found = _broadcasts[robot] = Broadcast(
            robot,
            mountpoint_of(settings.SECRET_KEY, robot),
            bridge,
            functools.partial(janus.open_session, settings.JANUS_URL, settings.JANUS_SECRET),
            functools.partial(_broadcasts.pop, robot, None),
        )
    return found
