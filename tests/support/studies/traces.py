"""Searches files, also packed ones, for identifying values of a database."""

import base64
import datetime
import gzip
import io
import json
import re
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyreadstat
from django.apps import apps
from mcap.reader import make_reader

from tests.support.analysis.filled import DIGITS, MARK

_MARKED = re.compile(rf"{MARK}[0-9a-f]{{{DIGITS}}}")
_UUID = re.compile(r"[0-9a-f]{8}-?(?:[0-9a-f]{4}-?){3}[0-9a-f]{12}", re.IGNORECASE)
_HASH = re.compile(r"\b[0-9a-f]{64}\b")
_MAIL = re.compile(r"[\w.+-]+@[\w.-]+\w")
_ADDRESS = re.compile(r"\b\d{1,3}(?:\.\d{1,3}){3}\b")
# A whole number of ten digits and more: a time in seconds, or in smaller parts of one.
_NUMBER = re.compile(rb"(?<![0-9A-Za-z.])\d{10,19}")
DAY = 86_400.0
SECONDS_DIGITS = 10
WINDOW = 8  # bytes that are compared at once
# What an export contains about the study itself and identifies no person.
OF_THE_STUDY = frozenset({"Study.sha256", "Study.published_at"})
LARGEST_ID = 10**8  # smaller numbers identify no row: any count may be equal


@dataclass
class Known:
    """Values to search for, each with its source: `words` in lower case; `exact` with their case;
    `times` in Unix seconds.
    """

    words: dict[bytes, str] = field(default_factory=dict)
    exact: dict[bytes, str] = field(default_factory=dict)
    times: list[float] = field(default_factory=list)

    def add(self, what: str, word: str) -> None:
        self.words[word.lower().encode()] = what

    def take(self, what: str, value: Any) -> None:
        """Add every part of a value that can be recognised."""
        _take(self, what, value)


def known() -> Known:
    """Return the recognisable values of all rows of the database."""
    found = Known()
    for model in apps.get_models():
        for row in model._base_manager.values():
            for name, value in row.items():
                if f"{model.__name__}.{name}" not in OF_THE_STUDY:
                    found.take(f"{model.__name__}.{name}", value)
    return found


def _take(found: Known, what: str, value: Any) -> None:
    match value:
        case uuid.UUID():
            _take_key(found, what, value)
        case bool() | None:
            pass
        case datetime.datetime():
            found.times.append(value.timestamp())
            found.add(f"{what} (a day)", f"{value:%Y-%m-%d}")
            found.add(f"{what} (a day)", f"{value:%Y%m%d}")
        case int() | float():
            if 1e9 <= value < 1e11:
                found.times.append(float(value)) if value < 3e9 else found.add(what, f"{value:.0f}")
            elif isinstance(value, int) and LARGEST_ID < value < 1e12:
                found.add(what, str(value))
        case str():
            _take_text(found, what, value)
        case bytes() | memoryview():
            _take_text(found, what, bytes(value).decode("latin-1"))
        case Mapping():
            for name, one in value.items():
                _take_text(found, f"{what}, a name", name)
                _take(found, f"{what}.{name}", one)
        case list() | tuple():
            for one in value:
                _take(found, what, one)


def _take_text(found: Known, what: str, text: str) -> None:
    for pattern in (_MARKED, _HASH, _ADDRESS):
        for word in pattern.findall(text):
            found.add(what, word)
    for word in _UUID.findall(text):
        _take_key(found, what, uuid.UUID(word))
    for word in _MAIL.findall(text):
        found.add(what, word)
        found.add(f"{what} (before the @)", word.partition("@")[0])
    if what in {"User.username", "User.display_name"} and text:
        found.add(what, text)


def _take_key(found: Known, what: str, key: uuid.UUID) -> None:
    for word in (str(key), key.hex, str(key.int)):
        found.add(what, word)
    for coded in (base64.b64encode(key.bytes), base64.urlsafe_b64encode(key.bytes)):
        found.exact[coded.rstrip(b"=")] = f"{what} (base64)"


