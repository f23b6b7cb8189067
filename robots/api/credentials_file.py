"""The file with an agent's credentials, which the site writes and the agent reads and renews: TOML
that its owner alone can read, replaced whole.
"""

import errno
import os
from collections.abc import Mapping
from pathlib import Path

# environment variables that begin so say the same, `TELEPRESENCE_TOKEN` for `token`
ENVIRONMENT = "TELEPRESENCE_"


def toml(lines: Mapping[str, str]) -> str:
    """Return `name = "value"` lines."""
    return "".join(f"{name} = {_quoted(value)}\n" for name, value in lines.items())


def _quoted(value: str) -> str:
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


def keep(path: Path, text: str) -> None:
    """Write the file so that it is either the old one or the new one whenever the power fails, and
    never readable by others.

    Raises:
        OSError: it cannot be written.
    """
    _written(path, text).replace(path)


def rehearse(path: Path) -> None:
    """Do everything of `keep` but to put the file in its place.

    Raises:
        OSError: it could not be written.
    """
    _written(path, "").unlink()
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))


def _written(path: Path, text: str) -> Path:
    """Return where the text stands whole, beside the file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f"{path.name}.new")
    unfinished.unlink(missing_ok=True)  # of a write that was cut short, perhaps with other rights
    descriptor = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    return unfinished


def changed(text: str, values: Mapping[str, str]) -> str:
    """Return a credentials file with other values on its own lines, and everything else (options,
    comments, tables) as it was.
    """
    left = dict(values)
    lines, in_table = [], False
    for line in text.splitlines():
        name = line.partition("=")[0].strip()
        in_table = in_table or line.lstrip().startswith("[")
        if not in_table and name in left:
            lines.append(f"{name} = {_quoted(left.pop(name))}")
        else:
            lines.append(line)
    return toml(left) + "".join(f"{line}\n" for line in lines)
