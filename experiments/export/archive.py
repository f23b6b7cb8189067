"""Files as a folder, or as a ZIP archive that is sent while it is made."""

import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

File = tuple[str, Iterable[bytes]]  # a path, and the content in parts

# Files have no time of their own, so that the same study gives the same archive.
SAME_DAY = (1980, 1, 1, 0, 0, 0)
LEVEL = 4


class _Sink:
    """A file without a position, so that the archive only appends."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, data: bytes) -> int:
        self._parts.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Do nothing: `taken` returns everything at once."""

    def taken(self) -> bytes:
        found, self._parts = b"".join(self._parts), []
        return found


def zipped(files: Iterable[File]) -> Iterator[bytes]:
    sink = _Sink()
    options = {"compression": zipfile.ZIP_DEFLATED, "compresslevel": LEVEL}
    with zipfile.ZipFile(sink, "w", **options) as archive:  # type: ignore[call-overload]
        for name, parts in files:
            about = zipfile.ZipInfo(name, SAME_DAY)
            about.compress_type = zipfile.ZIP_DEFLATED
            about.external_attr = 0o644 << 16
            with archive.open(about, "w", force_zip64=True) as out:
                for part in parts:
                    out.write(part)
                    yield sink.taken()
    yield sink.taken()


def unpacked(files: Iterable[File], folder: Path) -> Iterator[Path]:
    """Write files into a folder, and yield each once it is written."""
    for name, parts in files:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as out:
            out.writelines(parts)
        yield path
