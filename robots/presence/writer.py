"""Stores a robot's last report in its RobotPresence: pure rules, and a writer that batches rows.

A will can arrive seconds after the robot has reconnected, when the broker ends a half-open
connection late. OFFLINE and CONNECTIONBROKEN of another boot than the last ONLINE's are ignored.
"""

import datetime
from collections.abc import Collection
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, Protocol

import msgspec
import structlog
from django.db import DataError, IntegrityError, connection, transaction

from accounts import interventions
from accounts.models import AuditEntry
from robots.api.messages import Connection, Factsheet, Message, State
from robots.models import RobotPresence
from robots.presence.report import standstill_of
from robots.presence.versions import changes_of

logger = structlog.stdlib.get_logger(__name__)

WRITE_SECONDS = 2.0
UNKNOWN_SECONDS = 10.0
AT_ONCE = frozenset({"connection", "boot", "factsheet"})


def changes(
    row: RobotPresence, message: Message, now: datetime.datetime, *, retained: bool = False
) -> dict[str, Any]:
    """Return the fields of a robot's presence that a message changes.

    Args:
        row: the present fields.
        message: a Connection, Factsheet or State of this robot; others change nothing.
        now: when the message arrived.
        retained: the broker had stored it, so that it does not prove that the robot is online.
    """
    match message:
        case Connection():
            found = _connection(row, message)
        case Factsheet():
            found = {"factsheet": without_nul(msgspec.to_builtins(message))}
        case State():
            found = _state(row, message)
        case _:
            return {}
    if found and not retained:
        found["last_seen_at"] = now
    return {name: value for name, value in found.items() if getattr(row, name) != value}


def _connection(row: RobotPresence, message: Connection) -> dict[str, Any]:
    if message.state != "ONLINE" and row.boot not in {"", message.boot}:
        return {}
    return {"connection": message.state, "boot": message.boot}


def _state(row: RobotPresence, message: State) -> dict[str, Any]:
    known = row.report or {}
    if known.get("boot") == message.boot and known.get("seq", -1) >= message.seq:
        return {}  # sent again on request
    # A state does not change the connection: the last states of an agent that died may arrive after
    # its will, and an agent that is running publishes ONLINE.
    return {"report": without_nul(msgspec.to_builtins(message))}


def without_nul(value: Any) -> Any:
    """Return JSON without NUL characters, which PostgreSQL cannot hold."""
    match value:
        case str():
            return value.replace("\0", "")
        case dict():
            return {without_nul(name): without_nul(item) for name, item in value.items()}
        case list() | tuple():
            return [without_nul(item) for item in value]
    return value


def _is_news(before: Any, after: Any) -> bool:
    """Tell whether a state is the first of its boot, or its standstill or docking is new."""
    keys = [
        ((one or {}).get("boot"), (one or {}).get("docked", False), standstill_of(one))
        for one in (before, after)
    ]
    return keys[0] != keys[1]


class Fence(Protocol):
    """Which robots this process may write (sessions.shards.ownership); `version` grows when that
    changes.
    """

    version: int

    def records(self, robot: str) -> bool:
        """Tell whether this process may write the presence of the robot of this name."""

    def about(self, *robots: str) -> AbstractContextManager[None]:
        """Refuse the writes in this block when another process has taken over one of the robots."""


@dataclass
class _KnownRobot:
    name: str
    row: RobotPresence
    waiting: dict[str, Any] = field(default_factory=dict)
    is_urgent: bool = False
    written: float = -1e18


