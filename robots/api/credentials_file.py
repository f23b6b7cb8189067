"""The TOML file with an agent's credentials, which the site writes, and the agent reads and renews.
Only its owner can read it, and a write replaces the whole file.
"""

import errno
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

# prefix of environment variables with the same values, such as TELEPRESENCE_TOKEN for `token`
ENVIRONMENT = "TELEPRESENCE_"


def toml(lines: Mapping[str, str]) -> str:
    """Return `name = "value"` lines."""
    return "".join(f"{name} = {_quoted(value)}\n" for name, value in lines.items())


def _quoted(value: str) -> str:
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


def check_writable(path: Path) -> None:
    """Raise OSError if the file could not be written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=path.parent) as file:
        os.fsync(file.fileno())
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))


def changed(text: str, values: Mapping[str, str]) -> str:
    """Return a credentials file with other values; the rest (options, comments, tables) stays."""
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
