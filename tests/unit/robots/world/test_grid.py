"""Valid and invalid files of map_server."""

import io
import struct
import zlib
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from robots.world.grid import PNG, MapError, decode_grey, encode_png, load_grid

GOOD = {"image": "map.png", "resolution": "0.05", "origin": "[-1.0, -2.0, 0.0]", "negate": "0"}


def write(folder: Path, picture: np.ndarray | None, **changes: str) -> Path:
    if picture is not None:
        (folder / "map.png").write_bytes(encode_png(picture))
    lines = [f"{key}: {value}" for key, value in {**GOOD, **changes}.items() if value != "-"]
    (folder / "map.yaml").write_text("\n".join(lines), encoding="utf-8")
    return folder / "map.yaml"


IMAGE = np.array([[0, 254, 205], [254, 254, 0]], dtype=np.uint8)


def test_black_is_occupied_white_is_free_grey_is_neither(tmp_path: Path) -> None:
    grid = load_grid(write(tmp_path, IMAGE))
    assert grid.occupied().tolist() == [[True, False, False], [False, False, True]]
    assert grid.free().tolist() == [[False, True, False], [True, True, False]]
    assert grid.transform.to_world(0, 2) == pytest.approx((-1.0, -2.0))


def test_negate_turns_black_into_free(tmp_path: Path) -> None:
    grid = load_grid(write(tmp_path, IMAGE, negate="1"))
    assert grid.free()[0, 0]
    assert grid.occupied()[0, 1]


def test_a_pgm_as_map_saver_writes_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "map.pgm").write_bytes(b"P5\n3 2\n255\n" + IMAGE.tobytes())
    grid = load_grid(write(tmp_path, None, image="map.pgm"))
    assert np.array_equal(grid.image, IMAGE)


@pytest.mark.parametrize(
    "changes",
    [
        {"image": "gone.png"},
        {"image": "-"},
        {"resolution": "-"},
        {"resolution": "0"},
        {"resolution": "wide"},
        {"resolution": ".nan"},
        {"origin": "[0, 0]"},
        {"origin": "[0, 0, north]"},
        {"origin": "7"},
    ],
)
def test_a_broken_file_is_refused_with_its_name(tmp_path: Path, changes: dict[str, str]) -> None:
    with pytest.raises(MapError, match=str(tmp_path)):
        load_grid(write(tmp_path, IMAGE, **changes))


def test_a_file_that_is_no_map_is_refused(tmp_path: Path) -> None:
    for text in ("- a list", "image: [", "", "\x00\x01", "[" * 500):
        (tmp_path / "map.yaml").write_text(text, encoding="utf-8")
        with pytest.raises(MapError):
            load_grid(tmp_path / "map.yaml")
    with pytest.raises(MapError):
        load_grid(tmp_path / "nowhere.yaml")


def test_a_malformed_image_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.png").write_bytes(b"not a picture at all")
    with pytest.raises(MapError, match=r"map\.png"):
        load_grid(write(tmp_path, None))


def test_png_survives_encoding_and_decoding(tmp_path: Path) -> None:
    image = np.random.default_rng(1).integers(0, 256, (37, 53), dtype=np.uint8)
    (tmp_path / "x.png").write_bytes(encode_png(image))
    assert np.array_equal(decode_grey((tmp_path / "x.png").read_bytes(), "x.png"), image)


def chunk(kind: bytes, content: bytes) -> bytes:
    part = kind + content
    return struct.pack(">I", len(content)) + part + struct.pack(">I", zlib.crc32(part))


