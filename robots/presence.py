"""What a robot last said of itself, kept in its row: pure rules, and a writer that spares the
database.

A will can arrive seconds after the robot is back (a half-open connection that the broker gave up
late), so OFFLINE and CONNECTIONBROKEN of another boot than the last ONLINE's are ignored.
"""

import datetime
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec
from django.db.models import Q

from robots.api.messages import Connection, Factsheet, Message, State
from robots.models import Robot

WRITE_SECONDS = 2.0
UNKNOWN_SECONDS = 10.0
AT_ONCE = frozenset({"connection", "boot", "factsheet"})
# robots.agent.control.dispatcher: how an agent says that it does not reach the robot that it is the
# agent of
AWAY = re.compile(r"adapter_(?:lost|starting): ")
FAULT_NAME = re.compile(r"^\w+: ")

# Why nobody can drive a robot that is connected: its emergency stop is on, its agent does not
# reach it, or it has another fault. The words are those of a paused queue, too.
Standstill = Literal["", "estop", "not_connected", "fault"]


def changes(
    robot: Robot, message: Message, now: datetime.datetime, *, retained: bool = False
) -> dict[str, Any]:
    """Return the fields of a robot's row that a message changes.

    Args:
        robot: the row as it is known.
        message: a Connection, Factsheet or State of this robot; others change nothing.
        now: when the message came.
        retained: the broker had it in store, so that it says nothing about now.
    """
    match message:
        case Connection():
            found = _connection(robot, message)
        case Factsheet():
            found = {"factsheet": msgspec.to_builtins(message)}
        case State():
            found = _state(robot, message)
        case _:
            return {}
    if found and not retained:
        found["last_seen_at"] = now
    return {name: value for name, value in found.items() if getattr(robot, name) != value}


def _connection(robot: Robot, message: Connection) -> dict[str, Any]:
    if message.state == "ONLINE":
        return {"connection": message.state, "boot": message.boot}
    if robot.boot not in {"", message.boot}:
        return {}
    return {"connection": message.state, "boot": message.boot}


def _state(robot: Robot, message: State) -> dict[str, Any]:
    known = robot.report or {}
    if known.get("boot") == message.boot and known.get("seq", -1) >= message.seq:
        return {}  # sent again on request
    # It says nothing about the connection: the last states of a robot that died may come after its
    # will. One that lives says ONLINE.
    return {"report": msgspec.to_builtins(message)}


def trouble_of(report: Any) -> str:
    """Return why an agent does not reach its robot, as its last state has it; empty when it does,
    or has not said.
    """
    errors = report.get("errors") if isinstance(report, dict) else None
    told = (
        (error for error in errors if isinstance(error, str))
        if isinstance(errors, list | tuple)
        else ()
    )
    return next((AWAY.sub("", error, count=1) for error in told if AWAY.match(error)), "")


def standstill_of(report: Any) -> Standstill:
    """Return why nobody can drive a robot, by its last state; empty when somebody can."""
    safety = safety_of(report)
    if safety.get("estop") is True:
        return "estop"
    if trouble_of(report):
        return "not_connected"
    return "fault" if safety.get("inhibited") == "fault" else ""


def safety_of(report: Any) -> dict[str, Any]:
    """Return what its last state says of a robot's safety, {} when it says nothing."""
    safety = report.get("safety") if isinstance(report, dict) else None
    return safety if isinstance(safety, dict) else {}


def is_stopped_there(report: Any) -> bool:
    """Tell whether somebody at the robot pressed its emergency stop: at its screen, or the robot's
    own button (robots.agent.safety.estop_latch).
    """
    source = safety_of(report).get("estopSource")
    return isinstance(source, str) and source.partition(":")[0] in {"screen", "button"}


def fault_of(report: Any) -> str:
    """Return a robot's fault as its agent says it, empty when it says none."""
    errors = report.get("errors") if isinstance(report, dict) else None
    first = errors[0] if isinstance(errors, list | tuple) and errors else ""
    return FAULT_NAME.sub("", first, count=1) if isinstance(first, str) else ""


