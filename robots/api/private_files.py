"""Files that only their owner can read, written atomically."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

OWNER_ALONE = 0o600


@contextlib.contextmanager
def draft_of(path: Path, *, mode: int = OWNER_ALONE, replace: bool = True) -> Iterator[BinaryIO]:
    """Yield a file to write, which is moved to `path` afterwards: a reader, also after a power
    failure, finds either the complete file or the previous one.

    Raises:
        FileExistsError: the path exists and `replace` is false.
        OSError: it cannot be written.
    """
    descriptor, draft = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(descriptor, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        Path(draft).chmod(mode)
        if replace:
            Path(draft).replace(path)
        else:
            os.link(draft, path)
    finally:
        Path(draft).unlink(missing_ok=True)


def write_private(path: Path, text: str, *, mode: int = OWNER_ALONE, replace: bool = True) -> None:
    """Write a text with `draft_of`."""
    with draft_of(path, mode=mode, replace=replace) as file:
        file.write(text.encode())
