"""Messages between a simulator and its clients."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.process import framing
from robots.simulator import wire
from tests.support.examples import examples


@pytest.mark.parametrize(
    "message",
    [
        wire.SimulatorHello("driver"),
        wire.DriveOrder(0.5, -0.1),
        wire.TiltTo(0.3),
        wire.SetDoors({"lab-door": "closed"}),
        wire.Shutdown(),
        wire.AskTruth(),
        wire.AskHistory(3.0),
    ],
)
def test_client_messages_arrive(message: wire.SimulatorMessage) -> None:
    packed = framing.pack(message)
    assert framing.length(packed[: framing.HEADER]) == len(packed) - framing.HEADER
    assert wire.unpack_command(packed[framing.HEADER :]) == message


def test_simulator_messages_arrive() -> None:
    row = (1.0, 0.5, 0.0, 0.4, 0.0, 2.0, 3.0, 0.1)
    for message in (
        wire.SimulatorWelcome("giraff", "office", 7),
        wire.History((row,)),
        wire.Sound(b"abc"),
        wire.FrameReady(3, 1.5),
    ):
        assert wire.unpack_answer(framing.pack(message)[framing.HEADER :]) == message


@examples(50, thorough=1000)
@given(st.binary(max_size=200))
def test_bytes_that_are_no_message_raise_only_a_wire_error(data: bytes) -> None:
    for unpack in (wire.unpack_command, wire.unpack_answer):
        try:
            unpack(data)
        except framing.WireError:
            continue


def test_http_request_is_refused_by_its_first_four_bytes() -> None:
    with pytest.raises(framing.WireError):
        framing.length(b"GET ")
