"""The stored states and network samples of a session as columns of numbers, read a session at a
time.

Times are seconds since the grant, to the microsecond. What of a message is read here stands in
experiments/dataset/allow_list.py, too.
"""

from collections.abc import Iterable, Iterator, Sequence

import msgspec
import numpy as np
import numpy.typing as npt
from django.db.models import ExpressionWrapper, F

from experiments.analysis.dataset.columns import NETWORK, STATES
from experiments.analysis.dataset.levels import METHODS, MODES, WAYS
from experiments.analysis.dataset.records import Columns, Floats
from experiments.dataset.forms import NEAR
from experiments.stored_states import Decoded, StateReader, StoredChunk
from sessions.models import NetworkSample

DECIMALS = 6
NAN = float("nan")
_MODE = {name: float(number) for number, name in enumerate(MODES)}
ABOUT = ("received", "clock_offset", "boot")
SUMMED = (
    "age_sum",
    "age_max",
    "answer_age",
    *(f"by_{name}" for name in METHODS),
    *(f"on_{name}" for name in WAYS),
)
TOO_OLD = ("stale", "frame_stale")  # reasons of robots/agent/safety/freshness.py
LATE = tuple(column.name for column in STATES if column.late)
# their places in SUMMED
_COUNTED = {name: index for index, name in enumerate((*METHODS, *WAYS), start=3)}


class StoredPart(msgspec.Struct, gc=False, rename="camel"):
    """What the columns need of a part of robots.api.messages.State."""


class StoredPose(StoredPart):
    """Where it was."""

    x: float
    y: float
    theta: float
    localized: bool = True
    score: float = 1.0


class StoredVelocity(StoredPart):
    """How fast it was."""

    linear: float
    angular: float


class StoredBattery(StoredPart):
    """How much charge it had; None for what the robot did not know."""

    charge: float | None = None
    charging: bool | None = False


class Command(StoredPart):
    """A command that was applied."""

    method: str
    way: str
    age: float
    linear: float = 0.0
    angular: float = 0.0
    frame_age: float | None = None
    asked: StoredVelocity | None = None
    allowed: StoredVelocity | None = None
    share: float | None = None


class StoredState(StoredPart):
    """A state."""

    stamp: float
    seq: int
    pose: StoredPose
    velocity: StoredVelocity
    battery: StoredBattery
    docked: bool = False
    tilt: float | None = None
    mode: str = "manual"
    clearance: float | None = None
    contacts: int = 0
    distance: float = 0.0
    distance_by_position: bool = False
    visitor_silence: float | None = None
    applied: list[Command] = []
    refused: dict[str, int] = {}


class Sample(StoredPart):
    """A network sample: what the columns need of sessions.protocol.PageNetwork, in their order."""

    round_trip: float | None = None
    loss: float | None = None
    fps: float | None = None
    bitrate: float | None = None
    freezes: float | None = None
    jitter: float | None = None
    frame_age: float | None = None
    way: str | None = None


STORED, SAMPLE = StateReader(StoredState), Decoded(Sample)


def states_of(session: object, granted: float) -> Columns:
    """Return the states of a session, (n, columns.STATES), run by run and in order within each;
    `granted` is Unix time in seconds.
    """
    states: list[StoredState] = []
    about: list[tuple[float | None, ...]] = []
    rows: list[tuple[float | None, ...]] = []
    for own, begin, first_seq, found in _chunks(session, granted):
        states += found
        about += [own] * len(found)
        rows += [_row(state, begin, first_seq) for state in found]
    whole = [
        _table(about, len(ABOUT)),
        _table(rows, len(STATES) - len(ABOUT) - len(SUMMED) - len(LATE)),
        _commands(states),
        _table([_late(state) for state in states], len(LATE)),
    ]
    # As in columns.STATES: the stamp stands before what is known of the chunk.
    values = np.hstack((whole[1][:, :1], whole[0], whole[1][:, 1:], *whole[2:]))
    return Columns(STATES, _exact(values))


def _chunks(
    session: object, granted: float
) -> Iterator[tuple[tuple[float | None, ...], float, int, list[StoredState]]]:
    """Yield what is known of each chunk (ABOUT), where its times and its counts begin, and its
    states. Counts begin with the session, because a robot's own would lead to its other records.
    """
    chunks = list(STORED.chunks_of(session))
    runs = {
        boot: float(number)
        for number, boot in enumerate(dict.fromkeys(chunk.boot for chunk in chunks))
    }
    first: dict[str, int] = {}
    wrong: dict[str, float] = {}
    for chunk in sorted(chunks, key=lambda chunk: (runs[chunk.boot], chunk.first_seq)):
        first.setdefault(chunk.boot, chunk.first_seq)
        error = wrong.setdefault(chunk.boot, _clock_error(chunk))
        offset = None if chunk.clock_offset is None else chunk.clock_offset - error
        about = (chunk.received_at - granted, offset, runs[chunk.boot])
        yield about, granted + error, first[chunk.boot], chunk.states


