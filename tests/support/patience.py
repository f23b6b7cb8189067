"""How long a test waits before it calls something broken.

A machine with much else to do is slower, not wrong. Waiting costs nothing where the awaited comes,
so every wait is generous, and what must be quick is measured in the benchmarks.
"""

FACTOR = 4.0
# s after pressing to drive, from which a turn that comes has to be accepted by pressing again
PRESSED = 5.5
# s that a key is held before it is pressed anew: a page whose link is replaced lets go of every key
HELD = 8.0


def patient(seconds: float) -> float:
    """How long to wait for what takes up to `seconds` on a machine with nothing else to do."""
    return seconds * FACTOR
