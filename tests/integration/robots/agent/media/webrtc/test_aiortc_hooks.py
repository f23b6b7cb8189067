"""The hooks fit the installed version of aiortc, and refuse others."""

import aioice.ice
import aiortc
import pytest
from aiortc import RTCConfiguration, RTCPeerConnection
from aiortc.rtp import (
    RTCP_PSFB_APP,
    RTCP_PSFB_PLI,
    RtcpPsfbPacket,
    RtcpReceiverInfo,
    RtcpRrPacket,
    pack_remb_fci,
)

from robots.agent.media.webrtc import aiortc_hooks


class _Outbox:
    def __init__(self) -> None:
        self.keys = 0
        self.reports = 0

    async def take(self):
        raise ConnectionError

    def key_frame_wanted(self) -> None:
        self.keys += 1

    def on_report(self) -> None:
        self.reports += 1


def test_installed_aiortc_is_supported() -> None:
    aiortc_hooks.check()


def test_another_aiortc_is_refused_by_its_version(monkeypatch) -> None:
    monkeypatch.setattr(aiortc, "__version__", "1.17.0")
    with pytest.raises(aiortc_hooks.UnsupportedAiortcError, match=r"1\.17\.0"):
        aiortc_hooks.check()


def test_hooks_can_be_installed_twice() -> None:
    aiortc_hooks.install()
    offered, search = list(aiortc.codecs.HEADER_EXTENSIONS["video"]), aioice.ice.get_host_addresses
    aiortc_hooks.install()
    assert aiortc.codecs.HEADER_EXTENSIONS["video"] == offered
    assert sum(extension.uri == aiortc_hooks.PLAYOUT_DELAY for extension in offered) == 1
    assert aioice.ice.get_host_addresses is search


@pytest.mark.parametrize(("found", "used"), [([], ["127.0.0.1"]), (["10.0.0.1"], ["10.0.0.1"])])
def test_loopback_address_is_offered_only_without_others(found: list[str], used: list[str]) -> None:
    search = aiortc_hooks._WithLoopback(lambda use_ipv4, use_ipv6: found)
    assert search(use_ipv4=True, use_ipv6=True) == used


async def test_robot_without_network_offers_the_loopback_address(monkeypatch) -> None:
    aiortc_hooks.install()
    monkeypatch.setattr(aioice.ice.get_host_addresses, "found_by", lambda use_ipv4, use_ipv6: [])
    connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    connection.createDataChannel("control")
    await connection.setLocalDescription(await connection.createOffer())
    assert " 127.0.0.1 " in connection.localDescription.sdp
    await connection.close()


async def test_offer_has_our_sender_with_vp8_alone_and_playout_delay() -> None:
    aiortc_hooks.install()
    connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    sender = aiortc_hooks.add_sender(connection, "video", _Outbox(), "video/VP8")
    assert connection.getSenders() == [sender]
    sdp = (await connection.createOffer()).sdp
    assert aiortc_hooks.PLAYOUT_DELAY in sdp
    assert "VP8" in sdp
    assert "rtx" in sdp
    # a password may contain these characters, too
    kinds = [line for line in sdp.splitlines() if line.startswith("a=rtpmap:")]
    assert not [line for line in kinds if "H264" in line]
    assert sender.backlog() == 0
    await connection.close()


async def test_only_the_robots_own_video_gets_transport_wide_numbers() -> None:
    aiortc_hooks.install()
    page = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    robot = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    page.addTransceiver("video", direction="recvonly")
    aiortc_hooks.add_sender(robot, "video", _Outbox(), "video/VP8")
    page.addTransceiver("video", direction="sendonly")
    robot.addTransceiver("video", direction="recvonly")
    await page.setLocalDescription(await page.createOffer())
    await robot.setRemoteDescription(page.localDescription)
    aiortc_hooks.number_own_packets(robot)
    answer = (await robot.createAnswer()).sdp
    _, *lines = answer.split("m=video")
    assert [aiortc_hooks.TRANSPORT_NUMBER in line for line in lines] == [True, False]
    assert "transport-cc" in lines[0]
    await page.close()
    await robot.close()


async def test_rtcp_reaches_the_outbox() -> None:
    connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    outbox = _Outbox()
    sender = aiortc_hooks.add_sender(connection, "video", outbox, "video/VP8")
    remb = pack_remb_fci(500_000, [sender._ssrc])
    counts = {"fraction_lost": 64, "packets_lost": 10, "highest_sequence": 90}
    lost = RtcpReceiverInfo(ssrc=sender._ssrc, jitter=0, lsr=0, dlsr=0, **counts)
    for packet in (
        RtcpPsfbPacket(fmt=RTCP_PSFB_PLI, ssrc=1, media_ssrc=sender._ssrc),
        RtcpPsfbPacket(fmt=RTCP_PSFB_APP, ssrc=1, media_ssrc=0, fci=remb),
        RtcpPsfbPacket(fmt=RTCP_PSFB_APP, ssrc=1, media_ssrc=0, fci=b"rubbish"),
        RtcpRrPacket(ssrc=1, reports=[lost]),
    ):
        await sender._handle_rtcp_packet(packet)
    assert outbox.keys == 1
    assert outbox.reports == 4
    await connection.close()