def png_of(width: int, height: int, data: bytes = b"", first: bytes = b"", lace: int = 0) -> bytes:
    """Return a PNG with this size in its header; `first` are chunks in front of the header."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, lace))
    return PNG + first + header + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")


TOO_LARGE, UNREADABLE = "at most 8192", "the map: cannot be read"


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (png_of(16_000, 16_000), TOO_LARGE),
        (b"P5\n# a map\n20000 20000\n255\n", TOO_LARGE),
        (b"P2 9000 1 255\n", TOO_LARGE),
        (png_of(16_000, 16_000, first=chunk(b"tEXt", b"size\0" + bytes(11))), UNREADABLE),
        (PNG, UNREADABLE),
        (b"P5\n#" + b"-" * 5000 + b"\n20000 20000\n255\n", UNREADABLE),
        (b"P5 1 00000000020000\n255\n", UNREADABLE),
        (b"P6\n20000 20000\n255\n", UNREADABLE),
        (b"BM" + struct.pack("<IIIIii", 54, 0, 54, 40, 20_000, 20_000) + bytes(28), UNREADABLE),
    ],
)
def test_an_image_without_a_size_or_with_too_large_a_size_is_never_decoded(
    image: bytes, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("av.open", lambda *_: pytest.fail("it was opened"))
    with pytest.raises(MapError, match=words):
        decode_grey(image, "the map")


def test_an_image_that_was_moved_with_its_file_is_found_beside_it(tmp_path: Path) -> None:
    grid = load_grid(write(tmp_path, IMAGE, image="/home/somebody/catkin_ws/maps/map.png"))
    assert np.array_equal(grid.image, IMAGE)


def test_in_mode_raw_values_are_percentages_and_above_100_unknown(
    tmp_path: Path,
) -> None:
    picture = np.array([[0, 100, 101], [66, 10, 255]], dtype=np.uint8)
    grid = load_grid(write(tmp_path, picture, mode="raw", negate="1"))
    assert grid.occupied().tolist() == [[False, True, False], [True, False, False]]
    assert grid.free().tolist() == [[True, False, False], [False, True, False]]


def test_in_mode_scale_values_between_the_thresholds_are_unknown(tmp_path: Path) -> None:
    picture = np.array([[254, 128, 0]], dtype=np.uint8)
    grid = load_grid(write(tmp_path, picture, mode="scale"))
    assert grid.free().tolist() == [[True, False, False]]
    assert grid.occupied().tolist() == [[False, False, True]]


def test_another_mode_is_refused_by_its_name(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="mode 'ternary' is none of trinary, scale, raw"):
        load_grid(write(tmp_path, IMAGE, mode="ternary"))


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", ["0", "1"])
def test_transparent_pixels_are_unknown(tmp_path: Path, mode: str, negate: str) -> None:
    grey = np.array([[0, 254, 0, 254]], dtype=np.uint8)
    alpha = np.array([[255, 255, 0, 127]], dtype=np.uint8)
    Image.fromarray(np.dstack([grey, grey, grey, alpha])).save(tmp_path / "map.png")
    grid = load_grid(write(tmp_path, None, mode=mode, negate=negate))
    known = (grid.free() | grid.occupied())[0].tolist()
    assert known[:2] == [True, mode != "raw"]  # 254 percent is unknown
    assert known[2:] == [False, False]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &a [x, x]\nmode: [*a, *a]\n", "aliases"),
        ("resolution: " + "9" * 60_000, "resolution '9999"),
        ("resolution: " + ":".join(["59"] * 300), "resolution '59:59"),
        ("mode: " + "x" * 60_000, "mode 'xxx"),
        ("negate: maybe", "negate 'maybe'"),
    ],
)
def test_a_yaml_file_that_unpacks_to_more_is_refused_in_a_short_sentence(
    tmp_path: Path, text: str, words: str
) -> None:
    path = write(tmp_path, IMAGE)
    path.write_text(f"{path.read_text()}\n{text}")
    with pytest.raises(MapError, match=words) as refused:
        load_grid(path)
    assert len(str(refused.value)) < 500


@pytest.mark.parametrize("kind", [b"zTXt", b"iCCP", b"iTXt", b"eXIf"])
def test_other_chunks_of_a_png_are_never_decompressed(
    kind: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    bomb = chunk(kind, b"name\0\0" + zlib.compress(bytes(10_000_000)))
    image = encode_png(IMAGE)
    bombed = image[:33] + bomb + image[33:]  # behind IHDR
    opened: list[int] = []
    av_open = av.open

    def spy(file: io.BytesIO, *args: str, **options: str) -> object:
        opened.append(len(file.getvalue()))
        return av_open(file, *args, **options)

    monkeypatch.setattr("av.open", spy)
    assert np.array_equal(decode_grey(bombed, "the map"), IMAGE)
    assert opened[0] <= len(image)


def test_picture_data_longer_than_the_picture_are_refused() -> None:
    with pytest.raises(MapError, match="longer than the picture"):
        decode_grey(png_of(3, 2, bytes(10_000_000)), "the map")


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "I;16"])
@pytest.mark.parametrize("side", [1, 3, 9, 33])
def test_pngs_of_every_kind_are_no_longer_than_their_picture(mode: str, side: int) -> None:
    file = io.BytesIO()
    Image.new(mode, (side, side + 1)).save(file, "png")
    assert decode_grey(file.getvalue(), "the map").shape == (side + 1, side)


def test_an_interlaced_png_is_read() -> None:
    rows = [(0, 8, 0, 8), (0, 8, 4, 8), (4, 8, 0, 4), (0, 4, 2, 4), (2, 4, 0, 2), (0, 2, 1, 2)]
    picture = np.arange(35, dtype=np.uint8).reshape(5, 7) * 7
    passes = [picture[top::down, left::right] for top, down, left, right in [*rows, (1, 2, 0, 1)]]
    data = b"".join(b"\0" + row.tobytes() for one in passes if one.size for row in one)
    assert np.array_equal(decode_grey(png_of(7, 5, data, lace=1), "the map"), picture)