# --- to search ------------------------------------------------------------------------------------


def members(name: str, content: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield a file and the files packed in it, with their names."""
    yield name, content
    if content.startswith(b"PK\3\4"):
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            for one in archive.infolist():
                about = f"{one.filename} {one.comment!r} {one.extra!r}"
                yield f"{name}/{one.filename}", about.encode()
                yield from members(f"{name}/{one.filename}", archive.read(one))
    elif content.startswith(b"\x1f\x8b"):
        yield from members(f"{name}/unpacked", gzip.decompress(content))
    elif content.startswith(b"\x89MCAP0"):
        yield f"{name}/messages", b"\n".join(_of_mcap(content))
    elif content.startswith((b"$FL2", b"<stata_dta>")):
        yield f"{name}/table", _of_statistics(content)


def _of_mcap(content: bytes) -> Iterator[bytes]:
    reader = make_reader(io.BytesIO(content))
    for schema, channel, message in reader.iter_messages():
        yield f"{schema.name} {channel.topic} {channel.metadata}".encode()
        yield f"{message.log_time} {message.publish_time}".encode() + b" " + message.data
    for one in reader.iter_metadata():
        yield f"{one.name} {json.dumps(one.metadata)}".encode()
    for attached in reader.iter_attachments():
        yield f"{attached.name} {attached.log_time} {attached.create_time}".encode()
        yield attached.data


def _of_statistics(content: bytes) -> bytes:
    """The values and labels of a file of SPSS or Stata."""
    with tempfile.NamedTemporaryFile() as file:
        file.write(content)
        file.flush()
        is_spss = content.startswith(b"$FL2")
        frame, about = (pyreadstat.read_sav if is_spss else pyreadstat.read_dta)(file.name)
    labels = json.dumps([about.column_labels, [*about.variable_value_labels.values()]])
    return f"{frame.to_csv()}\n{labels}".encode()


def traces(files: Mapping[str, bytes], of: Known) -> list[str]:
    """Return a line for each known value in a file or its name."""
    words, exact = Needles(of.words), Needles(of.exact)
    found = []
    for outer, whole in files.items():
        for name, content in members(outer, whole):
            lower = name.lower().encode() + b"\n" + content.lower()
            found += [f"{name}: {of.words[word]}: {word!r}" for word in words.within(lower)]
            found += [f"{name}: {of.exact[word]}: {word!r}" for word in exact.within(content)]
            found += [f"{name}: a time: {number!r}" for number in _times(content, of.times)]
    return found


class Needles:
    """Searches a text for thousands of words in one pass. Only words whose first bytes occur in the
    text are compared in full.
    """

    def __init__(self, words: Iterable[bytes]) -> None:
        self._long = sorted(word for word in words if len(word) >= WINDOW)
        self._short = [word for word in words if len(word) < WINDOW]
        self._begins = np.array(
            [int.from_bytes(word[:WINDOW], sys.byteorder) for word in self._long], dtype=np.uint64
        )

    def within(self, content: bytes) -> list[bytes]:
        found = [word for word in self._short if word in content]
        if len(content) >= WINDOW and self._long:
            letters = np.frombuffer(content, dtype=np.uint8)
            windows = np.lib.stride_tricks.sliding_window_view(letters, WINDOW)
            there = np.isin(self._begins, np.ascontiguousarray(windows).view(np.uint64))
            candidates = (self._long[index] for index in np.flatnonzero(there))
            found += [word for word in candidates if word in content]
        return found


def _times(content: bytes, times: list[float]) -> Iterator[bytes]:
    least, most = min(times) - DAY, max(times) + DAY
    for number in _NUMBER.findall(content):
        if least <= int(number) / 10.0 ** (len(number) - SECONDS_DIGITS) <= most:
            yield number