class PresenceWriter:
    """Collects the messages of all robots, and writes rows together: at the next `write` the
    changes that the list of robots shows, other states every two seconds.

    Synchronous; used by the one process that records a robot, which alone writes these fields.
    """

    def __init__(self, fence: Fence, write_seconds: float = WRITE_SECONDS) -> None:
        self._write_seconds = write_seconds
        self._fence = fence
        self._version = self._fence.version
        self._known: dict[str, _KnownRobot] = {}
        self._unknown: dict[str, float] = {}
        self._unwritten: set[str] = set()
        self._changes: list[AuditEntry] = []  # of software and profiles, not stored yet

    def read(self, names: Collection[str], now: datetime.datetime) -> None:
        """Read the rows of robots that are not in memory, in one statement."""
        at = now.timestamp()
        asked = {
            name
            for name in names
            if name not in self._known and self._unknown.get(name, -1e18) <= at - UNKNOWN_SECONDS
        }
        if not asked:
            return
        for row in RobotPresence.objects.filter(robot__name__in=asked).select_related("robot"):
            self._known[row.robot.name] = _KnownRobot(row.robot.name, row)
        self._unknown |= dict.fromkeys(asked - self._known.keys(), at)

    def take(
        self, name: str, message: Message, now: datetime.datetime, *, retained: bool = False
    ) -> RobotPresence | None:
        """Note a message of the robot `name`; return its presence if its connection has changed."""
        self.read([name], now)
        known = self._known.get(name)
        if known is None:
            return None
        was, report = known.row.connection, known.row.report
        found = changes(known.row, message, now, retained=retained)
        if "factsheet" in found and not known.row.robot.practice:
            self._changes += changes_of(name, known.row.factsheet, found["factsheet"], now)
        for key, value in found.items():
            setattr(known.row, key, value)
        if found:
            known.waiting |= found
            known.is_urgent |= bool(AT_ONCE & found.keys()) or _is_news(report, known.row.report)
            self._unwritten.add(name)
        return known.row if known.row.connection != was else None

    def forget(self, names: Collection[str] | None = None) -> None:
        """Read these robots' rows, or all rows, again before the next message: a write failed, or
        other processes have written them.
        """
        for name in list(self._known) if names is None else names:
            self._known.pop(name, None)
            self._unwritten.discard(name)

    def follow_ownership(self, now: datetime.datetime) -> None:
        """When this process has gained or lost robots, write all pending changes and read every row
        again: a row that another process wrote in between is out of date here.
        """
        if (version := self._fence.version) != self._version:
            self.write(now, at_once=True)
            self.forget()
            self._version = version

    def write(self, now: datetime.datetime, *, at_once: bool = False) -> None:
        """Write urgent changes and states that are two seconds old, or with `at_once` all pending
        changes: an idle robot's next message may take half a minute.
        """
        at = now.timestamp()
        self.forget([name for name in self._unwritten if not self._fence.records(name)])
        due = [
            known
            for known in (self._known[name] for name in self._unwritten)
            if at_once or known.is_urgent or at - known.written >= self._write_seconds
        ]
        by_fields: dict[tuple[str, ...], list[_KnownRobot]] = {}
        for known in due:
            by_fields.setdefault(tuple(sorted(known.waiting)), []).append(known)
        with self._fence.about(*(known.name for known in due)):
            for names, group in by_fields.items():
                self._write_group(names, group)
            if self._changes:
                interventions.store(self._changes)
                self._changes = []
        for known in due:
            known.waiting, known.is_urgent, known.written = {}, False, at
            self._unwritten.discard(known.name)

    def _write_group(self, fields: Collection[str], group: Collection[_KnownRobot]) -> None:
        """Write the same fields of several robots in one transaction. If the database refuses a
        value, each robot is written alone, so that one robot's bad report does not lose the others;
        the bad one is logged, and its row is read again.
        """
        rows = [known.row for known in group]
        try:
            with transaction.atomic():
                written = update_each(rows, fields)
        except (DataError, IntegrityError, ValueError) as error:
            if len(rows) > 1:
                for known in group:
                    self._write_group(fields, [known])
                return
            logger.error("presence_refused", robot=next(iter(group)).name, reason=str(error))
            written = 0
        if written < len(rows):  # one was deleted, and perhaps created again under the same name
            self.forget([known.name for known in group])


def update_each(rows: Collection[RobotPresence], fields: Collection[str]) -> int:
    """Write these fields of each row; return how many of the rows exist.

    One prepared statement for all rows: the statement of `bulk_update` grows with the rows, and at
    a hundred rows takes twice the CPU time of an `update` for each.
    """
    if connection.vendor == "mongodb":
        return sum(
            RobotPresence.objects.filter(pk=row.pk).update(
                **{name: getattr(row, name) for name in fields}
            )
            for row in rows
        )
    meta = RobotPresence._meta
    key, columns = meta.pk, [meta.get_field(name) for name in fields]
    table, *names = (
        connection.ops.quote_name(name)
        for name in (meta.db_table, key.column, *(column.column for column in columns))
    )
    changed = ", ".join(f"{name} = %s" for name in names[1:])
    with connection.cursor() as cursor:
        values = [
            [
                column.get_db_prep_save(getattr(row, column.attname), connection)
                for column in (*columns, key)
            ]
            for row in rows
        ]
        cursor.executemany(f"UPDATE {table} SET {changed} WHERE {names[0]} = %s", values)  # noqa: S608
        return int(cursor.rowcount)
