"""Classes that several threads read messages and documents into.

msgspec finds out about a class when it is first read into, and two threads that do so at the same
moment crash the process (a segmentation fault in 0.22). A module's import is done by one thread: so
a class is prepared where it is defined.
"""

from typing import Any

import msgspec


def prepare(*kinds: Any) -> None:
    """Let msgspec find out about classes, and about those that they are made of."""
    for kind in kinds:
        msgspec.json.Decoder(kind)
