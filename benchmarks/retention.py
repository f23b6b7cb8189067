"""What a year of recorded states costs on PostgreSQL: room, the queries of the live view, of a
replay and of exports, a night of `forget`, and how long the recorder waits beside it.

The server is a real one that writes to the disk. RETENTION_SESSIONS drives of ten minutes, spread
over a year, are 600 rows of four states each: the default is 5 million states in 3 GB, and 16,500
drives are 40 million in 24 GB. `PLANS=1` prints the plans of the queries.
"""

import contextlib
import datetime
import os
import random
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from typing import Any

import msgspec

from benchmarks import states
from benchmarks.table import Figure, keep, quantiles
from tests.support.programs.postgres import running_postgres

SESSIONS = int(os.environ.get("RETENTION_SESSIONS", "2200"))
DAYS, CHUNKS = 365, 600
DAY = datetime.timedelta(days=1)
TABLE = "telepresence_sessions_statechunk"
DRIVES = 60  # that are recorded beside the deletion
DURABLE = ("-c fsync=on", "-c shared_buffers=512MB", "-c max_wal_size=4GB")


def main() -> int:
    with (
        tempfile.TemporaryDirectory(prefix="telepresence-retention-") as folder,
        running_postgres(*DURABLE) as server,
    ):
        os.environ |= {
            "VAR_DIR": folder,
            "LOG_LEVEL": "WARNING",
            "DATABASE_URL": server.url,
            "DJANGO_SETTINGS_MODULE": "telepresence_site.settings",
        }
        import django

        django.setup()
        now = datetime.datetime.now(datetime.UTC)
        began = time.perf_counter()
        fill(now)
        print(f"{rows():.0f} rows in {time.perf_counter() - began:.0f} s", flush=True)
        figures = [*room(), *queries(now), *nights(now)]
    return keep("retention", figures, sessions=SESSIONS, rows_a_session=CHUNKS)


# --- a year ---------------------------------------------------------------------------------------


def fill(now: datetime.datetime) -> None:
    """Store a year of drives, day by day, each in the ten hours of an opening."""
    from accounts.models import User
    from robots.models import Robot
    from sessions.models import Session

    robot = Robot.objects.create(name="past", title="past", enabled=False)
    visitor = User.objects.create(username="past")
    template(ended(robot, visitor, now))
    chance = random.Random(1)
    for day in range(DAYS, 0, -1):
        count = SESSIONS * (DAYS - day + 1) // DAYS - SESSIONS * (DAYS - day) // DAYS
        begun = [now - day * DAY + chance.random() * DAY * 10 / 24 for _ in range(count)]
        sessions = Session.objects.bulk_create(ended(robot, visitor, at) for at in begun)
        ask(FILL, [[session.pk for session in sessions]])
    ask("DROP TABLE template")
    ask(f"VACUUM ANALYZE {TABLE}")


def ended(robot: Any, visitor: Any, begun: datetime.datetime) -> Any:
    """Return a session, not stored yet, whose record is closed."""
    from sessions.models import Session

    key, over = uuid.uuid4(), begun + datetime.timedelta(minutes=10)
    return Session(
        pk=key,
        robot=robot,
        visitor=visitor,
        live_key=str(key),
        state="ended",
        queued_at=begun,
        granted_at=begun,
        ended_at=over,
        closed_at=over,
    )


def template(session: Any) -> None:
    """Make a table with the rows of one drive, which PostgreSQL copies as it has stored them."""
    from sessions.models import StateChunk

    chance = random.Random(2)
    session.save()
    StateChunk.objects.bulk_create(
        StateChunk(
            session=session,
            boot="template",
            first_seq=4 * number,
            last_seq=4 * number + 3,
            count=4,
            first_stamp=number,
            last_stamp=number + 0.75,
            received_at=number + 0.8,
            clock_offset=0.012,
            states=[uneven(4 * number + n, chance) for n in range(4)],
        )
        for number in range(CHUNKS)
    )
    ask(f"CREATE TABLE template AS SELECT * FROM {TABLE}")
    session.delete()


def uneven(seq: int, chance: random.Random) -> Any:
    """Return a state whose numbers are of no two states alike, since they are compressed."""

    def vary(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: vary(one) for name, one in value.items()}
        if isinstance(value, list):
            return [vary(one) for one in value]
        return round(value * chance.uniform(0.5, 1.5), 5) if isinstance(value, float) else value

    return vary(msgspec.json.decode(states.state(seq, "past", None, 0)))


# Keys as the recorder makes them, which begin with the time.
FILL = f"""
INSERT INTO {TABLE} (id, session_id, boot, first_seq, last_seq, count, first_stamp, last_stamp,
                     received_at, clock_offset, states)
SELECT (lpad(to_hex((at * 1000)::bigint), 12, '0') || '7' || substr(noise, 1, 3) || '8'
        || substr(noise, 4, 15))::uuid,
       session, left(session::text, 17), first_seq, last_seq, count, begun + first_stamp,
       begun + last_stamp, at, clock_offset, states
FROM (SELECT template.*, session.id AS session, extract(epoch FROM granted_at) AS begun,
             extract(epoch FROM granted_at) + received_at AS at, md5(random()::text) AS noise
      FROM telepresence_sessions_session AS session, template
      WHERE session.id = ANY(%s)) AS one
ORDER BY at
"""


