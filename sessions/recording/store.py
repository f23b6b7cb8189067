"""Reads and adds rows of the record. For the recorder's one thread.

Rows of messages have keys made from their content, so that a message that is delivered twice is one
row. Rows that exist are dropped before the insert, because not every supported database can ignore
conflicts.
"""

import contextlib
import datetime
import json
import os
import uuid
from collections import Counter
from typing import Any

import msgspec
import structlog
from django.db import DataError, IntegrityError, connection, transaction
from django.db.models import Model, Q

from robots.models import Robot
from sessions.models import NetworkSample, Session, SessionEvent, Snapshot, StateChunk
from sessions.recording.chunks import Chunk
from sessions.recording.sequence_tracker import Intervals, Range, StoredStates
from sessions.recording.summary import summarise
from sessions.shards.ownership import EVERYTHING, Fenced, Ownership

logger = structlog.stdlib.get_logger(__name__)

_NAMESPACE = uuid.UUID("5b1b7a9e-8f0e-4f6b-9c57-6a1f0c8f4d21")
BATCH = 500
UNKNOWN_SECONDS = 30.0


def key_of(*parts: object) -> uuid.UUID:
    """Return the key of the row of a message with this content."""
    return uuid.uuid5(_NAMESPACE, json.dumps([str(part) for part in parts]))


def new_key(now: float) -> uuid.UUID:
    """Return a key that sorts by time (RFC 9562, version 7): random ones make every insert touch
    another page of a large table's index.
    """
    milliseconds, random = int(now * 1000) & (2**48 - 1), int.from_bytes(os.urandom(10), "big")
    return uuid.UUID(
        int=milliseconds << 80
        | 7 << 76
        | (random >> 62 & 0xFFF) << 64
        | 2 << 62
        | random & (2**62 - 1)
    )


def row_of(chunk: Chunk) -> StateChunk:
    """Return the row of a chunk."""
    return StateChunk(
        pk=new_key(chunk.received_at),
        session_id=chunk.session,
        boot=chunk.boot,
        first_seq=chunk.first_seq,
        last_seq=chunk.last_seq,
        count=len(chunk.states),
        first_stamp=chunk.first_stamp,
        last_stamp=chunk.last_stamp,
        received_at=chunk.received_at,
        clock_offset=chunk.clock_offset,
        # SQL databases take JSON as text, MongoDB takes objects
        states=[msgspec.json.decode(state) for state in chunk.states]
        if connection.vendor == "mongodb"
        else list(chunk.states),
    )


def parts_of(row: StateChunk, missing: list[Range]) -> list[StateChunk]:
    """Return rows with only those states of a row, as `row_of` made it, that are in `missing`."""
    rows = []
    for first, last in missing:
        states = [
            msgspec.Raw(msgspec.json.encode(state))
            for state in row.states[first - row.first_seq : last - row.first_seq + 1]
        ]
        stamps = [msgspec.json.decode(states[end])["stamp"] for end in (0, -1)]
        rows.append(
            row_of(
                Chunk(
                    str(row.session_id),
                    row.boot,
                    first,
                    stamps[0],
                    row.received_at,
                    row.clock_offset,
                    last,
                    stamps[1],
                    states,
                )
            )
        )
    return rows


