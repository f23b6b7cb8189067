"""The pages that are connected over WebRTC: which get a place, whose offers are answered, who is
who, and why a connection ended.

Belongs to the media loop, but for what says otherwise.
"""

import asyncio
import itertools
import time
from collections.abc import Callable, Coroutine, Iterator
from typing import Any, Literal

import msgspec
import structlog

from robots.agent.lab.timed import TimedLine
from robots.agent.media.codecs.encoder import Picture
from robots.agent.media.peers.registry import HeldCandidates, OfferLimits, PeerRegistry
from robots.agent.media.peers.viewer import Viewer
from robots.agent.media.webrtc.sdp import BadOfferError
from robots.api.codec import encode_frame
from robots.api.messages import (
    Bye,
    Candidate,
    Heartbeat,
    Role,
    SdpAnswer,
    SdpOffer,
    Signal,
    SignalReply,
    Stay,
)

log = structlog.stdlib.get_logger(__name__)

# s; to connect costs the robot more than what the page may say until it is sent away
FLOOD_PAUSE = 5.0
MakeViewer = Callable[[str, Role, str, Callable[[str], None]], Viewer]


class Connections:
    """Every page's connection, by its peer id.

    Args:
        places: how many pages may be connected at once; the driver always finds room.
        make_viewer: makes the connection of (peer, role), with a name for this connection of theirs
            and what to call when it fails by itself.
        reply: called with (peer, message) for the page.
        changed: called after a new page, which may be the driver's.
    """

    def __init__(
        self,
        places: int,
        make_viewer: MakeViewer,
        reply: Callable[[str, SignalReply], None],
        changed: Callable[[], None],
    ) -> None:
        self._make_viewer, self._reply, self._changed = make_viewer, reply, changed
        self._registry = PeerRegistry(places)
        self._held, self._offers = HeldCandidates(), OfferLimits()
        self._count = itertools.count()
        self._viewers: dict[str, Viewer] = {}
        self._screens: set[str] = set()
        # hidden operators: the server alone sends them states, and they do not count as viewers
        self._wizards: set[str] = set()
        self._passed_on: dict[str, int] = {}  # of an SFU: how many watch through it
        self._flooded: dict[str, float] = {}  # pages that were sent away for it: refused until
        self._tasks: set[asyncio.Task[None]] = set()
        self._closing = False
        # the name of the connection of the robot's own display that came last
        self.newest_screen = ""

    # --- any thread -------------------------------------------------------------------------------

    def lease_changed(self, driver_peer: str | None) -> None:
        """Note which peer the lease names, the only driver; None without a driver."""
        self._registry.lease_changed(driver_peer, time.monotonic())

    def role(self, peer: str) -> Role:
        return self._registry.role(peer)

    def drives(self, peer: str) -> bool:
        return self.role(peer) == "driver"

    @property
    def is_empty(self) -> bool:
        return not self._viewers

    def connected(self) -> frozenset[str]:
        """Return the pages that are connected, displays and hidden operators left out."""
        return frozenset(
            peer
            for peer, viewer in list(self._viewers.items())
            if viewer.page.is_connected and peer not in self._screens | self._wizards
        )

    def viewers(self, others: frozenset[str] = frozenset()) -> int:
        """Return how many people watch: over these connections, and `others`."""
        passed_on = self._passed_on
        return sum(passed_on.get(peer, 1) for peer in self.connected() | others)

    @property
    def screens(self) -> int:
        return sum(
            viewer.page.is_connected
            for peer, viewer in list(self._viewers.items())
            if peer in self._screens
        )

    def statistics(self) -> dict[str, dict[str, int | None]]:
        return {peer: viewer.statistics() for peer, viewer in list(self._viewers.items())}

    # --- signalling -------------------------------------------------------------------------------

    def take_signal(self, peer: str, message: Signal) -> None:
        """Take an offer, candidate or bye of a page, or the server's word that it may stay."""
        if isinstance(message, SdpOffer):
            self._take_offer(peer, message)
        elif isinstance(message, Stay):
            self._registry.vouch(peer, time.monotonic())
            if peer in self._viewers:
                self._passed_on[peer] = message.viewers
        elif isinstance(message, Candidate):
            viewer = self._viewers.get(peer)
            if viewer is None or not viewer.takes_candidates:
                self._held.hold(peer, message)
            else:
                viewer.page.add_candidate(message)
        elif peer in self._viewers:
            self._end(peer, None)

    def _take_offer(self, peer: str, offer: SdpOffer) -> None:
        # a page may ask again as soon as it hears goodbye, and would be answered by a robot that is
        # gone
        if self._closing:
            self._reply(peer, Bye(reason="left"))
            return
        now = time.monotonic()
        if self._flooded.get(peer, 0.0) > now or not self._offers.allow(
            peer, now, drives=self.drives(peer)
        ):
            self._reply(peer, Bye(reason="flooded"))
            return
        admission = self._registry.admit(peer, offer.role, now)
        if admission.leaves is not None:
            self._end(admission.leaves, "full")
        if not admission.admitted:
            log.info("peer_refused", peer=peer, role=offer.role, reason="full")
            self._reply(peer, Bye(reason="full"))
            return
        old = self._viewers.pop(peer, None)
        is_screen, source = offer.role == "screen", f"{peer} {next(self._count)}"
        viewer = self._make_viewer(
            peer, offer.role, source, lambda reason: self._ended(peer, viewer, reason)
        )
        if old is not None:
            viewer.page.gate = old.page.gate  # or connecting again would be a way to say more
            self._keep(old.close())
        self._viewers[peer] = viewer
        if is_screen:
            self.newest_screen = source
        self._changed()
        (self._screens.add if is_screen else self._screens.discard)(peer)
        (self._wizards.add if offer.role == "wizard" else self._wizards.discard)(peer)
        self._keep(self._answer(peer, viewer, offer)).add_done_callback(
            lambda task: self._answered(task, peer, viewer)
        )

    async def _answer(self, peer: str, viewer: Viewer, offer: SdpOffer) -> None:
        began = time.monotonic()
        try:
            answer = await viewer.answer(offer)
        except BadOfferError as error:
            if self._viewers.get(peer) is viewer:
                log.warning("offer_unusable", peer=peer, reason=str(error))
            self._ended(peer, viewer)
            return
        if self._viewers.get(peer) is not viewer:
            return  # replaced, or gone, while candidates were gathered
        for candidate in self._held.release(peer):
            viewer.page.add_candidate(candidate)
        log.info(
            "offer_answered", peer=peer, role=offer.role, seconds=round(time.monotonic() - began, 3)
        )
        self._reply(peer, SdpAnswer(sdp=answer))

    def _answered(self, task: "asyncio.Task[None]", peer: str, viewer: Viewer) -> None:
        """Let no offer stay without a reply, whatever went wrong with it."""
        if not task.cancelled() and task.exception() is not None:
            self._ended(peer, viewer)

    # --- ends -------------------------------------------------------------------------------------

    def end_lost(self, now: float) -> None:
        """End connections that are silent or not allowed to stay; `now` is monotonic."""
        for peer, viewer in list(self._viewers.items()):
            if viewer.page.is_lost(now):
                self._end(peer, "failed")
        for peer, reason in self._registry.unwelcome(now).items():
            if peer in self._viewers:
                self._end(peer, reason)

    async def close(self) -> None:
        """Say goodbye to every page, and to every one that asks from now on."""
        self._closing = True
        for peer in list(self._viewers):
            self._end(peer, "left")
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _ended(self, peer: str, viewer: Viewer, reason: str = "failed") -> None:
        """End a connection that failed or floods, unless a newer one has replaced it."""
        if self._viewers.get(peer) is not viewer:
            return
        if reason == "flooded":
            now = time.monotonic()
            self._flooded = {
                other: until for other, until in self._flooded.items() if until > now
            } | {peer: now + FLOOD_PAUSE}
        self._end(peer, reason)

    def _end(self, peer: str, reason: str | None) -> None:
        """Close a page's connection and tell it why, or nothing when it said goodbye itself."""
        viewer = self._viewers.pop(peer)
        self._screens.discard(peer)
        self._wizards.discard(peer)
        self._passed_on.pop(peer, None)
        self._registry.leave(peer)
        log.info("peer_ended", peer=peer, reason=reason or "bye", **viewer.statistics())
        if reason is not None:
            self._reply(peer, Bye(reason=reason))
        self._keep(viewer.close())

    def _keep(self, work: Coroutine[Any, Any, None]) -> "asyncio.Task[None]":
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._done)
        return task

    def _done(self, task: "asyncio.Task[None]") -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("media_task_failed", exc_info=error)

    # --- what they are sent -----------------------------------------------------------------------

    def send(self, suffix: str, frame: str) -> None:
        """Send a frame to all pages but hidden operators: a state reveals a study's condition."""
        for peer, viewer in self._viewers.items():
            if peer not in self._wizards:
                viewer.send(suffix, frame)

    def send_heartbeat(self, suffix: str, heartbeat: Heartbeat) -> None:
        """Send each page its own echoes alone: a peer id is a secret of page, server and robot."""
        for peer, viewer in self._viewers.items():
            own = tuple(echo for echo in heartbeat.echoes if echo.peer == peer)
            viewer.send(
                suffix, encode_frame(suffix, msgspec.structs.replace(heartbeat, echoes=own))
            )

    def point(self, by: Literal["driver", "screen"], frame: str) -> None:
        """Send a frame of one side to the other: the robot's own displays, or the driver."""
        for peer, viewer in self._viewers.items():
            if (peer in self._screens) if by == "driver" else self.drives(peer):
                viewer.send("pointer", frame)

    def lead(self, line: TimedLine | None) -> None:
        """Send the driver's media over the line, and everybody else's directly."""
        for peer, viewer in self._viewers.items():
            viewer.send_by(line if self.drives(peer) else None)

    def show(self, picture: Picture) -> None:
        """Show the robot's picture to all but its own displays."""
        for viewer in self._pages():
            viewer.show(picture)

    def sound(self, payload: bytes, ticks: int) -> None:
        """Let all but its own displays hear the robot."""
        for viewer in self._pages():
            viewer.sound(payload, ticks)

    def show_at_robot(self, picture: Picture) -> None:
        """Show the visitor's picture on the robot's own displays."""
        for peer in self._screens:
            self._viewers[peer].show(picture)

    def sound_at_robot(self, payload: bytes, ticks: int) -> None:
        """Let the robot's own displays sound the visitor's voice."""
        for peer in self._screens:
            self._viewers[peer].sound(payload, ticks)

    def ask_driver(self) -> None:
        """Ask the driver's page for a whole picture of its visitor."""
        for peer, viewer in self._viewers.items():
            if self.drives(peer):
                self._keep(viewer.page.ask_key_frame())

    def ask_screens(self) -> None:
        for peer in self._screens:
            self._keep(self._viewers[peer].page.ask_key_frame())

    def _pages(self) -> Iterator[Viewer]:
        return (viewer for peer, viewer in self._viewers.items() if peer not in self._screens)