def _clock_error(chunk: StoredChunk[StoredState]) -> float:
    """Return by how much the clock of a run differs from the server's where nobody has set it: the
    difference would tell the date. 0 for any other clock.
    """
    error = chunk.states[0].stamp - chunk.received_at if chunk.states else 0.0
    return error if abs(error) >= NEAR else 0.0


def _row(state: StoredState, begin: float, first_seq: int) -> tuple[float | None, ...]:
    pose, velocity, battery = state.pose, state.velocity, state.battery
    return (
        state.stamp - begin,
        state.seq - first_seq,
        pose.x,
        pose.y,
        pose.theta,
        pose.localized,
        pose.score,
        velocity.linear,
        velocity.angular,
        battery.charge,
        battery.charging,
        state.docked,
        state.tilt,
        _MODE.get(state.mode),
        state.clearance,
        state.contacts,
        state.distance,
        state.visitor_silence,
        len(state.applied),
        sum(state.refused.values()) if state.refused else 0,
    )


def _late(state: StoredState) -> tuple[float | None, ...]:
    """Return the values of the LATE columns; of the series, means over the commands."""
    refused = sum(state.refused.get(reason, 0) for reason in TOO_OLD) if state.refused else 0
    applied = state.applied
    if not applied:
        return (state.distance_by_position, refused, 0, *(None,) * 6)
    if any(one.asked is None or one.allowed is None or one.share is None for one in applied):
        slowed, before = None, (None,) * 4
    else:
        slowed = sum(_is_slowed(one) for one in applied)
        before = (
            *_mean(one.asked for one in applied if one.asked is not None),
            *_mean(one.allowed for one in applied if one.allowed is not None),
        )
    return (state.distance_by_position, refused, slowed, *before, *_mean(applied))


def _is_slowed(command: Command) -> bool:
    """Tell whether a command asked for more than its age left of it."""
    return command.share is not None and command.share < 1.0 and command.allowed != command.asked


def _mean(found: Iterable[StoredVelocity | Command]) -> tuple[float, float]:
    values = [(one.linear, one.angular) for one in found]
    return (
        sum(linear for linear, _ in values) / len(values),
        sum(angular for _, angular in values) / len(values),
    )


def _commands(states: Sequence[StoredState]) -> Floats:
    """Return sum and maximum of the ages of each state's commands, the mean age of their pictures,
    and counts by method and way.

    (n, SUMMED), of all states at once.
    """
    found = np.zeros((len(states), len(SUMMED)))
    found[:, 1:3] = NAN
    commands = [command for state in states for command in state.applied]
    if commands:
        owner = np.repeat(np.arange(len(states)), [len(state.applied) for state in states])
        ages = np.array([command.age for command in commands])
        found[:, 0] = np.bincount(owner, ages, len(states))
        np.fmax.at(found[:, 1], owner, ages)
        _answer_ages(
            found[:, 2],
            owner,
            np.array([command.frame_age for command in commands], dtype=np.float64),
        )
        for names in (
            [command.method for command in commands],
            [command.way for command in commands],
        ):
            kinds = set(names)
            for kind in kinds & _COUNTED.keys():
                # mostly all came from one and on one
                own = owner if len(kinds) == 1 else owner[[name == kind for name in names]]
                found[:, _COUNTED[kind]] = np.bincount(own, minlength=len(states))
    return found


def _answer_ages(found: Floats, owner: npt.NDArray[np.intp], ages: Floats) -> None:
    """Write the mean of the ages of each state that has any; a command that answered no picture has
    none (NaN).
    """
    known = np.isfinite(ages)
    counts = np.bincount(owner[known], minlength=len(found))
    sums = np.bincount(owner[known], ages[known], len(found))
    found[counts > 0] = sums[counts > 0] / counts[counts > 0]


def network_of(session: object, granted: float, clock_offset: float) -> Columns:
    """Return the network samples of a session, (n, columns.NETWORK); `clock_offset` is the page's
    clock minus the server's, in seconds.
    """
    rows = NetworkSample.objects.filter(session=session).annotate(
        stored=ExpressionWrapper(F("data"), output_field=SAMPLE)
    )
    found = rows.order_by("stamp", "id").values_list("stamp", "stored")
    return Columns(
        NETWORK,
        _exact(
            _table(
                [_sample(stamp - clock_offset - granted, sample) for stamp, sample in found],
                len(NETWORK),
            )
        ),
    )


def _sample(at: float, found: Sample) -> tuple[float | None, ...]:
    way = None if found.way is None else float(found.way == "datachannel")
    return (
        at,
        found.round_trip,
        found.loss,
        found.fps,
        found.bitrate,
        found.freezes,
        found.jitter,
        found.frame_age,
        way,
    )


def _table(rows: list[tuple[float | None, ...]], width: int) -> Floats:
    """None becomes NaN."""
    return np.array(rows, dtype=np.float64).reshape(len(rows), width)


def _exact(values: Floats) -> Floats:
    """Numbers are as exact as they are written, so that reading a file gives the same ones; adding
    zero makes a negative zero positive.
    """
    return np.round(values, DECIMALS) + 0.0
