"""Occupancy grids as ROS map_server keeps them: a YAML file that names an image.

An image value v means the occupancy (255 - v) / 255, or v / 255 when the file says `negate`: above
`occupied_thresh` a cell is occupied, below `free_thresh` free, between them unknown
(wiki.ros.org/map_server, mode `trinary`).

In the mode `scale` the values between the thresholds are how likely a cell is occupied. Neither is
certain, so for driving they are unknown, too. In the mode `raw` a value from 0 to 100 is itself the
occupancy in percent, and everything above is unknown. In a PNG, pixels that are not opaque are
unknown (nav2_map_server, map_io.cpp). Reading a map converts it to the mode `trinary`.
"""

import io
import math
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from robots.api.geometry import MapTransform, Pose2D

OCCUPIED, UNKNOWN, FREE = 0, 205, 254
MAXIMUM_SIDE = 8192
HEADER_BYTES = 4096
MODES = ("trinary", "scale", "raw")
WITH_ALPHA = ("rgba", "rgba64be", "ya8", "ya16be", "pal8")  # FFmpeg's names of what a PNG can have
PNG = b"\x89PNG\r\n\x1a\n"
# What makes the picture. Other chunks, such as colour profiles and texts, may unpack to any size.
PNG_CHUNKS = frozenset({b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"})
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by colour type
INFLATED_AT_ONCE = 1024 * 1024
YES, NO = frozenset({"1", "true", "yes", "on"}), frozenset({"", "0", "false", "no", "off"})
_BETWEEN = rb"(?:\s|#[^\n]*\n)+"
_PGM = re.compile(rb"P[25]" + _BETWEEN + rb"(\d{1,9})" + _BETWEEN + rb"(\d{1,9})\s")


class MapError(ValueError):
    """A map that cannot be read; the message names the file and the error."""


class _PlainYaml(yaml.BaseLoader):
    """YAML whose scalars are all text, without aliases: a line of aliases can expand to gigabytes,
    and some numbers of YAML 1.1 take minutes to compute.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Return the next node.

        Raises:
            yaml.YAMLError: it is an alias.
        """
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases (*name) are not accepted")
        return super().compose_node(parent, index)


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A map: `image` (h, w) uint8 as in the file, row 0 on top, and its place in the world."""

    image: npt.NDArray[np.uint8]
    transform: MapTransform
    negate: bool = False
    occupied_thresh: float = 0.65
    free_thresh: float = 0.196

    def occupied(self) -> npt.NDArray[np.bool_]:
        """Return (h, w), True where a cell is occupied."""
        return (self._of_values() > self.occupied_thresh)[self.image]

    def free(self) -> npt.NDArray[np.bool_]:
        """Return (h, w), True where a robot may be."""
        return (self._of_values() < self.free_thresh)[self.image]

    def _of_values(self) -> npt.NDArray[np.float64]:
        """Return (256,) the occupancy of each image value: one of each cell would take 16 bytes."""
        share = np.arange(256) / 255.0
        return share if self.negate else 1.0 - share


def load_grid(path: Path) -> OccupancyGrid:
    """Return the map that a map_server YAML file describes.

    Raises:
        MapError: the file or its image is missing, malformed or out of bounds.
    """
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), _PlainYaml)  # noqa: S506 -- text only
    except (OSError, UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
        raise MapError(f"{path}: {error}") from error
    if not isinstance(content, dict):
        raise MapError(f"{path}: not a map_server file")
    try:
        return _grid(content, path)
    except (KeyError, TypeError, ValueError) as error:
        raise MapError(f"{path}: {type(error).__name__} {error}") from error


def _grid(content: dict[str, Any], path: Path) -> OccupancyGrid:
    mode = str(content.get("mode", "trinary"))
    if mode not in MODES:
        raise ValueError(f"mode {mode[:40]!r} is none of {', '.join(MODES)}")
    file = path.parent / str(content["image"])
    if file.is_absolute() and not file.exists():  # map_saver writes the path at that time
        file = path.parent / file.name
    try:
        data = file.read_bytes()
    except OSError as error:
        raise MapError(f"{file}: cannot be read as an image ({error})") from error
    image, opaque = _decoded(data, str(file))
    resolution = _number(content["resolution"], "resolution")
    x, y, theta = (_number(value, "origin") for value in content["origin"])
    grid = OccupancyGrid(
        image=image,
        transform=MapTransform(resolution, Pose2D(x, y, theta), image.shape[0]),
        negate=_flag(content.get("negate", "0")) and mode != "raw",
        occupied_thresh=_number(content.get("occupied_thresh", "0.65"), "occupied_thresh"),
        free_thresh=_number(content.get("free_thresh", "0.196"), "free_thresh"),
    )
    if mode == "raw":
        percent = np.round(255.0 * (1.0 - np.minimum(image, 100) / 100.0)).astype(np.uint8)
        opaque = (image <= 100) & (opaque if opaque is not None else True)
        grid = replace(grid, image=percent)
    return grid if opaque is None else _with_unknown(grid, ~opaque)


def _number(text: Any, name: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name} {text[:40]!r} is not a finite number")
    return number


def _flag(text: Any) -> bool:
    word = str(text).lower()
    if word not in YES | NO:
        raise ValueError(f"negate {word[:40]!r} is neither 0 nor 1")
    return word in YES


def _with_unknown(grid: OccupancyGrid, unknown: npt.NDArray[np.bool_]) -> OccupancyGrid:
    """Return a map on which these cells are halfway between free and occupied."""
    between = (grid.occupied_thresh + grid.free_thresh) / 2.0
    value = round(255.0 * (between if grid.negate else 1.0 - between))
    return replace(grid, image=np.where(unknown, np.uint8(value), grid.image))


def decode_grey(data: bytes, name: str) -> npt.NDArray[np.uint8]:
    """Return a PNG or PGM as (h, w) uint8; `name` is what errors call it.

    Raises:
        MapError: it is no image, or larger than `MAXIMUM_SIDE`.
    """
    return _decoded(data, name)[0]


def _decoded(data: bytes, name: str) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.bool_] | None]:
    """Return the grey values (h, w), and which of them are opaque, None when all are."""
    import av  # noqa: PLC0415 -- a sixth of the time that a simulator takes to load

    # before it is opened, which unpacks a picture of any size
    _check_size(*_declared_size(data[:HEADER_BYTES], name), name)
    is_png = data.startswith(PNG)
    try:
        plain = io.BytesIO(_plain_png(data) if is_png else data)
        with av.open(plain, "r", format="png_pipe" if is_png else "pgm_pipe") as container:
            frame = next(container.decode(video=0))
    except (OSError, ValueError, zlib.error, av.FFmpegError, StopIteration, IndexError) as error:
        raise MapError(f"{name}: cannot be read as an image ({error})") from error
    _check_size(frame.width, frame.height, name)
    grey = np.ascontiguousarray(frame.to_ndarray(format="gray"), dtype=np.uint8)
    if frame.format.name not in WITH_ALPHA:
        return grey, None
    return grey, frame.to_ndarray(format="rgba")[..., 3] == 255


def _plain_png(data: bytes) -> bytes:
    """Return a PNG with nothing but its picture.

    Raises:
        ValueError: it is cut off, or its picture is longer than its size allows.
        zlib.error: the picture cannot be unpacked.
    """
    width, height = int.from_bytes(data[16:20]), int.from_bytes(data[20:24])
    depth, colour = data[24:26]
    # with the filter bytes of all rows and the padding of the seven interlaced pictures
    left = height * (width * depth * CHANNELS.get(colour, 4) // 8 + 5) + 64
    inflate, kept = zlib.decompressobj(), [PNG]
    for kind, chunk in _chunks(data):
        if kind not in PNG_CHUNKS:
            continue
        kept.append(chunk)
        packed = chunk[8:-4] if kind == b"IDAT" else b""
        while packed and left >= 0:
            left -= len(inflate.decompress(packed, INFLATED_AT_ONCE))
            packed = inflate.unconsumed_tail
    if left < 0:
        raise ValueError("its data are longer than the picture")
    return b"".join(kept)


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield the kind and all bytes of each chunk (ISO/IEC 15948, 5.3) up to the end."""
    start, kind = len(PNG), b""
    while kind != b"IEND":
        kind = data[start + 4 : start + 8]
        end = start + 12 + int.from_bytes(data[start : start + 4])
        if end > len(data) or len(kind) < 4:
            raise ValueError("it is cut off")
        yield kind, data[start:end]
        start = end


def _declared_size(start: bytes, name: str) -> tuple[int, int]:
    """Return (width, height) as the header of a PNG (ISO/IEC 15948, 11.2.2) or PGM file has it.

    FFmpeg also reads PNGs that do not start with IHDR, and many other formats: these are refused,
    because their size is not known.
    """
    if start.startswith(PNG) and start[12:16] == b"IHDR":
        return int.from_bytes(start[16:20]), int.from_bytes(start[20:24])
    found = _PGM.match(start)
    if found is None:
        raise MapError(f"{name}: cannot be read as an image (it is neither PNG nor PGM)")
    return int(found[1]), int(found[2])


def _check_size(width: int, height: int, name: str) -> None:
    if max(width, height) > MAXIMUM_SIDE:
        raise MapError(
            f"{name}: {width} x {height} pixels; at most {MAXIMUM_SIDE} per side are allowed"
        )


def encode_png(image: npt.NDArray[np.uint8]) -> bytes:
    """Return (h, w) grey or (h, w, 3) RGB as a PNG."""
    import av  # noqa: PLC0415 -- as above

    grey = image.ndim == 2
    codec = av.CodecContext.create("png", "w")
    codec.height, codec.width = image.shape[:2]
    codec.pix_fmt = "gray" if grey else "rgb24"
    codec.time_base = Fraction(1)
    frame = av.VideoFrame.from_ndarray(image, format=codec.pix_fmt)
    return b"".join(bytes(packet) for packet in (*codec.encode(frame), *codec.encode(None)))


def write_grid(grid: OccupancyGrid, directory: Path) -> None:
    """Write a map as map.yaml and map.png into a folder.

    Raises:
        OSError: a file cannot be written.
    """
    origin = grid.transform.origin
    lines = [
        "image: map.png",
        f"resolution: {grid.transform.resolution}",
        f"origin: [{origin.x}, {origin.y}, {origin.theta}]",
        f"negate: {int(grid.negate)}",
        f"occupied_thresh: {grid.occupied_thresh}",
        f"free_thresh: {grid.free_thresh}",
    ]
    (directory / "map.png").write_bytes(encode_png(grid.image))
    (directory / "map.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")
