"""The record of a session for its replay: everything on one time line, as columns of numbers.

Times are seconds since the robot was granted, by the server's clock, with the same offsets as in
datasets; earlier times (waiting in the queue) are 0. Metres, radians, m/s and rad/s in the frame of
the map. Poses between two states are not stored: the page interpolates them.
"""

import math
from collections.abc import Iterable
from itertools import chain
from typing import Any

import numpy as np

from experiments.dataset.states import StoredPart, StoredState
from experiments.extraction.events import page_offset, robot_offset
from experiments.models import Drive, TaskEvent
from experiments.research.event_text import in_words
from experiments.stored_states import StateReader
from robots.plans.floorplans import plan_content
from sessions.models import NetworkSample, Session, SessionEvent, Snapshot

# The columns, and how many decimals each has; 0 is a whole number.
NETWORK = {"t": 3, "roundTrip": 4, "loss": 4, "fps": 4, "bitrate": 4, "frameAge": 4}
POSES = {"t": 3, "x": 3, "y": 3, "theta": 4, "localized": 0, "v": 3, "w": 3}
STATES = POSES | {"charge": 3, "docked": 0, "clearance": 4, "contacts": 0}
COMMANDS = {"t": 3, "v": 3, "w": 3, "method": 0, "way": 0, "age": 4}
# Events of robots that would reveal the condition to a blind coder.
TELLING = frozenset({"door_changed", "action"})


class ReplayCommand(StoredPart):
    """A command that was applied; `stamp` by the page's clock."""

    stamp: float
    method: str
    way: str
    age: float
    linear: float
    angular: float


class Recorded(StoredState):
    applied: list[ReplayCommand] = []


STORED = StateReader(Recorded)


def replay(session: Session, drive: Drive | None) -> dict[str, Any]:
    begin = (session.granted_at or session.queued_at).timestamp()
    offsets = {"robot": robot_offset(session.pk), "page": page_offset(session.pk)}
    found = recorded(session, begin + offsets["robot"])
    words: dict[str, int] = {}  # input methods and routes, by the numbers in the commands
    states = _columns(STATES, [_state_row(at, state) for at, state in found])
    rows = (_command_rows(at, state.applied, words) for at, state in found)
    commands = _columns(COMMANDS, list(chain.from_iterable(rows)))
    network = _network(session, begin + offsets["page"])
    events = _events(session, drive, begin, offsets)
    last = [*states["t"][-1:], *network["t"][-1:], *(event[0] for event in events[-1:])]
    ended = [session.ended_at.timestamp() - begin] if session.ended_at else []
    return {
        "begin": begin,
        "duration": round(max([*last, *ended, 0.0]), 3),
        "ended": session.ended_at is not None,
        "states": states,
        "commands": commands,
        "words": list(words),
        "network": network,
        "events": events,
    }


def player_config(session: Session, data: str, photos: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what the script of a page with a replay needs; `data` is the address of the record."""
    robot = session.robot
    return {
        "data": data,
        "site": plan_content(robot.floor_plan) if robot.floor_plan else None,
        "footprint": (robot.presence.factsheet or {}).get("footprint", []),
        "photos": photos,
    }


def blinded(record: dict[str, Any]) -> dict[str, Any]:
    """Return a record without what would reveal the condition to a coder: commands, the network,
    doors, and the events of the page and the server.
    """
    events = [event for event in record["events"] if event[1] in {"task", "robot"}]
    return record | {
        "commands": {name: [] for name in record["commands"]},
        "network": {name: [] for name in record["network"]},
        "words": [],
        "events": [event for event in events if event[2] not in TELLING],
    }


def recorded(session: Session, begin: float) -> list[tuple[float, Recorded]]:
    """Return the states of a session in order of time, with seconds since `begin` (Unix seconds by
    the robot's clock).
    """
    found = [(max(0.0, state.stamp - begin), state) for state in STORED.of(session)]
    return sorted(found, key=lambda pair: (pair[0], pair[1].seq))


def _state_row(at: float, state: Recorded) -> tuple[Any, ...]:
    pose, velocity = state.pose, state.velocity
    posed = (at, pose.x, pose.y, pose.theta, pose.localized, velocity.linear, velocity.angular)
    return *posed, state.battery.charge, state.docked, state.clearance, state.contacts


def _command_rows(
    at: float, applied: list[ReplayCommand], words: dict[str, int]
) -> Iterable[tuple[Any, ...]]:
    """Yield the commands of a state: the newest at the state's time, the others as long before it
    as they were given.
    """
    for command in applied:
        before = min(1.0, max(0.0, applied[-1].stamp - command.stamp))
        method = words.setdefault(command.method, len(words))
        route = words.setdefault(command.way, len(words))
        yield max(0.0, at - before), command.linear, command.angular, method, route, command.age


def _columns(decimals: dict[str, int], rows: list[tuple[Any, ...]]) -> dict[str, list[Any]]:
    """Return rows as lists by name, rounded all at once; NaN becomes None."""
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(decimals))
    columns: dict[str, list[Any]] = {}
    for column, (name, places) in zip(table.T, decimals.items(), strict=True):
        if places:
            numbers = (np.round(column, places) + 0.0).tolist()
            columns[name] = [number if math.isfinite(number) else None for number in numbers]
        else:
            columns[name] = column.astype(int).tolist()
    return columns


def _network(session: Session, begin: float) -> dict[str, list[Any]]:
    samples = NetworkSample.objects.filter(session=session).order_by("received_at")
    rows = []
    for stamp, data in samples.values_list("stamp", "data"):
        values = (data.get(name) for name in list(NETWORK)[1:])
        numbers = (value if isinstance(value, int | float) else None for value in values)
        rows.append((max(0.0, stamp - begin), *numbers))
    return _columns(NETWORK, rows)


def _events(
    session: Session, drive: Drive | None, begin: float, offsets: dict[str, float]
) -> list[list[Any]]:
    """Return the events of a session in order of time: seconds, source (task, server, robot, page),
    type, and the data in words.
    """
    rows = SessionEvent.objects.filter(session=session)
    events = [
        [stamp - offsets.get(source, 0.0) - begin, source, kind, in_words(data)]
        for source, kind, stamp, data in rows.values_list("source", "type", "stamp", "data")
    ]
    if drive is not None:
        tasks = TaskEvent.objects.filter(drive=drive).values_list("stamp", "type", "data")
        events += [[stamp - begin, "task", kind, in_words(data)] for stamp, kind, data in tasks]
    return sorted([round(max(0.0, at), 3), *rest] for at, *rest in events)


def photos_of(session: Session, begin: float) -> list[tuple[float, Snapshot]]:
    """Return the photos of a session and when they were taken, without their images."""
    offset = robot_offset(session.pk)
    rows = Snapshot.objects.filter(session=session).defer("jpeg").order_by("stamp")
    return [(round(max(0.0, row.stamp - offset - begin), 3), row) for row in rows]
