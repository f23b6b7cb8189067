"""Files as a folder, or as a ZIP archive that is sent while it is made."""

import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from experiments.export.format import File

# No file has the time at which it was made: the same study gives the same archive.
SAME_DAY = (1980, 1, 1, 0, 0, 0)
LEVEL = 4


class _Sink:
    """What an archive writes into: it has no position, so that the archive never goes back."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, data: bytes) -> int:
        self._parts.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Nothing is held back."""

    def taken(self) -> bytes:
        """Return what was written since."""
        found, self._parts = b"".join(self._parts), []
        return found


def zipped(files: Iterable[File]) -> Iterator[bytes]:
    """Yield a ZIP archive of files, as they are made."""
    sink = _Sink()
    with zipfile.ZipFile(
        sink,  # type: ignore[call-overload]
        "w",
        zipfile.ZIP_DEFLATED,
        compresslevel=LEVEL,
    ) as archive:
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
