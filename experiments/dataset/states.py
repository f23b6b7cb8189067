"""The columns of states and network samples. A column that is a field of the stored message is
declared on that field; one that is computed from a state's commands, with its formula.

What these classes read is what leaves of the messages in a pseudonymous dataset
(experiments/extraction/allow_list.py).
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from operator import attrgetter
from typing import Annotated, Any

import msgspec
import numpy as np
import numpy.typing as npt

from experiments.dataset.columns import (
    Column,
    Columns,
    Floats,
    amount,
    amount_of,
    column_paths,
    columns_of,
    declared,
    described,
    flag,
    matrix_of,
)
from experiments.dataset.levels import METHODS, MODES, WAYS
from robots.api import docked

DECIMALS = 6
NAN = math.nan
DOCKED = (
    "charger contact, standstill and no velocity from the driver for"
    f" {docked.DOCKED.seconds:g} s, as the robot reports; a robot without contacts decides it by"
    " itself"
)
# The three velocities of a command, and how their columns describe them.
SERIES = {
    "asked": "since the previous state, as the driver requested",
    "allowed": "since then, as limits and age allowed",
    "applied": "since then, as the wheels were told",
}
TOO_OLD = ("stale", "frame_stale")  # reasons of robots/agent/safety/freshness.py
_MODE = {name: number for number, name in enumerate(MODES)}


Known = float | None  # None for what robot or page do not know


class StoredPart(msgspec.Struct, gc=False, rename="camel"):
    """What the columns need of a part of robots.api.messages.State."""


class StoredPose(StoredPart):
    """Where the robot was."""

    x: Annotated[float, described("position on the map", "m")]
    y: Annotated[float, described("position on the map", "m")]
    theta: Annotated[
        float,
        described("heading on the map, counter-clockwise from x", "rad").within(-math.pi, math.pi),
    ]
    localized: Annotated[bool, described("1 when the robot trusts its position")] = True
    score: Annotated[float, amount("localization confidence", greatest=1.0)] = 1.0


class StoredVelocity(StoredPart):
    """A measured velocity, or one of a command, which has no columns of its own."""

    linear: Annotated[float, described("measured speed, forward positive", "m/s")]
    angular: Annotated[float, described("measured turn rate, counter-clockwise positive", "rad/s")]


class StoredBattery(StoredPart):
    """How much charge the robot had."""

    charge: Annotated[Known, amount("share of the battery's charge", greatest=1.0)] = None
    charging: Annotated[bool | None, described("1 while charging")] = False


class StoredCommand(StoredPart):
    """A command that was applied; agents may leave out `asked`, `allowed` and `share`."""

    method: str
    way: str
    age: float
    linear: float = 0.0
    angular: float = 0.0
    frame_age: Known = None
    asked: StoredVelocity | None = None
    allowed: StoredVelocity | None = None
    share: Known = None


class StoredState(StoredPart):
    """A state."""

    stamp: float
    seq: int
    pose: StoredPose
    velocity: StoredVelocity
    battery: StoredBattery
    docked: Annotated[bool, described(f"1 while docked: {DOCKED}")] = False
    tilt: Annotated[Known, described("tilt of the head, positive looks down", "rad")] = None
    mode: str = "manual"
    clearance: Annotated[
        Known, amount("smallest distance to anything since the previous state", "m")
    ] = None
    contacts: Annotated[int, amount("collisions that began since the previous state")] = 0
    distance: Annotated[float, amount("odometer since the run began", "m")] = 0.0
    distance_by_position: Annotated[
        bool,
        described(
            "1 when the odometer only adds up positions, as the robot has no odometry",
            late=True,
            was="by_position",
        ),
    ] = False
    visitor_silence: Annotated[
        Known,
        amount(
            "time since the driver's last sign of life, by the robot's clock", "s", was="silence"
        ),
    ] = None
    applied: list[StoredCommand] = []
    refused: dict[str, int] = {}


class StoredSample(StoredPart):
    """What the columns need of sessions.protocol.PageNetwork."""

    round_trip: Annotated[Known, amount("round trip on the path of the commands", "s")] = None
    loss: Annotated[
        Known, amount("share of the video packets that were lost in this second", greatest=1.0)
    ] = None
    fps: Annotated[Known, amount("video frames shown in this second", "1/s")] = None
    bitrate: Annotated[Known, amount("bit rate of the video", "bit/s")] = None
    freezes: Annotated[Known, amount("freezes of the video in this second")] = None
    jitter: Annotated[Known, amount("jitter of the video packets", "s")] = None
    frame_age: Annotated[Known, described("age of the video frame that was shown", "s")] = None
    way: str | None = None


# --- computed columns -----------------------------------------------------------------------------


class StateBatch:
    """Some states and all their commands: values by command are combined into one by state, (n,).

    A command without a value makes the sum and the mean of its state NaN.
    """

    def __init__(self, states: Sequence[StoredState]) -> None:
        self.states = states
        self.commands = [command for state in states for command in state.applied]
        counts = [len(state.applied) for state in states]
        self.counts = np.array(counts, dtype=np.float64)
        self._owner = np.repeat(np.arange(len(states)), counts)

    @cached_property
    def methods(self) -> list[str]:
        """The input method of each command."""
        return [command.method for command in self.commands]

    @cached_property
    def ways(self) -> list[str]:
        """The control channel of each command."""
        return [command.way for command in self.commands]

    def sum(self, values: npt.ArrayLike) -> Floats:
        """Add up values by command; 0 where a state has none."""
        return _floats(np.bincount(self._owner, _floats(values), len(self.states)))

    def mean(self, values: npt.ArrayLike) -> Floats:
        """Return means; NaN where a state has no commands."""
        return self.sum(values) / np.where(self.counts > 0.0, self.counts, NAN)

    def mean_of_known(self, values: npt.ArrayLike) -> Floats:
        """Return means over the commands that have a value."""
        known = np.isfinite(floats := _floats(values))
        counts = self.sum(known)
        return self.sum(np.where(known, floats, 0.0)) / np.where(counts > 0.0, counts, NAN)

    def greatest(self, values: npt.ArrayLike) -> Floats:
        """Return maxima; NaN where a state has no commands."""
        found = np.full(len(self.states), NAN)
        np.fmax.at(found, self._owner, _floats(values))
        return found

    def mean_velocity(self, series: str, part: str) -> Floats:
        """Return the mean of a velocity of SERIES: its part `linear` or `angular`."""
        if series == "applied":
            return self.mean(read(self.commands, part))
        given = (getattr(command, series) for command in self.commands)
        return self.mean([NAN if one is None else getattr(one, part) for one in given])

    def slowed(self) -> Floats:
        """Count the commands that requested more than their age left of them."""
        return self.sum([_is_slowed(command) for command in self.commands])


def _is_slowed(command: StoredCommand) -> float:
    if command.asked is None or command.allowed is None or command.share is None:
        return NAN
    return float(command.share < 1.0 and command.allowed != command.asked)


def _count(batch: StateBatch, names: str, name: str) -> Floats:
    known = getattr(batch, names)
    kinds = set(known)
    if kinds == {name}:  # as in most drives
        return batch.counts
    if name not in kinds:
        return np.zeros(len(batch.states))
    return batch.sum([one == name for one in known])


def _refused(batch: StateBatch, reasons: Sequence[str] = ()) -> list[int]:
    return [
        sum(count for reason, count in state.refused.items() if not reasons or reason in reasons)
        for state in batch.states
    ]


Formula = Callable[[StateBatch], npt.ArrayLike]
OF_COMMANDS: tuple[tuple[Column, Formula], ...] = (
    (
        Column("mode", "", "what moves the robot, by number").one_of(
            {str(number): name for name, number in _MODE.items()}
        ),
        lambda batch: [_MODE.get(state.mode, NAN) for state in batch.states],
    ),
    (
        amount_of("commands", "", "commands applied since the previous state"),
        lambda batch: batch.counts,
    ),
    (amount_of("refused", "", "commands refused since the previous state"), _refused),
    (
        Column("age_sum", "s", "sum of the ages of the commands applied since the previous state"),
        lambda batch: batch.sum(read(batch.commands, "age")),
    ),
    (
        Column("age_max", "s", "greatest age among them"),
        lambda batch: batch.greatest(read(batch.commands, "age")),
    ),
    (
        Column(
            "answer_age",
            "s",
            "mean age, when they were applied, of the video frames that they answered",
        ),
        lambda batch: batch.mean_of_known(read(batch.commands, "frame_age")),
    ),
    *(
        (
            amount_of(f"by_{method}", "", f"how many of them came from: {method}"),
            partial(_count, names="methods", name=method),
        )
        for method in METHODS
    ),
    *(
        (
            amount_of(f"on_{way}", "", f"how many of them came on: {way}"),
            partial(_count, names="ways", name=way),
        )
        for way in WAYS
    ),
    (
        amount_of(
            "too_old",
            "",
            "commands refused since the previous state because they, or the video frames that they "
            "answered, were too old",
            late=True,
        ),
        partial(_refused, reasons=TOO_OLD),
    ),
    (
        amount_of(
            "slowed",
            "",
            "commands applied since the previous state that the robot slowed down because of such "
            "an age; empty when the robot does not report it",
            late=True,
        ),
        StateBatch.slowed,
    ),
    *(
        (
            Column(
                f"{series}_{part}", unit, f"mean {what} of the commands applied {words}", late=True
            ),
            partial(StateBatch.mean_velocity, series=series, part=part),
        )
        for series, words in SERIES.items()
        for part, unit, what in (("linear", "m/s", "speed"), ("angular", "rad/s", "turn rate"))
    ),
)

STATES = (
    Column(
        "stamp",
        "s",
        "when the robot took the state, since the grant, by the robot's clock; less clock_offset it"
        " is by the server's",
    ),
    Column(
        "received",
        "s",
        "when the server had the states of about a second with this one, since the grant, by the"
        " server's clock",
    ),
    Column("clock_offset", "s", "robot's clock minus the server's, as the server estimated then"),
    amount_of("boot", "", "run of the robot's agent: 0 for the session's first"),
    amount_of("seq", "", "number of the state within the run, from the session's first"),
    *declared(StoredState),
    *(column for column, _ in OF_COMMANDS),
)
NETWORK = (
    Column(
        "stamp",
        "s",
        "when the page took the sample, since the grant, by the page's clock corrected to the"
        " server's: by the least delay of anything that it sent",
    ),
    *declared(StoredSample),
    flag("on_datachannel", "1 when commands went over the data channel, 0 over the server"),
)
NO_STATES, NO_NETWORK = columns_of(STATES), columns_of(NETWORK)


def state_columns(states: Sequence[StoredState], **known: npt.ArrayLike) -> Columns:
    """Return states as STATES; `known` are the columns that depend on when the robot was granted
    and on the run of its agent.
    """
    batch = StateBatch(states)
    fields = {column.name: read(states, path) for path, column in column_paths(StoredState)}
    computed = {column.name: formula(batch) for column, formula in OF_COMMANDS}
    return _rounded(columns_of(STATES, **known, **fields, **computed))


def network_columns(samples: Sequence[StoredSample], stamp: npt.ArrayLike) -> Columns:
    """Return network samples as NETWORK; `stamp` is in seconds since the grant."""
    direct = [NAN if one.way is None else one.way == "datachannel" for one in samples]
    fields = {column.name: read(samples, path) for path, column in column_paths(StoredSample)}
    return _rounded(columns_of(NETWORK, stamp=stamp, on_datachannel=direct, **fields))


def read(records: Iterable[Any], path: str) -> Floats:
    """Return an attribute of records, (n,); None is NaN."""
    return _floats([*map(attrgetter(path), records)])


def _floats(values: npt.ArrayLike) -> Floats:
    return np.asarray(values, dtype=np.float64)


def _rounded(columns: Columns) -> Columns:
    """Round numbers to as many digits as are written, so that reading a file gives the same ones;
    adding zero makes a negative zero positive.
    """
    values = matrix_of(columns)
    values[:] = np.round(values, DECIMALS) + 0.0
    return columns
