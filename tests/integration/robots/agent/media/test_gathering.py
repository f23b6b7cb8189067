"""Servers that delay the gathering of addresses are probed again."""

import pytest
from aiortc import RTCConfiguration, RTCPeerConnection

from robots.agent.media.webrtc import signalling
from robots.agent.media.webrtc.relays import Relays
from robots.agent.media.webrtc.signalling import PageConnection
from robots.api.messages import IceServer, SdpOffer

DATA_ONLY = RTCConfiguration(iceServers=[])


@pytest.mark.parametrize(("long", "asked_for_two"), [(-1.0, 2), (1e9, 1)])
async def test_servers_that_delayed_an_answer_are_probed_again_before_the_next_one(
    monkeypatch, long, asked_for_two
):
    monkeypatch.setattr(signalling, "LONG_GATHERING", long)
    asked = []

    async def silent(server):
        asked.append(server.urls[0])
        return False

    relays, page = Relays(silent, lambda: 0.0), RTCPeerConnection(DATA_ONLY)
    page.createDataChannel("control")
    await page.setLocalDescription(await page.createOffer())
    offer = SdpOffer(
        sdp=page.localDescription.sdp, ice_servers=(IceServer(urls=("stun:203.0.113.9",)),)
    )
    for _ in range(2):
        connection = PageConnection(
            "ada", None, None, lambda _: None, lambda: None, lambda: None, relays=relays
        )
        await connection.answer(offer)
        await connection.close()
    await page.close()
    assert asked == ["stun:203.0.113.9"] * asked_for_two
