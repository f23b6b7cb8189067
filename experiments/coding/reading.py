"""A coding from a file of ELAN or of BORIS."""

from collections.abc import Sequence
from typing import Any

import msgspec
from django.utils.translation import gettext as _

from experiments.coding.boris import from_boris
from experiments.coding.eaf import from_eaf
from experiments.coding.scheme import BadCodingError, ImportedCoding, events_from
from experiments.definition.coding import Code
from robots.files.limited_process import ImportRefusedError, run_limited


def import_coding(
    document: bytes, codes: Sequence[Code], *, limit: int, duration: float, observation: str = ""
) -> ImportedCoding:
    """Return the result of `read_coding`, called in a child process with limits. The events fit
    the codes and the `duration` of the session, in s, or a BadCodingError is raised.
    """
    known = msgspec.to_builtins(codes)
    try:
        found = run_limited(read_plain, document, known, limit, duration, observation)
    except ImportRefusedError as error:
        raise BadCodingError(error.problems) from error
    coding: ImportedCoding = msgspec.convert(found, ImportedCoding)
    return coding


def read_plain(
    document: bytes, codes: list[Any], limit: int, duration: float, observation: str
) -> Any:
    """Return the result of `import_coding` as plain data; the child process calls this."""
    known = msgspec.convert(codes, tuple[Code, ...])
    events, left_out = read_coding(document, known, limit=limit, observation=observation)
    checked = events_from(msgspec.to_builtins(events), known, duration)
    return msgspec.to_builtins((checked, left_out))


def read_coding(
    document: bytes, codes: Sequence[Code], *, limit: int, observation: str = ""
) -> ImportedCoding:
    """Return the unchecked events of a file of at most `limit` bytes; one that cannot be read is a
    BadCodingError. `observation` is needed for a BORIS project that has several.
    """
    if len(document) > limit:
        raise BadCodingError([_("The file is larger than %(n)d MB.") % {"n": limit // 1024**2}])
    if document.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"<"):
        return from_eaf(document, codes)
    return from_boris(document, codes, observation)
