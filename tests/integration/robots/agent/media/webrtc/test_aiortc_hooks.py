"""The hooks fit the aiortc that is installed: these fail loudly when another one is."""

import aioice.ice
import aiortc
import pytest
from aiortc import RTCConfiguration, RTCPeerConnection

from robots.agent.media.webrtc import aiortc_hooks


class _Outbox:
    def __init__(self) -> None:
        self.keys = 0
        self.reports: list[float | None] = []

    async def take(self):
        raise ConnectionError

    def key_frame_wanted(self) -> None:
        self.keys += 1

    def on_report(self, loss: float | None) -> None:
        self.reports.append(loss)


def test_the_installed_aiortc_is_one_that_the_hooks_fit() -> None:
    aiortc_hooks.check()


def test_another_aiortc_is_refused_by_name(monkeypatch) -> None:
    monkeypatch.setattr(aiortc, "__version__", "1.17.0")
    with pytest.raises(aiortc_hooks.UnsupportedAiortcError, match=r"1\.17\.0"):
        aiortc_hooks.check()


def test_installing_twice_changes_nothing_more() -> None:
    aiortc_hooks.install()
    offered, search = list(aiortc.codecs.HEADER_EXTENSIONS["video"]), aioice.ice.get_host_addresses
    aiortc_hooks.install()
    assert aiortc.codecs.HEADER_EXTENSIONS["video"] == offered
    assert sum(extension.uri == aiortc_hooks.PLAYOUT_DELAY for extension in offered) == 1
    assert aioice.ice.get_host_addresses is search


@pytest.mark.parametrize(("found", "used"), [([], ["127.0.0.1"]), (["10.0.0.1"], ["10.0.0.1"])])
def test_the_loopback_address_is_offered_when_there_is_nothing_else(
    found: list[str], used: list[str]
) -> None:
    assert (
        aiortc_hooks._WithLoopback(lambda use_ipv4, use_ipv6: found)(use_ipv4=True, use_ipv6=True)
        == used
    )


async def test_a_robot_without_network_still_offers_a_candidate(monkeypatch) -> None:
    aiortc_hooks.install()
    monkeypatch.setattr(aioice.ice.get_host_addresses, "found_by", lambda use_ipv4, use_ipv6: [])
    connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    connection.createDataChannel("control")
    await connection.setLocalDescription(await connection.createOffer())
    assert " 127.0.0.1 " in connection.localDescription.sdp
    await connection.close()


async def test_the_offer_has_our_sender_vp8_alone_and_playout_delay() -> None:
    aiortc_hooks.install()
    connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    sender = aiortc_hooks.add_sender(connection, "video", _Outbox(), "video/VP8")
    assert connection.getSenders() == [sender]
    sdp = (await connection.createOffer()).sdp
    assert aiortc_hooks.PLAYOUT_DELAY in sdp
    assert "VP8" in sdp
    assert "rtx" in sdp
    # elsewhere, in a password, it may stand by chance
    kinds = [line for line in sdp.splitlines() if line.startswith("a=rtpmap:")]
    assert not [line for line in kinds if "H264" in line]
    assert sender.backlog() == 0
    await connection.close()


async def test_rtcp_reaches_the_outbox() -> None:
    from aiortc.rtp import (
        RTCP_PSFB_APP,
        RTCP_PSFB_PLI,
        RtcpPsfbPacket,
        RtcpReceiverInfo,
        RtcpRrPacket,
        pack_remb_fci,
    )

    connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    outbox = _Outbox()
    sender = aiortc_hooks.add_sender(connection, "video", outbox, "video/VP8")
    await sender._handle_rtcp_packet(
        RtcpPsfbPacket(fmt=RTCP_PSFB_PLI, ssrc=1, media_ssrc=sender._ssrc)
    )
    await sender._handle_rtcp_packet(
        RtcpPsfbPacket(
            fmt=RTCP_PSFB_APP, ssrc=1, media_ssrc=0, fci=pack_remb_fci(500_000, [sender._ssrc])
        )
    )
    await sender._handle_rtcp_packet(
        RtcpPsfbPacket(fmt=RTCP_PSFB_APP, ssrc=1, media_ssrc=0, fci=b"rubbish")
    )
    lost = RtcpReceiverInfo(
        ssrc=sender._ssrc,
        fraction_lost=64,
        packets_lost=10,
        highest_sequence=90,
        jitter=0,
        lsr=0,
        dlsr=0,
    )
    await sender._handle_rtcp_packet(RtcpRrPacket(ssrc=1, reports=[lost]))
    assert outbox.keys == 1
    assert outbox.reports == [None, None, None, 0.25]
    await connection.close()
