"""A backup: a gzipped tar whose last member, `manifest.json`, has the size and SHA-256 of every
other, so that a truncated backup has no manifest. A restore accepts only members that the manifest
names, and uses none before all of them have been verified.
"""

import hashlib
import io
import json
import os
import tarfile
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, BinaryIO

import msgspec

from robots.api.private_files import draft_of

MANIFEST = "manifest.json"
FORMAT = 1
MAX_MANIFEST = 64 * 1024 * 1024
CHUNK = 1024 * 1024
HEADER = 512  # bytes in the archive for each file beside its content
GB = 1024**3


class BackupError(Exception):
    """A backup cannot be made or restored; the message is one sentence."""

    @property
    def problems(self) -> list[str]:  # for robots.files.limited_process
        return [str(self)]


class FileFacts(msgspec.Struct):
    size: Annotated[int, msgspec.Meta(ge=0)]
    sha256: str


class Manifest(msgspec.Struct):
    format: int
    made_at: str
    engine: str
    migrations: list[str]
    key: str
    files: dict[str, FileFacts]


class _Hashing(io.RawIOBase):
    def __init__(self, file: BinaryIO) -> None:
        self._file, self.digest = file, hashlib.sha256()

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(size)
        self.digest.update(data)
        return data


def write(
    target: Path, members: Iterable[tuple[str, Path]], facts: dict[str, Any]
) -> dict[str, Any]:
    """Write an archive that only its owner can read, and return its manifest.

    Args:
        target: a new file.
        members: (name in the archive, file).
        facts: further fields of the manifest.

    Raises:
        BackupError: the target exists, or a file cannot be read or written.
    """
    if target.exists():
        raise BackupError(
            f"{target} already exists; a backup never overwrites anything. Choose another name."
        )
    try:
        with draft_of(target, replace=False) as file:
            return _write(file, members, facts)
    except (OSError, tarfile.TarError) as error:
        raise BackupError(f"{target} could not be written: {error}.") from error


def _write(
    file: BinaryIO, members: Iterable[tuple[str, Path]], facts: dict[str, Any]
) -> dict[str, Any]:
    files: dict[str, dict[str, Any]] = {}
    with tarfile.open(fileobj=file, mode="w|gz") as archive:
        for name, path in members:
            with path.open("rb") as source:
                info = tarfile.TarInfo(name)
                info.size, info.mode = os.fstat(source.fileno()).st_size, 0o600
                hashing = _Hashing(source)
                archive.addfile(info, hashing)  # it reads, as it must
            files[name] = {"size": info.size, "sha256": hashing.digest.hexdigest()}
        manifest = {"format": FORMAT, **facts, "files": files}
        content = json.dumps(manifest, indent=1).encode()
        info = tarfile.TarInfo(MANIFEST)
        info.size, info.mode = len(content), 0o600
        archive.addfile(info, io.BytesIO(content))
    return manifest


def unpack(source: str, directory: str, largest: int) -> dict[str, Any]:
    """Unpack an archive into an empty directory, verify every file, and return the manifest.

    Raises:
        BackupError: it cannot be read, is damaged, or unpacks to more than `largest` bytes.
    """
    found: dict[str, dict[str, Any]] = {}
    manifest: bytes | None = None
    try:
        with tarfile.open(source, mode="r|gz") as archive:
            for info, content in _regular(archive, largest):
                if manifest is not None:
                    raise BackupError(f"{source} is damaged: it continues after its manifest.")
                if info.name == MANIFEST:
                    manifest = content.read(MAX_MANIFEST)
                else:
                    found[info.name] = _unpack_one(content, Path(directory) / _safe(info.name))
    except (OSError, EOFError, zlib.error, tarfile.TarError, ValueError) as error:
        raise BackupError(f"{source} cannot be read: {error}.") from error
    if manifest is None:
        raise BackupError(
            f"{source} has no manifest: it was cut off, or is not a backup of this software."
        )
    return _checked(source, manifest, found)


def _regular(archive: tarfile.TarFile, largest: int) -> Iterator[tuple[tarfile.TarInfo, BinaryIO]]:
    left = largest
    for info in archive:
        left -= info.size + HEADER
        if left < 0:
            raise BackupError(
                f"The backup unpacks to more than {largest / GB:.3g} GB. If it is yours, allow more"
                " with --largest-gb, and make room in VAR_DIR."
            )
        content = archive.extractfile(info) if info.isreg() else None
        if content is None:
            raise BackupError(f"The backup contains {info.name!r}, which is not a file.")
        yield info, content  # type: ignore[misc]  # IO[bytes]


def _safe(name: str) -> PurePosixPath:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\\" in name or ":" in name or "\0" in name:
        raise BackupError(f"The backup contains {name!r}, which points outside its folder.")
    return path


def _unpack_one(content: BinaryIO, path: Path) -> dict[str, Any]:
    path.parent.mkdir(parents=True, exist_ok=True)
    digest, size = hashlib.sha256(), 0
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        while data := content.read(CHUNK):
            digest.update(data)
            size += file.write(data)
    return {"size": size, "sha256": digest.hexdigest()}


def _checked(source: str, content: bytes, found: dict[str, dict[str, Any]]) -> dict[str, Any]:
    try:
        manifest: Any = msgspec.json.decode(content)
        made_by = manifest.get("format") if isinstance(manifest, dict) else None
        if made_by not in {None, FORMAT}:
            raise BackupError(f"{source} has format {made_by!r:.40}; this version reads {FORMAT}.")
        msgspec.convert(manifest, Manifest)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, TypeError) as error:
        raise BackupError(f"The manifest of {source} cannot be read: {error}.") from error
    wrong = sorted(
        name
        for name in manifest["files"].keys() | found.keys()
        if manifest["files"].get(name) != found.get(name)
    )
    if wrong:
        raise BackupError(
            f"{source} is damaged: {', '.join(wrong[:5])} {'is' if len(wrong) == 1 else 'are'} not"
            " what was written."
        )
    return dict(manifest)
