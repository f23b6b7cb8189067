"""Mountpoints of Janus for a robot's stream, and Janus's offer to the robot."""

import random

from robots.agent.media.webrtc.sdp import media_lines
from sessions.sfu.mountpoint import (
    FIRST_PORT,
    LAST_PORT,
    MountpointInfo,
    mountpoint_of,
    plain_offer,
    read_info,
    some_port,
)


def test_the_mountpoint_is_the_same_in_every_process_of_a_site_and_in_no_other():
    ours = mountpoint_of("site", "giraff")
    assert ours == mountpoint_of("site", "giraff")
    assert ours.number != mountpoint_of("site", "rhodon").number
    assert ours.secret != mountpoint_of("other site", "giraff").secret
    assert mountpoint_of("site", "a giraff") != mountpoint_of("site a", "giraff")
    assert 0 < ours.number < 2**53, "a whole number that JavaScript can hold"


def test_ports_of_different_streams_do_not_overlap():
    rng = random.Random(1)
    ports = {some_port(rng) for _ in range(500)}
    assert all(port >= FIRST_PORT and port + 3 <= LAST_PORT and port % 4 == 0 for port in ports)


def test_a_mountpoint_listens_at_the_loopback_port_of_the_plain_offer():
    media = mountpoint_of("site", "giraff").create(24000, "me 0")["media"]
    assert {stream["iface"] for stream in media} == {"127.0.0.1"}
    offer = plain_offer(24000)
    for stream in media:
        assert f"m={stream['type']} {stream['port']} RTP/AVP {stream['pt']}\r\n" in offer
        assert stream["rtcpport"] == stream["port"] + 1, "where NoSIP sends its reports"
    assert offer.count("a=recvonly") == 2


def test_info_is_read():
    media = [{"port": 24000}, {"port": 24002}]
    data = {"info": {"metadata": "me 3", "viewers": 12, "media": media}}
    assert read_info(data) == MountpointInfo("me 3", 12, 24000)


JANUS_OFFER = """v=0
o=- 1 1 IN IP4 192.0.2.2
s=-
t=0 0
a=group:BUNDLE 0 1
a=fingerprint:sha-256 CD:BC:A3:4B
m=audio 9 UDP/TLS/RTP/SAVPF 111
c=IN IP4 192.0.2.2
a=recvonly
a=mid:0
a=rtcp-mux
a=ice-ufrag:2jeY
a=ice-pwd:RS/Bhn8dfzhHCQY0unobFs
a=setup:actpass
a=rtpmap:111 opus/48000/2
m=video 9 UDP/TLS/RTP/SAVPF 96 97
c=IN IP4 192.0.2.2
a=recvonly
a=mid:1
a=rtcp-mux
a=ice-ufrag:2jeY
a=ice-pwd:RS/Bhn8dfzhHCQY0unobFs
a=setup:actpass
a=rtpmap:96 VP8/90000
a=rtcp-fb:96 nack pli
a=rtpmap:97 rtx/90000
a=fmtp:97 apt=96
"""


def test_a_robot_reads_the_offer_of_janus_as_that_of_a_page():
    lines = media_lines(JANUS_OFFER.replace("\n", "\r\n"))
    assert [(line.kind, line.takes, line.gives) for line in lines] == [
        ("audio", True, False),
        ("video", True, False),
    ]
