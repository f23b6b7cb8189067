"""Reading an offer."""

import pytest

from robots.agent.media.webrtc.sdp import (
    BadOfferError,
    MediaLine,
    media_lines,
    parsed_candidate,
    robot_lines,
    without_candidates,
)

CANDIDATE = "candidate:1 1 udp 2113937151 10.0.0.1 57459 typ host"


def test_robot_sends_on_the_first_receiving_line_of_each_kind() -> None:
    lines = (
        MediaLine("video", takes=False, gives=True),
        MediaLine("video", takes=True, gives=False),
        MediaLine("audio", takes=True, gives=True),
        MediaLine("video", takes=True, gives=True),
    )
    assert robot_lines(lines, frozenset({"audio", "video"})) == {1: "video", 2: "audio"}
    assert robot_lines(lines, frozenset({"audio"})) == {2: "audio"}
    assert robot_lines(lines, frozenset()) == {}


def test_candidates_are_taken_out_of_an_offer_with_their_lines() -> None:
    offer = (
        "v=0\r\nm=video 9\r\na=candidate:1 1 udp 1 10.0.0.1 9 typ host\r\na=mid:0\r\nm=audio"
        " 9\r\na=candidate:2 1 udp 1 10.0.0.2 9 typ host\r\na=end-of-candidates\r\n"
    )
    plain, candidates = without_candidates(offer)
    assert plain == "v=0\r\nm=video 9\r\na=mid:0\r\nm=audio 9\r\n"
    assert candidates == [
        (0, "candidate:1 1 udp 1 10.0.0.1 9 typ host"),
        (1, "candidate:2 1 udp 1 10.0.0.2 9 typ host"),
    ]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "candidate:",
        "candidate:nonsense",
        "candidate:1 2 udp 1 10.0.0.1 9 typ host",
        "candidate:1 1 tcp 1 10.0.0.1 9 typ host tcptype active",
    ],
)
def test_the_end_of_candidates_and_unusable_ones_are_none(text: str) -> None:
    assert parsed_candidate(text, "0", None) is None


def test_a_candidate_keeps_its_line() -> None:
    candidate = parsed_candidate(f"{CANDIDATE} generation 0 ufrag x network-cost 999", "0", 0)
    assert (candidate.ip, candidate.port) == ("10.0.0.1", 57459)
    assert (candidate.sdpMid, candidate.sdpMLineIndex) == ("0", 0)
    assert parsed_candidate(CANDIDATE, None, None) is None


@pytest.mark.parametrize(
    "offer", ["", "v=0\r\n", "m=video 9 UDP/TLS/RTP/SAVPF 96\r\n", "\r\n" * 100]
)
def test_invalid_offer_is_refused(offer: str) -> None:
    with pytest.raises(BadOfferError):
        media_lines(offer)
