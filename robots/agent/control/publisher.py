"""Everything that a robot sends: to the broker, and to pages over their data channels."""

from collections.abc import Callable
from typing import Any, Protocol

from robots.agent.broker_link.mqtt import LinkInbox
from robots.agent.robot_interface import Frame
from robots.api import codec, picture, topics
from robots.api.messages import (
    CallState,
    CameraStatus,
    LabReport,
    Message,
    NetworkLab,
    PictureRequest,
    Pointer,
    Signal,
)


class AgentLink(Protocol):
    """The connection to the broker (mqtt.MqttLink), used on the control loop only."""

    connected: bool

    def publish(self, suffix: str, payload: bytes) -> None:
        """Send, or keep what must not be lost."""

    async def run(self, inbox: LinkInbox) -> None:
        """Stay connected until `close()`."""

    def close(self) -> None:
        """Say goodbye; `run` returns."""


class Media(Protocol):
    """The media side (media.MediaSide), thread-safe. `ended`: its loop has stopped."""

    ended: bool

    def start(self) -> None: ...

    def close(self) -> None:
        """Close every connection."""

    def signal(self, peer: str, message: Signal) -> None:
        """Take a page's offer, candidate or bye, or the server's permission to stay."""

    def lease_changed(self, driver_peer: str | None) -> None:
        """Take the peer that the lease names, None without a driver."""

    def let_through(self, *, audio: bool, video: bool, volume: float) -> None:
        """Let the driver's voice and video through to the people at the robot, or not; `volume` is
        a share.
        """

    def impair(self, lab: NetworkLab | None) -> None:
        """Emulate this network for the driver's video and sound, None for none."""

    def telemetry(self, suffix: str, message: Message) -> None:
        """Send a message to every connected page."""

    def point(self, pointer: Pointer) -> None:
        """Send where one side points to the connected pages of the other."""

    def picture_wanted(self, request: PictureRequest) -> None:
        """Send one more image through the server."""

    def snapshot(self) -> Frame | None:
        """Return a fresh frame of the camera; may block."""

    @property
    def connected(self) -> int:
        """Number of connected pages."""

    @property
    def screens(self) -> int:
        """Number of the robot's own displays that are connected."""

    def confirm(self, call: CallState | None) -> CallState | None:
        """Return the call with what the people at the robot get of it now."""

    @property
    def audible(self) -> bool:
        """Whether a knock rings: a display is connected, or there is a loudspeaker."""

    def ring(self) -> None:
        """Ring with the robot's loudspeaker unless a connected display rings."""

    @property
    def camera_status(self) -> CameraStatus | None:
        """State of the camera while it is wanted and gives no video."""

    @property
    def errors(self) -> tuple[str, ...]:
        """Why camera, microphone, loudspeaker and display do not work."""

    @property
    def network(self) -> LabReport | None:
        """The network emulated for the driver's video and sound."""


# of their moment: the broker gets none of them from an idle robot
OF_THE_MOMENT = frozenset({"heartbeat", "pose", "path", "scan"})


class Publisher:
    """Sends each message on all transports of its topic. While the robot is not needed, the broker
    gets no messages of the moment.
    """

    def __init__(
        self, link: AgentLink, media: Media, is_needed: Callable[[], bool] = lambda: True
    ) -> None:
        self._link, self._media, self._is_needed = link, media, is_needed

    def send(self, suffix: str, message: Any) -> None:
        if suffix not in OF_THE_MOMENT or self._is_needed():
            self._link.publish(suffix, codec.encode(message))
        if suffix in topics.TO_PAGE:
            self._media.telemetry(suffix, message)

    def point(self, pointer: Pointer) -> None:
        """Send where one side points to the server and to the other side's connected pages."""
        self._link.publish("pointer", codec.encode(pointer))
        self._media.point(pointer)

    def record(self, suffix: str, payload: bytes) -> None:
        """Send what only the broker takes: a repeated state, a photo."""
        self._link.publish(suffix, payload)

    def picture(self, payload: bytes, peer: str | None) -> None:
        """Send an image for pages that WebRTC does not reach, or for the page of one peer."""
        self._link.publish(picture.suffix_for(peer), payload)
