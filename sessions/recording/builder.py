"""Turns messages into rows of the record. Runs in the recorder's thread; only the recorder waits.

`take` reads everything that it needs from the database before it changes anything, so that after a
DatabaseError the same item can be taken again.
"""

import datetime
from collections import Counter
from collections.abc import Callable
from typing import Any

import msgspec
import structlog
from django.db.models import Model

from accounts import audit, interventions
from accounts.models import AuditEntry
from robots.api.bucket import Bucket
from robots.api.errors import Rejection
from robots.api.messages import Event
from robots.presence.writer import without_nul
from sessions import protocol
from sessions.models import NetworkSample, SessionEvent, Snapshot, SystemLog
from sessions.recording.chunks import Chunk, Chunks
from sessions.recording.items import (
    ActionItem,
    CloseItem,
    EventItem,
    Item,
    PageItem,
    PhotoItem,
    ReleaseItem,
    StateItem,
)
from sessions.recording.photos import Photos, RecordedPhoto
from sessions.recording.robot_runs import RobotRuns
from sessions.recording.sequence_tracker import ASKING_SECONDS, Loss
from sessions.recording.store import RecordStore, key_of, row_of
from sessions.shards.foreign_messages import ForeignMessages

logger = structlog.stdlib.get_logger(__name__)
Source = SessionEvent.Source

# Events of a robot that are logged even outside of sessions.
LOGGED = {
    "estop": "warning",
    "estop_cleared": "info",
    "adapter_lost": "error",
    "adapter_back": "info",
    "localization_lost": "warning",
}
LOGGED_RATE = (0.1, 30.0)  # entries of one robot a second, and at once
STOPS_RATE = (1.0, 100.0)  # the same for its stops in the log of interventions
SETTLE_SECONDS = 2.0
GIVE_UP_SECONDS = ASKING_SECONDS + 15.0