def has_problem(robot: Robot, now: datetime.datetime) -> bool:
    """Tell whether a robot is there and cannot be driven until somebody does something: it is at a
    standstill, or could not get ready for the next visit.
    """
    is_stuck = robot.turnaround == Robot.Turnaround.PAUSED
    return robot.is_online(now) and bool(standstill_of(robot.report) or is_stuck)


def _is_news(before: Any, after: Any) -> bool:
    """Tell whether a state is the first of its boot, begins or ends a standstill, or comes from a
    robot that has docked or left.
    """
    told = [
        ((one or {}).get("boot"), (one or {}).get("docked", False), standstill_of(one))
        for one in (before, after)
    ]
    return told[0] != told[1]


@dataclass(frozen=True)
class PresenceChange:
    """A robot came (`online`) or went; `state` is the word of its Connection."""

    robot: Robot
    online: bool
    state: str


@dataclass
class _KnownRobot:
    robot: Robot
    waiting: dict[str, Any] = field(default_factory=dict)
    written: float = -1e18


class PresenceWriter:
    """Takes every message of every robot and writes rows: at once what is news to whoever chooses a
    robot, other states every two seconds.

    Synchronous; for the one process that records a robot. It writes only fields that nobody else
    writes, and where `only_if` of the robot's name holds.
    """

    def __init__(
        self,
        write_seconds: float = WRITE_SECONDS,
        only_if: Callable[[str], Q] = lambda _robot: Q(),
    ) -> None:
        self._write_seconds = write_seconds
        self._only_if = only_if
        self._known: dict[str, _KnownRobot] = {}
        self._unknown: dict[str, float] = {}
        self._unwritten: set[str] = set()

    def take(
        self, name: str, message: Message, now: datetime.datetime, *, retained: bool = False
    ) -> PresenceChange | None:
        """Take a message of the robot called `name`; return what became of its presence, None when
        that is as before.
        """
        known = self._find(name, now.timestamp())
        if known is None:
            return None
        was, report = known.robot.connection, known.robot.report
        found = changes(known.robot, message, now, retained=retained)
        for key, value in found.items():
            setattr(known.robot, key, value)
        known.waiting |= found
        if (
            AT_ONCE & found.keys()
            or _is_news(report, known.robot.report)
            or (known.waiting and now.timestamp() - known.written >= self._write_seconds)
        ):
            self._write(name, known, now.timestamp())
        elif known.waiting:
            self._unwritten.add(name)
        state = known.robot.connection
        return PresenceChange(known.robot, state == "ONLINE", state) if state != was else None

    def forget(self, names: Collection[str] | None = None) -> None:
        """Read these robots' rows, or every row, again before anything more is taken: what was last
        taken is not stored, or other processes have written there.
        """
        for name in list(self._known) if names is None else names:
            self._known.pop(name, None)
            self._unwritten.discard(name)

    def flush(self, now: datetime.datetime, *, at_once: bool = False) -> None:
        """Write the states that have waited for long enough, or all that wait; the robot's next
        one may be far.
        """
        for name in list(self._unwritten):
            known = self._known.get(name)
            if known is None or not known.waiting:
                self._unwritten.discard(name)
            elif at_once or now.timestamp() - known.written >= self._write_seconds:
                self._write(name, known, now.timestamp())

    def _find(self, name: str, now: float) -> _KnownRobot | None:
        if name in self._known:
            return self._known[name]
        if self._unknown.get(name, -1e18) > now - UNKNOWN_SECONDS:
            return None
        robot = Robot.objects.filter(name=name).first()
        if robot is None:
            self._unknown[name] = now
            return None
        self._known[name] = _KnownRobot(robot)
        return self._known[name]

    def _write(self, name: str, known: _KnownRobot, now: float) -> None:
        if not Robot.objects.filter(self._only_if(name), pk=known.robot.pk).update(**known.waiting):
            del self._known[name]  # deleted, perhaps made anew under the same name, or not ours
        known.waiting, known.written = {}, now
        self._unwritten.discard(name)
