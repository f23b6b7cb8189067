"""How often FORWARD TSN is sent."""

from types import SimpleNamespace

import pytest

from robots.agent.media.webrtc import sctp


@pytest.fixture
def transport(monkeypatch):
    """An aiortc transport whose receiver has not acknowledged what was given up, and the clock that
    it is asked by.
    """
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(sctp.time, "monotonic", lambda: clock.now)
    association = SimpleNamespace(clock=clock, open=True, _forward_tsn_chunk=None)

    def update():
        association._forward_tsn_chunk = "step over" if association.open else None

    association._update_advanced_peer_ack_point = update
    sctp.limit_forward_tsn(association)
    return association


def said(transport):
    transport._update_advanced_peer_ack_point()
    chunk, transport._forward_tsn_chunk = transport._forward_tsn_chunk, None  # as `_transmit` does
    return chunk is not None


def test_a_hundred_acknowledgements_in_a_moment_are_answered_once(transport):
    assert [said(transport) for _ in range(100)] == [True] + [False] * 99


def test_it_is_said_again_until_it_is_acknowledged(transport):
    assert said(transport)
    transport.clock.now += sctp.SAY_AGAIN
    assert said(transport)
    transport.open = False
    transport.clock.now += sctp.SAY_AGAIN
    assert not said(transport)


def test_forward_tsn_after_a_pause_is_sent_at_once(transport):
    transport.open = False
    assert not said(transport)
    transport.open = True
    assert said(transport)
