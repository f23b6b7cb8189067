"""A real JPEG, and one in which a camera has written more than the picture."""

import io

import av
import numpy as np


def _encoded() -> bytes:
    out = io.BytesIO()
    with av.open(out, "w", format="image2pipe") as file:
        stream = file.add_stream("mjpeg", rate=1)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        ramp = np.linspace(0, 255, 64 * 48 * 3).astype(np.uint8).reshape(48, 64, 3)
        for packet in stream.encode(av.VideoFrame.from_ndarray(ramp, format="rgb24")):
            file.mux(packet)
        for packet in stream.encode():
            file.mux(packet)
    return out.getvalue()


JPEG = _encoded()


def with_metadata(secret: bytes) -> bytes:
    """The same picture with a secret in its EXIF, its colour profile, a comment, and behind it."""

    def segment(marker: int, content: bytes) -> bytes:
        return bytes((0xFF, marker)) + (len(content) + 2).to_bytes(2) + content

    more = (
        segment(0xE1, b"Exif\0\0" + secret),
        segment(0xE2, b"ICC_PROFILE\0" + secret),
        segment(0xFE, secret),
    )
    return JPEG[:2] + b"".join(more) + JPEG[2:] + secret