class RecordStore:
    """Reads and writes; every method may raise DatabaseError, and may then be called again. Rows of
    another session manager's robots are counted and dropped.
    """

    def __init__(self, ownership: Ownership = EVERYTHING) -> None:
        self.ownership = ownership
        self._robot_of_session: dict[str, str] = {}
        self._unknown: dict[str, float] = {}
        self._robot_keys: dict[str, uuid.UUID | None] = {}
        self.counts: Counter[str] = Counter()

    def own_session(self, robot: str, session: str | None, now: float) -> str | None:
        """Return a message's session, if it is this robot's: a robot cannot write other records."""
        if session is None or self._robot_of_session.get(session) == robot:
            return session
        if self.robot_of(session, now) == robot:
            return session
        self.counts["foreign_session"] += 1
        return None

    def robot_of(self, session: str, now: float) -> str | None:
        """Return the name of a session's robot; None when there is no such session."""
        if session in self._robot_of_session:
            return self._robot_of_session[session]
        if now - self._unknown.get(session, -UNKNOWN_SECONDS) < UNKNOWN_SECONDS:
            return None
        name = (
            Session.objects.filter(pk=session).values_list("robot__name", flat=True).first()
            if _is_key(session)
            else None
        )
        if name is None:
            self._remember_unknown(session, now)
            return None
        self._robot_of_session[session] = name
        return name

    def forget(self, session: str) -> None:
        """Remove a session from the cache."""
        self._robot_of_session.pop(session, None)

    def _remember_unknown(self, session: str, now: float) -> None:
        if len(self._unknown) > 10_000:
            self._unknown.clear()
        self._unknown[session] = now

    def robot_key(self, name: str) -> uuid.UUID | None:
        """Return the key of a robot, None when there is none of this name."""
        if self._robot_keys.get(name) is None:
            self._robot_keys[name] = (
                Robot.objects.filter(name=name).values_list("pk", flat=True).first()
            )
        return self._robot_keys[name]

    def stored(self, session: str, boot: str) -> list[Range]:
        """Return the stored seqs of a session and run."""
        return list(
            StateChunk.objects.filter(session=session, boot=boot)
            .order_by("first_seq")
            .values_list("first_seq", "last_seq")
        )

    def stored_of(self, session: str, boot: str) -> StoredStates:
        """Return the stored states of a session and run, with the ends that the robot reported."""
        ends = SessionEvent.objects.filter(
            session=session,
            source=SessionEvent.Source.ROBOT,
            type__in=["lease_taken", "session_closed"],
        ).values_list("type", "data")
        of_run = [(kind, data) for kind, data in ends if data.get("boot") == boot]
        return StoredStates(
            tuple(self.stored(session, boot)),
            min((data["seq"] for kind, data in of_run if kind == "lease_taken"), default=None),
            max((data["lastSeq"] for _, data in of_run if "lastSeq" in data), default=None),
        )

    def insert(self, rows: list[Any], *, careful: bool = False) -> None:
        """Store rows; those that exist, or that the database will never take, are counted and
        dropped.

        `careful`: another session manager may have stored some of these states, in other chunks.
        """
        # an entry of the audit log has no session of its own
        keys = [str(getattr(row, "session_id", "")) for row in rows]
        robots = [self._robot_of_session.get(key) for key in keys]
        known = {robot for robot in robots if robot is not None}
        ours = {robot for robot in known if self.ownership.records(robot)}
        by_model: dict[type[Model], list[Model]] = {}
        for row, robot in zip(rows, robots, strict=True):
            if robot is None or robot in ours:
                by_model.setdefault(type(row), []).append(row)
            else:
                self.counts["fenced"] += 1
        if careful:
            by_model[StateChunk] = [
                part for row in by_model.get(StateChunk, []) for part in self._rest_of(row)
            ]
        with self.ownership.about(*ours):
            for model, fresh in by_model.items():
                for start in range(0, len(fresh), BATCH):
                    batch = fresh[start : start + BATCH]
                    try:
                        self._insert_batch(model, batch)
                    except Fenced as error:
                        self.counts["fenced"] += len(batch)
                        logger.warning("record_fenced", rows=len(batch), reason=str(error))

    def _insert_batch(self, model: type[Model], rows: list[Model]) -> None:
        # the tracker has dropped states that were seen before
        fresh = rows if model is StateChunk else self._without_known(model, rows)
        try:
            with transaction.atomic():
                model.objects.bulk_create(fresh)
        except (IntegrityError, DataError, ValueError):
            for row in fresh:
                self._insert_one(row)
        else:
            self.counts[model.__name__] += len(fresh)

    def _without_known(self, model: type[Model], rows: list[Model]) -> list[Model]:
        unique = {row.pk: row for row in rows}
        known = set(model.objects.filter(pk__in=unique).values_list("pk", flat=True))
        self.counts["duplicates"] += len(rows) - len(unique.keys() - known)
        return [row for key, row in unique.items() if key not in known]

    def _insert_one(self, row: Model) -> None:
        try:
            # The commit fails if the session has just been deleted.
            with transaction.atomic(durable=True):
                row.save(force_insert=True)
        except IntegrityError as error:
            if isinstance(row, StateChunk) and self._insert_rest(row):
                return
            self._refuse(row, error)
        except (DataError, ValueError) as error:
            self._refuse(row, error)
        else:
            self.counts[type(row).__name__] += 1

    def _insert_rest(self, row: StateChunk) -> bool:
        """Insert the states of a row that are not stored; False when none is stored, so that the
        row was refused for another reason.
        """
        rest = self._rest_of(row)
        if rest == [row]:
            return False
        StateChunk.objects.bulk_create(rest)
        return True

    def _rest_of(self, row: Any) -> list[StateChunk]:
        """Return rows of those states of a row that are not stored; the row itself if none is."""
        there = Intervals()
        for first, last in self.stored(str(row.session_id), row.boot):
            there.add(first, last)
        missing = there.missing(row.first_seq, row.last_seq)
        if missing == [(row.first_seq, row.last_seq)]:
            return [row]
        self.counts["duplicates"] += row.count - sum(last - first + 1 for first, last in missing)
        return parts_of(row, missing)

    def _refuse(self, row: Model, error: Exception) -> None:
        self.counts["refused"] += 1
        logger.error("record_row_refused", kind=type(row).__name__, reason=str(error))

    def reopen(self, sessions: set[str]) -> None:
        """Reopen closed sessions that late rows came for, so that their summary is made again."""
        robots = {self._robot_of_session[key] for key in sessions if key in self._robot_of_session}
        with contextlib.suppress(Fenced), self.ownership.about(*robots):
            Session.objects.filter(pk__in=sessions, closed_at__isnull=False).update(closed_at=None)

    def close(self, session: str, now: datetime.datetime) -> None:
        """Write the final summary of a session."""
        chunks = (
            StateChunk.objects.filter(session=session)
            .order_by("first_stamp")
            .values_list("boot", "states")
            .iterator(chunk_size=200)
        )
        lost = SessionEvent.server_events(session, "states_missing").values_list("data", flat=True)
        summary = summarise(chunks, missing=sum(data["count"] for data in lost))
        summary["snapshots"] = Snapshot.objects.filter(session=session).count()
        summary["network_samples"] = NetworkSample.objects.filter(session=session).count()
        robot = self.robot_of(session, now.timestamp())
        fence = self.ownership.condition(robot) if robot is not None else Q()
        Session.objects.filter(fence, pk=session).update(summary=summary, closed_at=now)


def _is_key(text: str) -> bool:
    try:
        uuid.UUID(text)
    except ValueError:
        return False
    return True
