"""The codec: what goes in comes out, and nothing that arrives raises anything but a Rejection."""

import json
import math

import msgspec
import pytest
from hypothesis import HealthCheck, given, strategies as st

from docs.robot_api import WITH_MESSAGES, examples as examples_of
from robots.api import codec, topics
from robots.api.errors import Rejection
from tests.support.examples import examples

SAMPLES = {
    topic.suffix.replace("+", "p1"): next(iter(examples_of()[topic.suffix].values()))
    for topic in WITH_MESSAGES
}
scalars = (
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text(max_size=20)
)
json_values = (
    scalars
    | st.lists(scalars, max_size=3)
    | st.dictionaries(st.text(max_size=8), scalars, max_size=2)
)
suffixes = st.sampled_from(
    [topic.suffix.replace("+", "p1") for topic in (*topics.TABLE, *topics.DATA_CHANNEL_ONLY)]
)


def cases(ordinary, thorough):
    return examples(ordinary, thorough=thorough, suppress_health_check=list(HealthCheck))


def survives(suffix, payload):
    """Decode: a message that passes is finite, and encoding does not change it."""
    try:
        message = codec.decode(suffix, payload)
    except Rejection:
        return
    if isinstance(message, bytes):
        return
    again = codec.encode(message)
    assert codec.decode(suffix, again) == message
    assert finite(msgspec.to_builtins(message))


def finite(value):
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    return all(map(finite, value)) if isinstance(value, list | tuple) else True


@pytest.mark.parametrize("suffix", SAMPLES)
def test_a_decoded_frame_equals_the_encoded_one(suffix):
    message = SAMPLES[suffix]
    assert codec.decode_frame(codec.encode_frame(suffix, message)) == (suffix, message)


def test_every_line_of_the_topic_table_can_be_decoded():
    for topic in topics.TABLE:
        with (
            pytest.raises(Rejection) if topic.suffix != "photo/+" else pytest.MonkeyPatch.context()
        ):
            codec.decode(topic.suffix.replace("+", "p1"), b"[]")


@cases(1000, thorough=45_000)
@given(suffixes, st.binary(max_size=300))
def test_bytes_of_any_kind_are_decoded_or_rejected(suffix, payload):
    survives(suffix, payload)


@cases(300, thorough=15_000)
@given(st.sampled_from(sorted(SAMPLES)), st.data())
def test_a_message_with_fields_changed_or_missing_is_decoded_or_rejected(suffix, data):
    fields = json.loads(codec.encode(SAMPLES[suffix]))
    for key in data.draw(st.lists(st.sampled_from(sorted(fields)), max_size=3)):
        fields[key] = data.draw(json_values)
    for key in data.draw(st.lists(st.sampled_from(sorted(fields)), max_size=1)):
        del fields[key]
    survives(suffix, json.dumps(fields))


@cases(250, thorough=10_000)
@given(st.sampled_from(sorted(SAMPLES)), st.data())
def test_a_message_with_bytes_changed_is_decoded_or_rejected(suffix, data):
    payload = bytearray(codec.encode(SAMPLES[suffix]))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    survives(suffix, bytes(payload))


@cases(250, thorough=10_000)
@given(st.text(max_size=200) | st.binary(max_size=200))
def test_a_frame_of_any_kind_is_decoded_or_rejected(frame):
    try:
        suffix, _ = codec.decode_frame(frame)
    except Rejection:
        return
    assert topics.find(suffix)


@cases(200, thorough=5000)
@given(st.floats(), st.floats(), st.integers(-(2**64), 2**64))
def test_a_velocity_that_passes_is_finite_in_range_and_counted_exactly(linear, angular, seq):
    payload = json.dumps(
        {
            "session": "s",
            "epoch": 1,
            "seq": seq,
            "stamp": 1.0,
            "linear": linear,
            "angular": angular,
            "method": "script",
        }
    )
    inside = abs(linear) <= 10 and abs(angular) <= 20 and 0 <= seq < 2**53
    if inside:
        assert codec.decode("command/velocity", payload).seq == seq
    else:
        with pytest.raises(Rejection, match="malformed"):
            codec.decode("command/velocity", payload)


@pytest.mark.parametrize(
    "word", ["NaN", "Infinity", "-Infinity", "1e999", '"0.5"', "true", "null", "[0.5]"]
)
def test_a_speed_that_is_no_number_is_rejected(word):
    with pytest.raises(Rejection, match="malformed"):
        codec.decode(
            "command/velocity",
            '{"session":"s","epoch":1,"seq":1,"stamp":1,"angular":0,"method":"script","linear":'
            + word
            + "}",
        )


def test_a_payload_over_the_limit_of_its_topic_is_rejected_before_parsing():
    with pytest.raises(Rejection, match="oversized"):
        codec.decode("command/velocity", b" " * 1025)
    with pytest.raises(Rejection, match="oversized"):
        codec.decode_frame("command/velocity\n" + " " * codec.MAX_FRAME)


def test_deep_nesting_is_rejected_not_followed():
    with pytest.raises(Rejection):
        codec.decode("command/action", b'{"type":' + b"[" * 30_000 + b"]" * 30_000 + b"}")


def test_an_unknown_topic_and_a_wrong_direction_are_named():
    with pytest.raises(Rejection, match="unknown_topic"):
        codec.decode("command/velocity/now", b"{}")
    with pytest.raises(Rejection, match="wrong_direction"):
        codec.decode("state", codec.encode(SAMPLES["state"]), "to_robot")


def test_unknown_fields_of_a_newer_peer_are_ignored():
    fields = json.loads(codec.encode(SAMPLES["lease"])) | {"colour": "blue"}
    assert codec.decode("lease", json.dumps(fields)) == SAMPLES["lease"]
