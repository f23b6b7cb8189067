"""A valid picture passes unchanged; anything else is refused before it is shown."""

import struct

import pytest
from hypothesis import given, strategies as st

from robots.api import codec, picture, topics
from robots.api.errors import Rejection

JPEG = b"\xff\xd8\xff\xe0" + bytes(range(200)) + b"\xff\xd9"
LIMIT = topics.find("picture").limit


def test_a_decoded_picture_equals_the_encoded_one():
    assert picture.unpack(
        codec.decode("picture", picture.pack(1766000000.25, JPEG), "from_robot")
    ) == (1766000000.25, JPEG)


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"1234567",
        struct.pack(">d", 1.0),
        picture.pack(1.0, b"<svg onload=alert(1)>"),
        picture.pack(1.0, JPEG[:-1]),
        picture.pack(float("nan"), JPEG),
        picture.pack(float("inf"), JPEG),
        picture.pack(-1.0, JPEG),
        picture.pack(1e12, JPEG),
    ],
)
def test_a_picture_without_a_valid_stamp_or_jpeg_is_malformed(payload):
    with pytest.raises(Rejection) as refusal:
        codec.decode("picture", payload)
    assert refusal.value.reason == "malformed"


def test_a_picture_over_the_limit_is_oversized():
    with pytest.raises(Rejection) as refusal:
        codec.decode("picture", picture.pack(1.0, JPEG + b"\0" * LIMIT + b"\xff\xd9"))
    assert refusal.value.reason == "oversized"


def test_a_picture_does_not_travel_to_a_robot():
    with pytest.raises(Rejection) as refusal:
        codec.decode("picture", picture.pack(1.0, JPEG), "to_robot")
    assert refusal.value.reason == "wrong_direction"


@given(st.binary(max_size=400))
def test_no_bytes_at_all_raise_anything_but_a_rejection(payload):
    try:
        stamp, jpeg = picture.unpack(payload)
    except Rejection:
        return
    assert picture.pack(stamp, jpeg) == payload
