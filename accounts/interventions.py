"""The log of interventions: stops of robots and their releases, changed limits, other versions of
the software, and tests of the safety functions.

They are entries of the audit log (accounts/audit.py) that are kept for longer, name people by their
role alone, and can be merged into the log of a site that was restored from an older backup.
"""

import datetime
import json
from collections.abc import Iterable, Iterator
from typing import Any

from django.core.exceptions import ValidationError
from django.db.models import QuerySet

from accounts.models import AuditEntry

# What the robot reports: obeyed stops, and what released the robot.
REPORTED = frozenset({"stopped", "estop", "estop_cleared", "released"})
SAFETY_TEST = "safety_test"
LIMITS_CHANGED, PROFILE_CHANGED = "limits_changed", "profile_changed"
AGENT_CHANGED, SITE_CHANGED = "agent_changed", "site_changed"
INTERVENTIONS = REPORTED | {
    SAFETY_TEST,
    LIMITS_CHANGED,
    PROFILE_CHANGED,
    AGENT_CHANGED,
    SITE_CHANGED,
    "session_stopped",
    "robot_disabled",
    "robot_enabled",
    "robot_freed",
}
COLUMNS = ("id", "at", "act", "role", "robot", "detail", "data")
BATCH = 500


def of_robot(name: str) -> "QuerySet[AuditEntry]":
    """Return the interventions at one robot, and those that concern all: the site's versions."""
    return AuditEntry.objects.filter(act__in=INTERVENTIONS, robot__in=(name, ""))


def store(rows: Iterable[AuditEntry]) -> int:
    """Store entries that are not stored yet; return their number."""
    by_key = {row.pk: row for row in rows}
    known = set(AuditEntry.objects.filter(pk__in=by_key).values_list("pk", flat=True))
    fresh = [row for key, row in by_key.items() if key not in known]
    AuditEntry.objects.bulk_create(fresh)
    return len(fresh)


def exported() -> Iterator[str]:
    """Yield a line of JSON for each intervention, the oldest first."""
    rows = AuditEntry.objects.filter(act__in=INTERVENTIONS).order_by("at")
    for values in rows.values(*COLUMNS).iterator(chunk_size=BATCH):
        yield json.dumps(values | {"id": str(values["id"]), "at": values["at"].isoformat()})


def merge(lines: Iterable[str]) -> int:
    """Add what `exported` wrote to this log, and return how many entries were missing in it. An
    entry that is here stays as it is.

    Raises:
        ValueError: a line is not one of an export; earlier ones may have been added.
    """
    added, batch = 0, []
    for number, line in enumerate(lines, 1):
        if line.strip():
            batch.append(_read(line, number))
        if len(batch) == BATCH:
            added, batch = added + store(batch), []
    return added + store(batch)


def _read(line: str, number: int) -> AuditEntry:
    try:
        values: dict[str, Any] = json.loads(line)
        row = AuditEntry(**{name: values[name] for name in COLUMNS})
        row.at = datetime.datetime.fromisoformat(values["at"])
        row.clean_fields(exclude=("actor", "person"))
    except (ValueError, TypeError, LookupError, ValidationError) as error:
        raise ValueError(f"line {number} is not an intervention: {error}") from error
    if row.act not in INTERVENTIONS:
        raise ValueError(f"line {number} is not an intervention: {row.act}")
    return row
