"""How often FORWARD TSN and acknowledgements are sent."""

import asyncio
from types import SimpleNamespace

import pytest

from robots.agent.media.webrtc import aiortc_hooks
from robots.agent.media.webrtc.aiortc_hooks import FORWARD_TSN_PERIOD


@pytest.fixture
def transport(monkeypatch):
    """An aiortc transport whose receiver has not acknowledged what was given up, and the clock that
    it is asked by.
    """
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(aiortc_hooks.time, "monotonic", lambda: clock.now)
    association = SimpleNamespace(clock=clock, open=True, _forward_tsn_chunk=None)

    def update():
        association._forward_tsn_chunk = "step over" if association.open else None

    association._update_advanced_peer_ack_point = update
    aiortc_hooks.limit_forward_tsn(association)
    return association


def is_sent(transport):
    transport._update_advanced_peer_ack_point()
    chunk, transport._forward_tsn_chunk = transport._forward_tsn_chunk, None  # as `_transmit` does
    return chunk is not None


def test_a_hundred_acknowledgements_in_a_moment_are_answered_once(transport):
    assert [is_sent(transport) for _ in range(100)] == [True] + [False] * 99


def test_forward_tsn_is_repeated_until_acknowledged(transport):
    assert is_sent(transport)
    transport.clock.now += FORWARD_TSN_PERIOD
    assert is_sent(transport)
    transport.open = False
    transport.clock.now += FORWARD_TSN_PERIOD
    assert not is_sent(transport)


def test_forward_tsn_after_a_pause_is_sent_at_once(transport):
    transport.open = False
    assert not is_sent(transport)
    transport.open = True
    assert is_sent(transport)


async def test_many_messages_are_acknowledged_at_once_and_again_after_a_while(monkeypatch):
    monkeypatch.setattr(aiortc_hooks, "SACK_PERIOD", 0.05)
    sent = []

    async def send():
        sent.append(asyncio.get_running_loop().time())
        association._sack_needed = False

    association = SimpleNamespace(
        _send_sack=send, _sack_needed=False, transport=SimpleNamespace(state="connected")
    )
    aiortc_hooks.limit_sacks(association)
    for _ in range(100):
        association._sack_needed = True
        await association._send_sack()
    assert len(sent) == 1
    while len(sent) < 2:
        await asyncio.sleep(0.01)
    assert not association._sack_needed
    assert sent[1] - sent[0] >= 0.04
