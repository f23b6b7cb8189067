"""Network impairments as text, for command lines and tables:
`delay=150,jitter=30,loss=2,reorder=1,rate=400`.

In milliseconds, percent and kbit/s, which are usual for networks; messages and studies have SI
units and shares.
"""

import math
from typing import Protocol

from robots.api.messages import NetworkLab

MS, PERCENT, KBIT = 1e-3, 1e-2, 1e3
# Of each word: the least and the greatest value, and the unit.
RANGES = {
    "delay": (0.0, 10_000.0, "milliseconds"),
    "jitter": (0.0, 10_000.0, "milliseconds"),
    "loss": (0.0, 100.0, "percent"),
    "reorder": (0.0, 100.0, "percent"),
    "rate": (1.0, 1e6, "kbit/s"),
}
EXAMPLE = "delay=150,jitter=30,loss=2"


class Impairing(Protocol):
    """A `NetworkLab`, or the impairments of a study's condition: delay and jitter in s, loss and
    reorder as shares, bitrate in bit/s.
    """

    @property
    def delay(self) -> float: ...
    @property
    def jitter(self) -> float: ...
    @property
    def loss(self) -> float: ...
    @property
    def reorder(self) -> float: ...
    @property
    def bitrate(self) -> float | None: ...


def parse(text: str, seed: int = 0) -> NetworkLab:
    """Return the impairments that the words describe.

    Raises:
        ValueError: they are not valid; the message is one sentence.
    """
    values: dict[str, float] = {}
    for part in text.split(","):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or name not in RANGES:
            raise ValueError(
                f"{part.strip()!r} is not a network setting: write {EXAMPLE}, using "
                f"{', '.join(RANGES)}"
            )
        if name in values:
            raise ValueError(f"{name} is given twice")
        values[name] = _number(name, value)
    if values.get("jitter", 0.0) > values.get("delay", 0.0):
        raise ValueError(
            "jitter varies the delay both ways, so it cannot be greater than the delay"
        )
    return NetworkLab(
        delay=values.get("delay", 0.0) * MS,
        jitter=values.get("jitter", 0.0) * MS,
        loss=values.get("loss", 0.0) * PERCENT,
        reorder=values.get("reorder", 0.0) * PERCENT,
        bitrate=values["rate"] * KBIT if "rate" in values else None,
        seed=seed,
    )


def spell(network: Impairing | None) -> str:
    """Return the impairments of a network as text, without those that are zero."""
    if network is None:
        return ""
    values = {
        "delay": network.delay / MS,
        "jitter": network.jitter / MS,
        "loss": network.loss / PERCENT,
        "reorder": network.reorder / PERCENT,
        "rate": 0.0 if network.bitrate is None else network.bitrate / KBIT,
    }
    return ",".join(f"{name}={value:.6g}" for name, value in values.items() if value)


def _number(name: str, text: str) -> float:
    least, most, unit = RANGES[name]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise ValueError(
            f"{name} must be a number of {unit} from {least:.0f} to {most:.0f}, not {text!r}"
        )
    return value
