"""Classes that several threads decode.

msgspec inspects a class when it is first decoded, and two threads that do so at once crash the
process (a segmentation fault in 0.22). One thread imports a module: so a class is prepared where it
is defined.
"""

from typing import Any

import msgspec


def prepare(*kinds: Any) -> None:
    """Let msgspec inspect classes, and the classes of their fields."""
    for kind in kinds:
        msgspec.json.Decoder(kind)
