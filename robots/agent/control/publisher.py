"""Every way out of a robot: records and presence to the broker, and what a page shows to the data
channels as well.
"""

from collections.abc import Callable
from typing import Any, Protocol

from robots.agent.broker_link.mqtt import LinkInbox
from robots.agent.robot_interface import Frame
from robots.api import codec, picture, topics
from robots.api.messages import (
    CameraStatus,
    LabReport,
    Message,
    NetworkLab,
    PictureRequest,
    Pointer,
    Signal,
)


class AgentLink(Protocol):
    """The way to the broker (mqtt.MqttLink); all of it on the control loop."""

    connected: bool

    def publish(self, suffix: str, payload: bytes) -> None:
        """Send, or keep what must not be lost."""

    async def run(self, inbox: LinkInbox) -> None:
        """Stay connected until `close()`."""

    def close(self) -> None:
        """Say goodbye; `run` returns."""


class Media(Protocol):
    """The media side (media.MediaSide); all of it thread-safe. `ended`: its loop runs no more."""

    ended: bool

    def start(self) -> None:
        """Begin to take signals."""

    def close(self) -> None:
        """Hang up on everybody."""

    def signal(self, peer: str, message: Signal) -> None:
        """Take an offer, candidate or bye of a page, or the server's word that it may stay."""

    def lease_changed(self, driver_peer: str | None) -> None:
        """The lease names this peer now, or nobody."""

    def let_through(self, *, audio: bool, video: bool, volume: float) -> None:
        """Let the driver's voice and face through to the people at the robot from now on, or not;
        `volume` is a share.
        """

    def impair(self, lab: NetworkLab | None) -> None:
        """Put this on the driver's picture and sound from now on, or nothing."""

    def telemetry(self, suffix: str, message: Message) -> None:
        """Send a message to every page that is connected."""

    def point(self, pointer: Pointer) -> None:
        """Send where one side points to the pages of the other that are connected."""

    def picture_wanted(self, request: PictureRequest) -> None:
        """Send one more picture through the server."""

    def snapshot(self) -> Frame | None:
        """Return a fresh frame of the camera; may block."""

    @property
    def connected(self) -> int:
        """How many pages are connected."""

    @property
    def screens(self) -> int:
        """How many of the robot's own displays are connected."""

    @property
    def audible(self) -> bool:
        """Whether somebody at the robot may hear a knock: a display is connected, or the robot has
        a loudspeaker.
        """

    def ring(self) -> None:
        """Ring with the robot's own loudspeaker, if no display is connected that does."""

    @property
    def camera_status(self) -> CameraStatus | None:
        """How the camera is while it is wanted and gives no video."""

    @property
    def errors(self) -> tuple[str, ...]:
        """Why camera, microphone, loudspeaker and display do not work."""

    @property
    def network(self) -> LabReport | None:
        """What is put on the driver's picture and sound."""


# of their moment: the broker gets none of them from an idle robot
OF_THE_MOMENT = frozenset({"heartbeat", "pose", "path", "scan"})


class Publisher:
    """Sends a message on all the ways that its topic travels on.

    Args:
        link: the broker.
        media: the pages.
        is_needed: whether somebody needs the robot; what is of its moment goes to the broker only
            then.
    """

    def __init__(
        self, link: AgentLink, media: Media, is_needed: Callable[[], bool] = lambda: True
    ) -> None:
        self._link, self._media, self._is_needed = link, media, is_needed

    def send(self, suffix: str, message: Any) -> None:
        """Send a message of the robot."""
        if suffix not in OF_THE_MOMENT or self._is_needed():
            self._link.publish(suffix, codec.encode(message))
        if suffix in topics.TO_PAGE:
            self._media.telemetry(suffix, message)

    def point(self, pointer: Pointer) -> None:
        """Send where one side points to the other: to the server, which knows who that is, and to
        its pages that are connected.
        """
        self._link.publish("pointer", codec.encode(pointer))
        self._media.point(pointer)

    def record(self, suffix: str, payload: bytes) -> None:
        """Send what only the broker takes: a state said again, a photo."""
        self._link.publish(suffix, payload)

    def picture(self, payload: bytes, peer: str | None) -> None:
        """Send a picture for the pages that WebRTC does not reach, or for the page of one peer."""
        self._link.publish(picture.suffix_for(peer), payload)