class RecordBuilder:
    """Takes items and keeps rows until they are stored.

    Args:
        store: the database.
        ask: called with (robot, boot, first, last) to request lost states.
    """

    def __init__(self, store: RecordStore, ask: Callable[[str, str, int, int], None]) -> None:
        self._store = store
        self._chunks = Chunks()
        self._photos = Photos()
        self._runs = RobotRuns(store, ask)
        self._touched: set[str] = set()
        self._closing: dict[str, CloseItem] = {}
        self._foreign: ForeignMessages[PageItem] = ForeignMessages(store.ownership)
        self._released: list[ReleaseItem] = []
        self._allowances: dict[Any, Bucket] = {}  # of each robot, for entries of the system log
        self._stops: dict[str, Bucket] = {}  # the same for its stops
        self.rows: list[Model] = []
        self.counts = store.counts
        self.refused: Counter[str] = Counter()  # by robots, by reason

    def take(self, item: Item) -> None:
        """Take one item."""
        match item:
            case StateItem():
                self._state(item)
            case EventItem():
                self._event(item)
            case ActionItem():
                self._action(item)
            case PhotoItem():
                photo = self._photos.jpeg(item.robot, item.action_id, item.jpeg, item.received_at)
                self._photo(photo, item.received_at)
            case PageItem():
                self._page(item)
            case CloseItem():
                self._closing[item.session] = item
                self.rows += [row_of(chunk) for chunk in self._chunks.close(item.session)]
            case ReleaseItem():
                self._release(item)

    # --- states -----------------------------------------------------------------------------------

    def _state(self, item: StateItem) -> None:
        state = item.state
        session = self._store.own_session(item.robot, state.session, item.received_at)
        if not self._runs.take(item.robot, state, session, item.received_at):
            self.counts["duplicates"] += 1
        elif session is not None:
            self.counts["states"] += 1
            self.refused.update(state.refused)
            closed = self._chunks.add(session, item, _storable(item.payload))
            if closed is not None:
                self._keep(closed)

    def _keep(self, chunk: Chunk) -> None:
        self._touched.add(chunk.session)
        self.rows.append(row_of(chunk))

    # --- events -----------------------------------------------------------------------------------

    def _event(self, item: EventItem) -> None:
        """Record an event in its session, if that is this robot's, and log those of LOGGED in any
        case. All reading comes first (see the top).
        """
        event, now = item.event, item.received_at
        session = self._store.own_session(item.robot, event.session, now)
        robot_key = self._store.robot_key(item.robot) if event.type in LOGGED else None
        if session is not None:
            self._runs.on_event(item.robot, event, session, now)
            data = _without(event, "session", "type", "stamp")
            row = _event_row(session, Source.ROBOT, event.type, event.stamp, now, data)
            self._add_event(row, item.robot, event.boot, event.seq)
        if robot_key is not None:
            fields = {"detail": event.detail, "boot": event.boot}
            self._log(event.type, LOGGED[event.type], robot_key, session, now, **fields)
        if event.type in interventions.REPORTED:
            self._note_intervention(item.robot, event, session, now)
        if event.type == "photo":
            self._photo(self._photos.event(item.robot, event, now), now)

    def _note_intervention(self, robot: str, event: Event, session: str | None, now: float) -> None:
        """Add an event to the log of interventions. A viewer cannot fill it with stops; emergency
        stops, which need a responsible person, are always noted.
        """
        is_rare = event.type in {"estop", "estop_cleared"}
        if not is_rare and not self._stops.setdefault(robot, Bucket(*STOPS_RATE)).spend(now):
            self.counts["unlogged"] += 1
            return
        self.rows.append(_intervention(robot, event, session, now))

    def _action(self, item: ActionItem) -> None:
        status, now = item.status, item.received_at
        session = self._store.own_session(item.robot, item.session, now)
        if session is not None:
            data = _without(status, "stamp")
            row = _event_row(session, Source.ROBOT, "action", status.stamp, now, data)
            self._add_event(row, item.robot)

    def _add_event(self, row: SessionEvent, *identity: object) -> None:
        """Add the row of an event; `identity` distinguishes events with the same content."""
        row.pk = key_of(row.session_id, row.source, row.type, row.stamp, row.data, *identity)
        self.rows.append(row)

    def _log(
        self, event: str, level: str, robot: Any, session: str | None, now: float, **fields: Any
    ) -> None:
        if not self._allowances.setdefault(robot, Bucket(*LOGGED_RATE)).spend(now):
            self.counts["unlogged"] += 1
            return
        logger.info(event, robot=robot, session=session, **fields)
        about = {"event": event, "robot_id": robot, "session_id": session, "fields": fields}
        at = datetime.datetime.fromtimestamp(now, datetime.UTC)
        self.rows.append(SystemLog(pk=key_of(*about.values(), now), at=at, level=level, **about))

    def _photo(self, photo: RecordedPhoto | None, now: float) -> None:
        if photo is None:
            return
        event = photo.event
        session = self._store.own_session(photo.robot, event.session, now)
        if session is None:
            return
        if not photo.intact:
            robot = self._store.robot_key(photo.robot)
            self._log("photo_damaged", "error", robot, session, now, action=event.action_id)
            return
        row = Snapshot(session_id=session, action_id=event.action_id or "", stamp=event.stamp)
        row.pk = key_of(session, event.action_id, photo.sha256)
        row.sha256, row.jpeg = photo.sha256, photo.jpeg
        self.rows.append(row)

    def _page(self, item: PageItem) -> None:
        report, now = item.report, item.received_at
        robot = self._store.robot_of(report.session, now)
        if robot is None:
            self.counts["unknown_session"] += 1
            return
        if not self._store.ownership.records(robot):
            self._foreign.keep(robot, item, now)
            return
        try:
            message = protocol.decode(report.suffix, bytes(report.message).decode())
        except (Rejection, UnicodeDecodeError):
            self.counts["malformed_report"] += 1
            return
        session, stamp = report.session, message.stamp
        if isinstance(message, protocol.PageEvent):
            data = without_nul(dict(message.data))
            self._add_event(_event_row(session, Source.PAGE, message.type[:40], stamp, now, data))
            return
        data = _without(message, "stamp")
        key = key_of(session, stamp, data)
        self.rows.append(
            NetworkSample(pk=key, session_id=session, stamp=stamp, received_at=now, data=data)
        )

    # --- regular work -----------------------------------------------------------------------------

    def settle(self, now: float) -> None:
        """Close due chunks, request states that are owed, and record those that are lost."""
        for item in self._foreign.claim(now):
            self._page(item)
        self._runs.audit(self._closing.values(), now)
        for chunk in self._chunks.ripe(now):
            self._keep(chunk)
        for session in self._closing:  # late states count in the next summary
            for chunk in self._chunks.close(session):
                self._keep(chunk)
        for boot, loss in self._runs.settle(now):
            self._record_loss(boot, loss, now)
        for name, action in self._photos.forgotten(now):
            robot = self._store.robot_key(name)
            self._log("photo_incomplete", "warning", robot, None, now, action=action)

    def _release(self, item: ReleaseItem) -> None:
        """Make rows of all open chunks, and drop the memory of these robots. Their next
        session manager continues the record; if this one gets them again, it reads it again.
        """
        for chunk in self._chunks.close():
            self._keep(chunk)
        self._runs.forget(item.has)
        for one in list(self._closing.values()):
            if item.has(one.robot):
                self._forget(one.session)
        self._released.append(item)

    def tell_released(self) -> None:
        """Report that everything about released robots is written."""
        for item in self._released:
            item.done()
        self._released = []

    def _record_loss(self, boot: str, loss: Loss, now: float) -> None:
        data = {"boot": boot, "ranges": [list(pair) for pair in loss.ranges], "count": loss.count}
        for session in sorted(loss.sessions):
            logger.warning("states_missing", session=session, boot=boot, count=loss.count)
            self._touched.add(session)
            self._add_event(_event_row(session, Source.SERVER, "states_missing", now, now, data))

    def close_all(self) -> None:
        """Make rows of all open chunks, at the end of the process."""
        for chunk in self._chunks.close():
            self._keep(chunk)

    def write(self, *, careful: bool = False) -> None:
        """Store the gathered rows; on failure they are kept. See RecordStore.insert."""
        if self.rows:
            self._store.insert(self.rows, careful=careful)
            self.rows = []
        if self._touched:
            self._store.reopen(self._touched)
            self._touched = set()

    def close_sessions(self, now: float) -> None:
        """Close the records of ended sessions that are complete, or as complete as they will be."""
        for item in [item for item in self._closing.values() if self._is_settled(item, now)]:
            self._store.close(item.session, datetime.datetime.fromtimestamp(now, datetime.UTC))
            self._store.forget(item.session)
            self._forget(item.session)

    def _forget(self, session: str) -> None:
        del self._closing[session]
        self._runs.closed(session)

    def _is_settled(self, item: CloseItem, now: float) -> bool:
        since = now - item.ended_at
        return since > GIVE_UP_SECONDS or (since > SETTLE_SECONDS and self._runs.is_over(item))


