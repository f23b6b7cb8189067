"""Reading many rows beside other work on the same connection."""

from collections.abc import Iterator
from typing import Any

from django.db.models import QuerySet


def iter_batches(rows: QuerySet[Any], size: int) -> Iterator[Any]:
    """Yield rows in their order, `size` at a time, so that no cursor is open while the caller has
    one of them.

    `QuerySet.iterator` keeps its cursor open. For SQLite that is one long read of an old snapshot:
    once another process has written, nothing can be written over this connection until the cursor
    is closed ("database is locked", at once and at every try), and a connection that is closed for
    that takes the cursor with it. Rows that are deleted before their batch are left out.
    """
    keys = list(rows.values_list("pk", flat=True))
    for first in range(0, len(keys), size):
        part = keys[first : first + size]
        found = {row.pk: row for row in rows.filter(pk__in=part)}
        yield from (found[key] for key in part if key in found)