def ask(sql: str, values: list[Any] | None = None) -> list[tuple[Any, ...]]:
    from django.db import connection

    with connection.cursor() as cursor:
        cursor.execute(sql, values)
        return list(cursor.fetchall()) if cursor.description else []


# --- the figures ----------------------------------------------------------------------------------


def rows() -> float:
    return float(ask(f"SELECT reltuples FROM pg_class WHERE relname = '{TABLE}'")[0][0])


def room() -> Iterator[Figure]:
    for what, size in (
        ("table, indexes and TOAST", f"pg_total_relation_size('{TABLE}')"),
        ("of that the indexes", f"pg_indexes_size('{TABLE}')"),
    ):
        yield Figure(what, ask(f"SELECT {size}")[0][0] / 1e9, "GB")


def queries(now: datetime.datetime) -> Iterator[Figure]:
    """Tell how long each reader takes, for drives of all the year that nothing has read before."""
    from experiments.extraction.states import STORED
    from experiments.stored_states import _chunks, newest_chunk
    from sessions.models import Session, StateChunk

    drives = list(Session.objects.filter(ended_at__lt=now - DAY).order_by("?")[:200])
    for what, read in (
        ("the newest row of a drive (live view)", newest_chunk),
        ("all states of a drive (replay, export)", lambda one: list(STORED.chunks_of(one))),
        ("the same once more", lambda one: list(STORED.chunks_of(one))),
    ):
        drives = drives if "same" in what else drives[50:]
        yield from quantiles(
            what, [1e3 * seconds(read, one) for one in drives[:50]], "ms", p50=None, p95=None
        )
    if os.environ.get("PLANS"):
        key = drives[0].pk
        for asked in (
            _chunks(key).reverse()[:1],
            _chunks(key).values_list("pk"),
            StateChunk.objects.filter(session=key).order_by("first_stamp"),
        ):
            print(asked.explain(analyze=True, buffers=True), flush=True)


def nights(now: datetime.datetime) -> Iterator[Figure]:
    """Yield the cost of a night on a site that keeps a year, and of one after its retention was
    shortened by 30 days, while many drives are recorded.
    """
    yield from forgetting("a night", now, DAYS - 1)
    with recording(now) as alone:
        time.sleep(20)
    with recording(now) as beside:
        yield from forgetting("30 days at once", now, DAYS - 31)
    for what, waits in (("alone", alone), ("beside it", beside)):
        yield from quantiles(
            f"a second's quarter of {DRIVES} drives stored, {what}",
            waits,
            "ms",
            p50=None,
            p99=None,
            max=None,
        )
    yield Figure("VACUUM after it", seconds(ask, f"VACUUM {TABLE}"), "s")


def forgetting(what: str, now: datetime.datetime, days: float) -> Iterator[Figure]:
    """Delete older data; yield the number of sessions, the seconds and the bytes of WAL."""
    from django.conf import settings

    from telepresence_site.ops.retention import forget_all

    settings.RETENTION_DAYS = dict.fromkeys(settings.RETENTION_DAYS, 0.0) | {"sessions": days}
    before = ask("SELECT pg_current_wal_lsn()")[0][0]
    began = time.perf_counter()
    sessions = dict(forget_all(now, dry_run=False))["sessions"]
    taken = time.perf_counter() - began
    wal = float(ask("SELECT pg_current_wal_lsn() - %s", [before])[0][0])
    yield Figure(f"forget, {what}, {sessions} sessions", taken, "s")
    yield Figure(f"forget, {what}, WAL a row", wal / max(1, sessions * CHUNKS), "B")


def seconds(act: Callable[[Any], Any], about: Any) -> float:
    began = time.perf_counter()
    act(about)
    return time.perf_counter() - began


@contextlib.contextmanager
def recording(now: datetime.datetime) -> Iterator[list[float]]:
    """Store the states of many drives from another thread, as the recorder does; give a list to
    which each storing adds its milliseconds.
    """
    from robots.models import Robot
    from sessions.models import Session
    from sessions.recording.chunks import Chunk
    from sessions.recording.store import RecordStore, row_of

    robot = Robot.objects.get(name="past")
    visitor_id = Session.objects.values_list("visitor", flat=True).first()
    keys = [uuid.uuid4() for _ in range(DRIVES)]
    Session.objects.bulk_create(
        Session(pk=key, robot=robot, visitor_id=visitor_id, live_key=str(key), queued_at=now)
        for key in keys
    )
    chance, over, waits = random.Random(3), threading.Event(), []
    body = [msgspec.Raw(msgspec.json.encode(uneven(n, chance))) for n in range(4)]

    def record() -> None:
        store, quarter = RecordStore(), 0
        while not over.wait(0.25):
            at, number = time.time(), 4 * (quarter // 4)
            some = keys[quarter % 4 :: 4]
            chunks = [
                Chunk(str(key), "new", number, at, at, None, number + 3, at + 0.75, body)
                for key in some
            ]
            waits.append(1e3 * seconds(store.insert, [row_of(chunk) for chunk in chunks]))
            quarter += 1
        from django.db import connection

        connection.close()

    thread = threading.Thread(target=record)
    thread.start()
    try:
        yield waits
    finally:
        over.set()
        thread.join()


if __name__ == "__main__":
    sys.exit(main())
