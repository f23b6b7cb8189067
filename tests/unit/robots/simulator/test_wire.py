"""Messages between a simulator and its clients."""

from hypothesis import given, strategies as st

from robots.process import framing
from robots.simulator import wire
from tests.support.examples import examples


@examples(50, thorough=1000)
@given(st.binary(max_size=200))
def test_bytes_that_are_no_message_raise_only_a_wire_error(data: bytes) -> None:
    for unpack in (wire.unpack_command, wire.unpack_answer):
        try:
            unpack(data)
        except framing.WireError:
            continue
