"""The robot's connection to Janus, which the robot treats as one more page that watches."""

import secrets
import time
from collections.abc import Callable

import structlog

from robots.api.messages import Bye, Message, SdpAnswer, SdpOffer, Stay
from robots.bridge.bridge import Bridge
from robots.ice import ice_servers
from sessions.protocol import SIGNAL
from sessions.sfu import janus
from sessions.sfu.mountpoint import plain_offer

log = structlog.stdlib.get_logger(__name__)

NOSIP = "nosip"
CONNECT_SECONDS = 10.0  # from the offer
STAY_SECONDS = 60.0  # the robot ends a connection without a Stay for 150 s


class RobotLeg:
    """One connection, from Janus' offer to its end. `boot` is the run of the robot's agent, empty
    while unknown. `ended` is the reason of the end, None before; `on_change` is called when the
    connection is up, or has ended.
    """

    def __init__(
        self, robot: str, boot: str, bridge: Bridge, on_change: Callable[[], None]
    ) -> None:
        self.peer = secrets.token_urlsafe(12)
        self.is_up = False
        self.ended: str | None = None
        self._robot, self._boot = robot, boot
        self._bridge, self._on_change = bridge, on_change
        self._handle: janus.Handle | None = None
        self._began = time.monotonic()
        self._vouched = (0, self._began)  # the viewers in the last Stay, and its time

    async def begin(self, session: janus.JanusSession, first_port: int) -> None:
        """Have Janus make an offer, and send it to the robot.

        Raises:
            JanusError, JanusLostError: Janus makes none.
        """
        self._handle = await session.attach(NOSIP, self._take_event)
        offer = await self._handle.ask(
            {"request": "process", "type": "offer", "sdp": plain_offer(first_port)}
        )
        servers = ice_servers(self._robot, time.time())
        message = SdpOffer(sdp=offer.sdp or "", role="observer", ice_servers=servers)
        if not self._bridge.send(self._robot, self.suffix, message):
            self.ended = "robot_unreachable"

    @property
    def suffix(self) -> str:
        """Return the suffix of this peer's messages to the robot."""
        return f"{SIGNAL}/{self.peer}"

    async def take_reply(self, reply: Message) -> None:
        """Handle an answer of the robot.

        Raises:
            JanusError, JanusLostError: Janus does not take it.
        """
        match reply:
            case SdpAnswer(sdp=sdp) if self._handle is not None:
                await self._handle.ask({"request": "generate"}, kind="answer", sdp=sdp)
            case Bye(reason=reason):
                self.ended = reason or "left"

    def is_lost(self, boot: str, now: float) -> bool:
        """Tell whether a new connection is needed, with the agent in run `boot`; `now` in s."""
        # Janus does not notice the end of a robot that could not say goodbye.
        if self._boot and boot != self._boot:
            self.ended = self.ended or "robot_restarted"
        self._boot = boot
        if not self.is_up and self.ended is None and now - self._began > CONNECT_SECONDS:
            self.ended = "no_connection"
        return self.ended is not None

    def vouch(self, viewers: int, now: float) -> None:
        """Send a Stay with the number of viewers, if that has changed or the Stay is due."""
        sent, at = self._vouched
        if self.is_up and (viewers != sent or now - at > STAY_SECONDS):
            self._vouched = viewers, now
            self._bridge.send(self._robot, self.suffix, Stay(viewers=viewers))

    async def end(self) -> None:
        """End the connection on both sides."""
        self._bridge.send(self._robot, self.suffix, Bye(reason="left"))
        if self._handle is not None:
            await self._handle.detach()

    def _take_event(self, kind: str, reason: str) -> None:
        if kind == janus.UP:
            self.is_up = True
            log.info("sfu_robot_connected", robot=self._robot)
        else:
            self.ended = self.ended or reason or kind
        self._on_change()
