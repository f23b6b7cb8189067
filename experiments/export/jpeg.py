"""A JPEG without its metadata: times, places, serial numbers, previews (ITU-T T.81, annex B).

Only the segments that decoding needs are kept. A comment names the photo, so that its checksum is
not the one that robot and database have.
"""

from collections.abc import Iterator

START, END = 0xD8, 0xD9
SCAN = 0xDA
COMMENT = 0xFE
JFIF, ADOBE = 0xE0, 0xEE
JFIF_BYTES = 18
# Frames (SOFn), Huffman and arithmetic tables, scans, quantization, lines, restarts. Of the
# application segments, only JFIF and Adobe are kept, which define the colours.
_KEPT = frozenset({*range(0xC0, 0xD0), *range(0xDA, 0xDE)})


class JpegError(ValueError):
    """These bytes are no JPEG."""


def without_metadata(jpeg: bytes, name: str) -> bytes:
    """Return the image alone, with `name` as its comment, or raise JpegError."""
    comment = name.encode()
    begin = bytes((0xFF, START, 0xFF, COMMENT)) + (len(comment) + 2).to_bytes(2) + comment
    parts = (part for marker, part in _parts(jpeg) if _is_kept(marker, part))
    return b"".join((begin, *parts, bytes((0xFF, END))))


def _is_kept(marker: int, part: bytes) -> bool:
    if marker == JFIF:  # a longer one contains a preview
        return part[4:].startswith(b"JFIF\0") and len(part) == JFIF_BYTES
    if marker == ADOBE:
        return part[4:].startswith(b"Adobe")
    return marker in _KEPT


def _parts(jpeg: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the marker and bytes of each segment; a scan includes the coded image after it."""
    if jpeg[:2] != bytes((0xFF, START)):
        raise JpegError("no start of a picture")
    at = 2
    while True:
        at = _past_fill(jpeg, at)
        marker = jpeg[at + 1]
        if marker == END:
            return
        length = int.from_bytes(jpeg[at + 2 : at + 4])
        end = at + 2 + length
        if length < 2 or end > len(jpeg):
            raise JpegError("a segment is cut off")
        if marker == SCAN:
            end = _end_of_scan(jpeg, end)
        yield marker, jpeg[at:end]
        at = end


def _past_fill(jpeg: bytes, at: int) -> int:
    """Return the offset of the next marker, before which any number of 0xFF is allowed."""
    if jpeg[at : at + 1] != b"\xff":
        raise JpegError("no marker where one is due")
    while jpeg[at + 1 : at + 2] == b"\xff":
        at += 1
    if at + 2 > len(jpeg):
        raise JpegError("it has no end")
    return at


def _end_of_scan(jpeg: bytes, at: int) -> int:
    """Return the end of the coded image: a marker that is neither a stuffed 0xFF nor a restart."""
    while True:
        at = jpeg.find(b"\xff", at)
        if at < 0 or at + 1 >= len(jpeg):
            raise JpegError("it has no end")
        if jpeg[at + 1] not in {0x00, *range(0xD0, 0xD8), 0xFF}:
            return at
        at += 1
