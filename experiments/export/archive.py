"""Files as a folder, or as a ZIP archive that is sent while it is made."""

import zipfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import IO, Any

from experiments.export.format import File

# no file says when it was made: the same study gives the same archive
SAME_DAY = (1980, 1, 1, 0, 0, 0)
LEVEL = 4
# parts that are made while one is packed: of a session's record there are two, and more would only
# take memory
AHEAD = 3


class _Sink:
    """What an archive writes into, and another thread takes from: it has no position, so that the
    archive never goes back.
    """

    def __init__(self) -> None:
        self._parts: deque[bytes] = deque()

    def write(self, data: bytes) -> int:
        """Take a part."""
        self._parts.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Nothing is held back."""

    def taken(self) -> bytes:
        """Return what was written since."""
        return b"".join(self._parts.popleft() for _ in range(len(self._parts)))


class _Writer:
    """One file of an archive after the other."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self._out: IO[bytes] | None = None

    def begin(self, name: str) -> None:
        """Open the next file; the one before it is whole."""
        self.close()
        about = zipfile.ZipInfo(name, SAME_DAY)
        about.compress_type = zipfile.ZIP_DEFLATED
        about.external_attr = 0o644 << 16
        self._out = self._archive.open(about, "w", force_zip64=True)

    def write(self, part: bytes) -> None:
        """Pack a part of it."""
        assert self._out is not None
        self._out.write(part)

    def close(self) -> None:
        """The file that is open is whole, or nobody wants it any more."""
        if self._out is not None:
            self._out.close()
            self._out = None


def zipped(files: Iterable[File]) -> Iterator[bytes]:
    """Yield a ZIP archive of files, as they are made. They are made in this thread, and packed in
    another one meanwhile.
    """
    sink, packing = _Sink(), deque[Future[None]]()
    with (
        zipfile.ZipFile(
            sink,  # type: ignore[call-overload]
            "w",
            zipfile.ZIP_DEFLATED,
            compresslevel=LEVEL,
        ) as archive,
        closing(_Writer(archive)) as writer,
        ThreadPoolExecutor(1, "zip") as thread,
    ):
        for step in _steps(writer, files):
            packing.append(thread.submit(step))
            while len(packing) > AHEAD:
                packing.popleft().result()
            if found := sink.taken():
                yield found
        while packing:
            packing.popleft().result()
    yield sink.taken()


def _steps(writer: _Writer, files: Iterable[File]) -> Iterator[Callable[[], Any]]:
    for name, parts in files:
        yield partial(writer.begin, name)
        for part in parts:
            yield partial(writer.write, part)


def unpacked(files: Iterable[File], folder: Path) -> Iterator[Path]:
    """Write files into a folder, and yield each once it is written."""
    for name, parts in files:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as out:
            out.writelines(parts)
        yield path
