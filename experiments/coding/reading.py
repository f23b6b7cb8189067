"""A coding from a file of ELAN or of BORIS."""

from collections.abc import Sequence
from typing import Any

import msgspec
from django.utils.translation import gettext as _

from experiments.coding.boris import from_boris
from experiments.coding.eaf import from_eaf
from experiments.coding.scheme import BadCodingError, CodedEvent, events_from
from experiments.definition.coding import Code
from robots.files.limited_process import ImportRefusedError, run_limited


def import_coding(
    document: bytes, codes: Sequence[Code], *, limit: int, duration: float, observation: str = ""
) -> tuple[list[CodedEvent], list[str]]:
    """Return the result of `read_coding`, called in a child process with limits."""
    known = msgspec.to_builtins(codes)
    try:
        found = run_limited(read_plain, document, known, limit, duration, observation)
    except ImportRefusedError as error:
        raise BadCodingError(error.problems) from error
    return msgspec.convert(found, tuple[list[CodedEvent], list[str]])


def read_plain(
    document: bytes, codes: list[Any], limit: int, duration: float, observation: str
) -> Any:
    """Return the result of `read_coding` as plain data; the child process calls this."""
    known = msgspec.convert(codes, tuple[Code, ...])
    found = read_coding(document, known, limit=limit, duration=duration, observation=observation)
    return msgspec.to_builtins(found)


def read_coding(
    document: bytes,
    codes: Sequence[Code],
    *,
    limit: int,
    duration: float | None = None,
    observation: str = "",
) -> tuple[list[CodedEvent], list[str]]:
    """Return the events of a file of at most `limit` bytes in order of time, and a sentence for
    each part that is not imported. `duration` is that of the session in s; None does not check the
    events. `observation` is needed for a BORIS project that has several.

    Raises:
        BadCodingError: the file cannot be read, or an event does not fit.
    """
    if len(document) > limit:
        raise BadCodingError([_("The file is larger than %(n)d MB.") % {"n": limit // 1024**2}])
    if document.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"<"):
        events, left_out = from_eaf(document, codes)
    else:
        events, left_out = from_boris(document, codes, observation)
    if duration is None:
        return events, left_out
    return events_from(msgspec.to_builtins(events), codes, duration), left_out