def _intervention(robot: str, event: Event, session: str | None, now: float) -> AuditEntry:
    """Return the entry of an event: who it was as a role, because `detail` may name people."""
    role = event.detail.partition(" ")[0].partition(":")[0]
    is_test = event.detail.endswith(f" {interventions.SAFETY_TEST}")
    return audit.entry(
        event.type,
        pk=key_of(robot, event.type, event.stamp, event.boot, event.seq, event.action_id),
        at=datetime.datetime.fromtimestamp(now, datetime.UTC),
        robot=robot,
        role=without_nul(role),
        thing=session or "",
        detail=interventions.SAFETY_TEST if is_test else "",
    )


def _event_row(
    session: str, source: Source, kind: str, stamp: float, now: float, data: dict[str, Any]
) -> SessionEvent:
    return SessionEvent(
        session_id=session, source=source, type=kind, stamp=stamp, received_at=now, data=data
    )


def _without(message: msgspec.Struct, *columns: str) -> dict[str, Any]:
    """Return the fields of a message that have no column of their own."""
    fields: dict[str, Any] = msgspec.to_builtins(message)
    return without_nul({name: value for name, value in fields.items() if name not in columns})


def _storable(payload: bytes) -> msgspec.Raw:
    """Return JSON that every database takes: without NUL characters."""
    return msgspec.Raw(
        msgspec.json.encode(without_nul(msgspec.json.decode(payload)))
        if b"\\u0000" in payload
        else payload
    )
