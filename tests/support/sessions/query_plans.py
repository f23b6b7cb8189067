"""Which sessions a query reads, by SQLite's plan for it."""

from django.db import connection
from django.test.utils import CaptureQueriesContext

INDEXES = ("session_queue", "telepresence_sessions_session_")


def session_reads(asked: CaptureQueriesContext, about: str = "") -> list[str]:
    """Return how sessions are read by each of these queries that mentions `about`."""
    found = []
    for query in list(asked):
        if about in query["sql"] and "telepresence_sessions_session" in query["sql"]:
            with connection.cursor() as cursor:
                cursor.execute(f"EXPLAIN QUERY PLAN {query['sql']}")
                found += [row[3] for row in cursor.fetchall()]
    names = [*INDEXES, "SCAN telepresence_sessions_session"]
    return [line for line in found if any(name in line for name in names)]
