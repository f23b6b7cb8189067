"""The columns of states and network samples. A column that is a field of the stored message is
declared on that field.

A pseudonymous dataset has of these messages what the classes read, and nothing else
(experiments/extraction/allow_list.toml).
"""

import math
from collections.abc import Iterable, Sequence
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
_MODES = {str(number): name for number, name in enumerate(MODES)}
Known = float | None  # None for what robot or page do not know
HALF_TURN = {"least": -math.pi, "greatest": math.pi}


class StoredPart(msgspec.Struct, gc=False, rename="camel"):
    """The fields of a part of robots.api.messages.State that columns need."""


class StoredPose(StoredPart):
    x: Annotated[float, described("position on the map", "m")]
    y: Annotated[float, described("position on the map", "m")]
    theta: Annotated[
        float, described("heading on the map, counter-clockwise from x", "rad", **HALF_TURN)
    ]
    localized: Annotated[bool, described("1 when the robot trusts its position")] = True
    score: Annotated[float, amount("localization confidence", greatest=1.0)] = 1.0


class StoredVelocity(StoredPart):
    """A measured velocity, or one of a command, which has no columns of its own."""

    linear: Annotated[float, described("measured speed, forward positive", "m/s")]
    angular: Annotated[float, described("measured turn rate, counter-clockwise positive", "rad/s")]


class StoredBattery(StoredPart):
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
    """The fields of sessions.protocol.PageNetwork that columns need."""

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


OF_COMMANDS = (
    Column("mode", "", "what moves the robot, by number", levels=_MODES),
    amount_of("commands", "", "commands applied since the previous state"),
    amount_of("refused", "", "commands refused since the previous state"),
    Column("age_sum", "s", "sum of the ages of the commands applied since the previous state"),
    Column("age_max", "s", "greatest age among them"),
    Column(
        "answer_age",
        "s",
        "mean age, when they were applied, of the video frames that they answered",
    ),
    *(amount_of(f"by_{method}", "", f"how many of them came from: {method}") for method in METHODS),
    *(amount_of(f"on_{one}", "", f"how many of them came on: {one}") for one in WAYS),
    amount_of(
        "too_old",
        "",
        "commands refused since the previous state because they, or the video frames that they "
        "answered, were too old",
        late=True,
    ),
    amount_of(
        "slowed",
        "",
        "commands applied since the previous state that the robot slowed down because of such "
        "an age; empty when the robot does not report it",
        late=True,
    ),
    *(
        Column(f"{series}_{part}", unit, f"mean {what} of the commands applied {words}", late=True)
        for series, words in SERIES.items()
        for part, unit, what in (("linear", "m/s", "speed"), ("angular", "rad/s", "turn rate"))
    ),
)


class StateBatch:
    """Some states and all their commands: values by command are combined into one by state, (n,). A
    command without a value makes the sum and the mean of its state NaN.
    """

    def __init__(self, states: Sequence[StoredState]) -> None:
        self._states = states
        self._commands = [command for state in states for command in state.applied]
        counts = [len(state.applied) for state in states]
        self._counts, self._owner = _floats(counts), np.repeat(np.arange(len(states)), counts)

    def columns(self) -> dict[str, npt.ArrayLike]:
        """Return OF_COMMANDS by name."""
        ages = read(self._commands, "age")
        methods = [command.method for command in self._commands]
        ways = [command.way for command in self._commands]
        refusals = [state.refused for state in self._states]
        return {
            "mode": [_MODE.get(state.mode, NAN) for state in self._states],
            "commands": self._counts,
            "refused": [sum(refused.values()) for refused in refusals],
            "age_sum": self.sum(ages),
            "age_max": self.greatest(ages),
            "answer_age": self.mean_of_known(read(self._commands, "frame_age")),
            **{f"by_{method}": self.count(methods, method) for method in METHODS},
            **{f"on_{one}": self.count(ways, one) for one in WAYS},
            "too_old": [sum(refused.get(reason, 0) for reason in TOO_OLD) for refused in refusals],
            "slowed": self.sum([_is_slowed(command) for command in self._commands]),
            **{f"{one}_linear": self.mean_velocity(one, "linear") for one in SERIES},
            **{f"{one}_angular": self.mean_velocity(one, "angular") for one in SERIES},
        }

    def sum(self, values: npt.ArrayLike) -> Floats:
        """Add up values by command; 0 where a state has none."""
        return _floats(np.bincount(self._owner, _floats(values), len(self._states)))

    def mean(self, values: npt.ArrayLike) -> Floats:
        """Return means; NaN where a state has no commands."""
        return self.sum(values) / np.where(self._counts > 0.0, self._counts, NAN)

    def mean_of_known(self, values: npt.ArrayLike) -> Floats:
        """Return means over the commands that have a value."""
        known = np.isfinite(floats := _floats(values))
        counts = self.sum(known)
        return self.sum(np.where(known, floats, 0.0)) / np.where(counts > 0.0, counts, NAN)

    def greatest(self, values: npt.ArrayLike) -> Floats:
        """Return maxima; NaN where a state has no commands."""
        found = np.full(len(self._states), NAN)
        np.fmax.at(found, self._owner, _floats(values))
        return found

    def count(self, words: Sequence[str], word: str) -> Floats:
        """Count the commands with a word, fast where they all have it, as in most drives."""
        kinds = set(words)
        if kinds == {word}:
            return self._counts
        if word not in kinds:
            return np.zeros(len(self._states))
        return self.sum([one == word for one in words])

    def mean_velocity(self, series: str, part: str) -> Floats:
        """Return the mean of a velocity of SERIES: its part `linear` or `angular`."""
        if series == "applied":
            return self.mean(read(self._commands, part))
        given = (getattr(command, series) for command in self._commands)
        return self.mean([NAN if one is None else getattr(one, part) for one in given])


def _is_slowed(command: StoredCommand) -> float:
    """Return 1 for a command that requested more than its age left of it, NaN when unknown."""
    if command.asked is None or command.allowed is None or command.share is None:
        return NAN
    return float(command.share < 1.0 and command.allowed != command.asked)


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
    *OF_COMMANDS,
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
    fields = {column.name: read(states, path) for path, column in column_paths(StoredState)}
    return _rounded(columns_of(STATES, **known, **fields, **StateBatch(states).columns()))


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
