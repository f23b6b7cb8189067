"""Reads a page's offer before aiortc does: its lines, and those for the robot's video and sound.

The page offers all lines at once (the robot's video and sound, its own, a screen's), because aiortc
cannot renegotiate; a track is put into a line later. The candidates are removed and given to ICE
afterwards: an mDNS name that cannot be resolved takes a second to fail, and the answer should not
wait for it.
"""

from dataclasses import dataclass

from aiortc import RTCIceCandidate
from aiortc.sdp import SessionDescription, candidate_from_sdp

from robots.agent.media.rtp import Kind

MAX_LINES = 12
# what aiortc raises about an offer that it cannot read
UNREADABLE = (ValueError, LookupError, AssertionError, AttributeError, TypeError)


class BadOfferError(ValueError):
    """An offer that cannot be answered; the message says why, for the log."""


@dataclass(frozen=True)
class MediaLine:
    """An audio or video line of an offer: whether the page receives or may send there."""

    kind: Kind
    takes: bool
    gives: bool


def media_lines(offer: str) -> tuple[MediaLine, ...]:
    """Return an offer's audio and video lines, in order; raises BadOfferError."""
    try:
        description = SessionDescription.parse(offer)
    except (*UNREADABLE, StopIteration) as error:
        raise BadOfferError(f"not SDP: {type(error).__name__}") from error
    if (wrong := _what_is_wrong(description)) is not None:
        raise BadOfferError(wrong)
    kinds: dict[str, Kind] = {"audio": "audio", "video": "video"}
    return tuple(
        MediaLine(
            kinds[media.kind],
            takes=media.direction not in ("sendonly", "inactive"),
            gives=media.direction not in ("recvonly", "inactive"),
        )
        for media in description.media
        if media.kind in kinds
    )


def _what_is_wrong(description: SessionDescription) -> str | None:
    """Return why aiortc would stumble over an offer half-way, leaving sockets open, or None.

    Every browser bundles all of its lines on one transport; nothing else is supported here.
    """
    media = description.media
    if not 1 <= len(media) <= MAX_LINES:
        return f"{len(media)} media lines"
    mids = [line.rtp.muxId for line in media]
    bundles = [group.items for group in description.group if group.semantic == "BUNDLE"]
    if len(set(mids)) != len(mids) or len(bundles) != 1 or sorted(bundles[0]) != sorted(mids):
        return "the lines are not one bundle"
    if (
        any(line.kind not in ("audio", "video", "application") for line in media)
        or sum(line.kind == "application" for line in media) > 1
    ):
        return "a line is of an unknown kind"
    if not all(
        line.dtls
        and line.dtls.fingerprints
        and line.ice
        and line.ice.usernameFragment
        and line.ice.password
        for line in media
    ):
        return "a line lacks its fingerprint or its ICE credentials"
    return None


def robot_lines(lines: tuple[MediaLine, ...], has: frozenset[Kind]) -> dict[int, Kind]:
    """Return {index: kind} of the lines for the robot's media: the first that receives."""
    chosen: dict[int, Kind] = {}
    for index, line in enumerate(lines):
        if line.takes and line.kind in has and line.kind not in chosen.values():
            chosen[index] = line.kind
    return chosen


def visitor_lines(lines: tuple[MediaLine, ...], robot: dict[int, Kind]) -> dict[int, Kind]:
    """Return {index: kind} of the lines for the visitor's voice and face.

    The first that sends sound, which may be the robot's own, and the first beside the robot's that
    sends video; a second one of a kind is ignored.
    """
    chosen: dict[int, Kind] = {}
    for index, line in enumerate(lines):
        own = line.kind == "video" and index in robot
        if line.gives and not own and line.kind not in chosen.values():
            chosen[index] = line.kind
    return chosen


def without_candidates(offer: str) -> tuple[str, list[tuple[int, str]]]:
    """Return the offer without its candidates, and those as (line index, candidate)."""
    kept: list[str] = []
    candidates: list[tuple[int, str]] = []
    index = -1
    for line in offer.splitlines():
        index += line.startswith("m=")
        if line.startswith("a=candidate:"):
            candidates.append((index, line[len("a=") :]))
        elif not line.startswith("a=end-of-candidates"):
            kept.append(line)
    return "\r\n".join(kept) + "\r\n", candidates


def parsed_candidate(text: str, mid: str | None, index: int | None) -> RTCIceCandidate | None:
    """Return a candidate as aiortc wants it; None for an end of candidates and for one that cannot
    be used.

    Not used are TCP, malformed candidates, and component 2 (separate RTCP), which Firefox lists
    although RTP and RTCP are multiplexed.
    """
    if not text:
        return None
    try:
        candidate = candidate_from_sdp(text.removeprefix("candidate:"))
    except (ValueError, LookupError, AssertionError):
        return None
    if (
        candidate.protocol.lower() != "udp"
        or candidate.component != 1
        or (mid is None and index is None)
    ):
        return None
    candidate.sdpMid, candidate.sdpMLineIndex = mid, index
    return candidate
