"""The pages that are connected over WebRTC: which get a place, whose offers are answered, their
roles, and why a connection ended.

Belongs to the media loop, except for the first section.
"""

import asyncio
import itertools
import time
from collections.abc import Callable, Coroutine
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

# s in which a page that flooded is refused: connecting costs more than its messages do
FLOOD_PAUSE = 5.0
LAYER_KNOWN = 60.0  # s for which the layer of an ended connection is known
Side = Literal["driver", "screen"]
MakeViewer = Callable[[str, Role, str, Callable[[str], None]], Viewer]


class Connections:
    """Every page's connection, by its peer id.

    Args:
        places: how many pages may be connected at once; the driver always finds room.
        make_viewer: makes the connection of (peer, role), with a name for it and a callback for
            when it fails by itself.
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
        # the layers of pages whose connection has ended, and when
        self._last_layers: dict[str, tuple[int, float]] = {}
        self._flooded: dict[str, float] = {}  # until when pages are refused that have flooded
        self._tasks: set[asyncio.Task[None]] = set()
        self._closing = False
        self.newest_screen = ""  # the name of the robot's own display that connected last

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
        return sum(self._passed_on.get(peer, 1) for peer in self.connected() | others)

    @property
    def screens(self) -> int:
        return len(self._connected_screens())

    @property
    def shows(self) -> bool:
        """Return whether one of the robot's own displays shows the visitor's video."""
        return any(screen.shows for screen in self._connected_screens())

    @property
    def plays(self) -> bool:
        """Return whether one of the robot's own displays may play sound."""
        return any(screen.plays for screen in self._connected_screens())

    def _connected_screens(self) -> list[Viewer]:
        return [
            viewer
            for peer, viewer in list(self._viewers.items())
            if peer in self._screens and viewer.page.is_connected
        ]

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
        if self._closing:  # a page may offer again as soon as it gets the Bye
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
        self._continue(peer, old, viewer, now)
        self._viewers[peer] = viewer
        if is_screen:
            self.newest_screen = source
        self._changed()
        (self._screens.add if is_screen else self._screens.discard)(peer)
        (self._wizards.add if offer.role == "wizard" else self._wizards.discard)(peer)
        self._keep(self._answer(peer, viewer, offer)).add_done_callback(
            lambda task: self._answered(task, peer, viewer)
        )

    def _continue(self, peer: str, old: Viewer | None, viewer: Viewer, now: float) -> None:
        """Give a connection the limits of the one that it replaces, and the layer of the last one:
        a narrow network, on which that was lost, does not carry the best layer.
        """
        if old is not None:
            viewer.page.gate = old.page.gate
            self._note_layer(peer, old, now)
            self._keep(old.close())
        if peer in self._last_layers:
            viewer.resume(self._last_layers.pop(peer)[0])

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
        """Reply to an offer that could not be answered because of an unexpected error."""
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
        """End all connections, and refuse new ones."""
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
        """Close a page's connection and send it the reason, None when the page left by itself."""
        viewer = self._viewers.pop(peer)
        self._note_layer(peer, viewer, time.monotonic())
        self._screens.discard(peer)
        self._wizards.discard(peer)
        self._passed_on.pop(peer, None)
        self._registry.leave(peer)
        log.info("peer_ended", peer=peer, reason=reason or "bye", **viewer.statistics())
        if reason is not None:
            self._reply(peer, Bye(reason=reason))
        self._keep(viewer.close())

    def _note_layer(self, peer: str, viewer: Viewer, now: float) -> None:
        self._last_layers[peer] = viewer.layer, now
        for other, (_, at) in list(self._last_layers.items()):
            if now - at > LAYER_KNOWN:
                del self._last_layers[other]

    def _keep(self, work: Coroutine[Any, Any, None]) -> "asyncio.Task[None]":
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._done)
        return task

    def _done(self, task: "asyncio.Task[None]") -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("media_task_failed", exc_info=error)

    # --- messages and media -----------------------------------------------------------------------

    def send(self, suffix: str, frame: str) -> None:
        """Send a frame to all pages except hidden operators: states reveal a study's condition."""
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

    def point(self, by: Side, frame: str) -> None:
        """Send a pointer of one side to the other."""
        for viewer in self._at("screen" if by == "driver" else "driver"):
            viewer.send("pointer", frame)

    def route(self, line: TimedLine | None) -> None:
        """Send the driver's media over the line, and all others directly."""
        for peer, viewer in self._viewers.items():
            viewer.route(line if self.drives(peer) else None)

    def show(self, picture: Picture) -> None:
        """Send the robot's picture to all pages except its own displays."""
        for peer, viewer in self._viewers.items():
            if peer not in self._screens:
                viewer.show(picture)

    def sound(self, payload: bytes, ticks: int, narrow: bool | None = None) -> None:
        """Send the robot's sound to the pages for whose networks it is, None for all, but not to
        its own displays.
        """
        for peer, viewer in self._viewers.items():
            if peer not in self._screens:
                viewer.sound(payload, ticks, narrow)

    def show_at_robot(self, picture: Picture) -> None:
        """Send the visitor's picture to the robot's own displays."""
        for viewer in self._at("screen"):
            viewer.show(picture)

    def sound_at_robot(self, payload: bytes, ticks: int) -> None:
        """Send the visitor's voice to the robot's own displays."""
        for viewer in self._at("screen"):
            viewer.sound(payload, ticks)

    def ask_key_frame(self, side: Side) -> None:
        for viewer in self._at(side):
            self._keep(viewer.page.ask_key_frame())

    def _at(self, side: Side) -> list[Viewer]:
        """Return the driver's connection, or those of the robot's own displays."""
        return [
            viewer
            for peer, viewer in self._viewers.items()
            if (peer in self._screens if side == "screen" else self.drives(peer))
        ]
