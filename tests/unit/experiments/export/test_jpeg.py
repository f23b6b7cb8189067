"""A photo leaves as the picture alone."""

import hashlib
import io

import av
import numpy as np
import pytest

from experiments.export.jpeg import JpegError, without_metadata
from tests.support.media.jpegs import JPEG, with_metadata

SECRET = b"2026:05:04 09:00:00 zoe"


def decoded(jpeg: bytes) -> np.ndarray:
    with av.open(io.BytesIO(jpeg)) as file:
        return next(file.decode(video=0)).to_ndarray(format="rgb24")


def test_image_is_unchanged_and_its_metadata_are_removed():
    stored = with_metadata(SECRET)
    assert stored.count(SECRET) == 4
    left = without_metadata(stored, "session-S1-1")
    assert SECRET not in left
    assert b"session-S1-1" in left
    np.testing.assert_array_equal(decoded(left), decoded(stored))


def test_checksum_changes_even_without_metadata():
    left = without_metadata(JPEG, "session-S1-1")
    assert hashlib.sha256(left).digest() != hashlib.sha256(JPEG).digest()
    assert without_metadata(left, "session-S1-1") == left
    np.testing.assert_array_equal(decoded(left), decoded(JPEG))


@pytest.mark.parametrize(
    "broken",
    [
        b"",
        b"\xff\xd8",
        b"\xff\xd8portrait\xff\xd9",
        JPEG[:-2],
        JPEG[: len(JPEG) // 2],
        JPEG[:6],
        b"\xff\xd8\xff\xe1\x00\x01\xff\xd9",
    ],
)
def test_bytes_that_are_no_jpeg_are_refused(broken):
    with pytest.raises(JpegError):
        without_metadata(broken, "name")
