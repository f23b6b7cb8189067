"""The robot's connection to Janus, which to the robot is one more page that watches."""

import secrets
import time
from collections.abc import Callable
from typing import Protocol

import structlog

from robots.api.messages import Bye, Message, SdpAnswer, SdpOffer, Stay
from robots.ice import ice_servers
from sessions.protocol import SIGNAL
from sessions.sfu import janus
from sessions.sfu.mountpoint import plain_offer

log = structlog.stdlib.get_logger(__name__)

NOSIP = "nosip"
CONNECT_SECONDS = 10.0  # from the offer
STAY_SECONDS = 60.0  # the robot ends who was not vouched for in 150 s


class SendingBridge(Protocol):
    """What of robots.bridge.bridge.Bridge is used here."""

    def send(self, robot: str, suffix: str, message: Message) -> bool:
        """Publish a message to a robot; False when it cannot be."""


class RobotLeg:
    """One connection, from Janus' offer to its end; what follows it is another one. `boot` is the
    run of the robot's agent, empty while that is unknown.

    `ended` is why it has, None while it has not; `on_change` is called when it is up, or has ended.
    """

    def __init__(
        self, robot: str, boot: str, bridge: SendingBridge, on_change: Callable[[], None]
    ) -> None:
        self.peer = secrets.token_urlsafe(12)
        self.is_up = False
        self.ended: str | None = None
        self._robot, self._boot = robot, boot
        self._bridge, self._on_change = bridge, on_change
        self._handle: janus.Handle | None = None
        self._began = time.monotonic()
        self._vouched = (0, self._began)  # for how many viewers, and when

    async def begin(self, session: janus.JanusSession, first_port: int) -> None:
        """Have Janus make an offer, and send it to the robot.

        Raises:
            JanusError, JanusLostError: there is none.
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
        """Return the robot's suffix for what this peer says."""
        return f"{SIGNAL}/{self.peer}"

    async def take_reply(self, reply: Message) -> None:
        """Take what the robot answers.

        Raises:
            JanusError, JanusLostError: Janus does not take it.
        """
        match reply:
            case SdpAnswer(sdp=sdp) if self._handle is not None:
                await self._handle.ask({"request": "generate"}, kind="answer", sdp=sdp)
            case Bye(reason=reason):
                self.ended = reason or "left"

    def is_lost(self, boot: str, now: float) -> bool:
        """Tell whether another one is needed, now that the robot's agent is in its run `boot`;
        `now` is monotonic.
        """
        # Janus does not notice the end of a robot that could not say goodbye.
        if self._boot and boot != self._boot:
            self.ended = self.ended or "robot_restarted"
        self._boot = boot
        if not self.is_up and self.ended is None and now - self._began > CONNECT_SECONDS:
            self.ended = "no_connection"
        return self.ended is not None

    def vouch(self, viewers: int, now: float) -> None:
        """Tell the robot that this peer may stay, and how many watch through it, if that is news or
        due.
        """
        told, at = self._vouched
        if self.is_up and (viewers != told or now - at > STAY_SECONDS):
            self._vouched = viewers, now
            self._bridge.send(self._robot, self.suffix, Stay(viewers=viewers))

    async def end(self) -> None:
        """Say goodbye on both sides."""
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
