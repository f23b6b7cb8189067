"""One robot's stream through Janus, as requests and session descriptions: pure.

The robot only answers offers, as it does with pages, and Janus' video room wants publishers to
offer. Its plug-in NoSIP offers: it is given a session description without WebRTC and turns it into
an offer for a WebRTC peer, whose media it sends on as plain RTP. That goes, inside of Janus'
machine, to a mountpoint of the plug-in Streaming, which offers it to any number of viewers.

    robot ══WebRTC══► NoSIP ──RTP, loopback──► mountpoint of Streaming ══WebRTC══► page, page, …
"""

import random
from dataclasses import dataclass
from typing import Any

from django.utils.crypto import salted_hmac

AUDIO, VIDEO = "audio", "video"
PAYLOAD_TYPES = {AUDIO: 111, VIDEO: 96}
_CODECS = {AUDIO: "opus", VIDEO: "vp8"}
_MAPS = {AUDIO: "opus/48000/2", VIDEO: "VP8/90000"}
_LOOPBACK = "127.0.0.1"
# Below the ports that Linux gives to programs that do not ask for one.
FIRST_PORT, LAST_PORT = 20000, 29996
PORTS_EACH = 4  # RTP and RTCP, of sound and of video
HELPERS = 2  # threads of Janus that send to the viewers
NO_SUCH_MOUNTPOINT, MOUNTPOINT_EXISTS, CANNOT_CREATE = 455, 456, 457


@dataclass(frozen=True)
class Mountpoint:
    """One robot's mountpoint, the same for every process of a site.

    Args:
        number: its id in Janus.
        secret: the password of its owners and of its viewers.
    """

    number: int
    secret: str

    def create(self, first_port: int, label: str) -> dict[str, Any]:
        """Return the request that creates it, at four ports of Janus' loopback interface."""
        media = [
            {
                "type": kind,
                "mid": kind,
                "codec": _CODECS[kind],
                "pt": PAYLOAD_TYPES[kind],
                "iface": _LOOPBACK,
                "port": first_port + offset,
                "rtcpport": first_port + offset + 1,
            }
            for kind, offset in ((AUDIO, 0), (VIDEO, 2))
        ]
        return {
            "request": "create",
            "type": "rtp",
            "id": self.number,
            "name": str(self.number),
            "metadata": label,
            "secret": self.secret,
            "pin": self.secret,
            "is_private": True,
            "threads": HELPERS,
            "media": media,
        }

    def info(self) -> dict[str, Any]:
        """Return the request for a MountpointInfo."""
        return {"request": "info", "id": self.number, "secret": self.secret}

    def sign(self, label: str) -> dict[str, Any]:
        """Return the request that sets the owner's label."""
        return {
            "request": "edit",
            "id": self.number,
            "secret": self.secret,
            "new_metadata": label,
        }

    def destroy(self) -> dict[str, Any]:
        """Return the request that destroys it, with the connections of its viewers."""
        return {"request": "destroy", "id": self.number, "secret": self.secret}

    def watch(self) -> dict[str, Any]:
        """Return a viewer's request for an offer."""
        return {"request": "watch", "id": self.number, "pin": self.secret}


@dataclass(frozen=True)
class MountpointInfo:
    """A mountpoint as Janus reports it: the owner's label, viewers, and the first of its ports."""

    label: str
    viewers: int
    first_port: int


def mountpoint_of(site_secret: str, robot: str) -> Mountpoint:
    """Return the mountpoint of a robot, which only knows who has the site's secret."""
    digest = salted_hmac("sessions.sfu", robot, secret=site_secret, algorithm="sha256").digest()
    # Janus takes whole numbers that JavaScript can hold
    return Mountpoint(int.from_bytes(digest[:8]) >> 12 or 1, digest[8:24].hex())


def some_port(rng: random.Random) -> int:
    """Return the first of four ports that are probably free."""
    return rng.randrange(FIRST_PORT, LAST_PORT, PORTS_EACH)


def read_info(data: dict[str, Any]) -> MountpointInfo:
    """Read an answer to `Mountpoint.info`."""
    info = data["info"]
    ports = [stream["port"] for stream in info["media"]]
    return MountpointInfo(str(info.get("metadata", "")), int(info["viewers"]), min(ports))


def plain_offer(first_port: int) -> str:
    """Return the description of a mountpoint's ports from which NoSIP makes the robot's offer:
    receive-only sound and video as plain RTP; lost packets of video can be requested.
    """
    lines = ["v=0", f"o=- 1 1 IN IP4 {_LOOPBACK}", "s=-", f"c=IN IP4 {_LOOPBACK}", "t=0 0"]
    for kind, offset in ((AUDIO, 0), (VIDEO, 2)):
        number = PAYLOAD_TYPES[kind]
        lines += [
            f"m={kind} {first_port + offset} RTP/AVP {number}",
            f"a=rtpmap:{number} {_MAPS[kind]}",
            "a=recvonly",
        ]
        if kind == VIDEO:
            lines += [f"a=rtcp-fb:{number} nack", f"a=rtcp-fb:{number} nack pli"]
    return "\r\n".join(lines) + "\r\n"
