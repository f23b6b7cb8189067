"""Attributes the fault for the end of a session, from the record; no other code decides this.

- *platform*: the server was away (`ServerAbsence`) when the visitor's connection was lost, or was
  still away at the end; or a session had lost its lease.
- *robot*: it was silent, or had a fault.
- *operator*: an operator of the robot ended the session.
- *visitor*: left, closed the page, or did not confirm presence.
- *network*: the connection was lost or never established, for none of these reasons.
- none (empty): the task was completed, or its time or the turn was over.

An absence explains a loss that begins during it or up to RETURN_SECONDS after it: by then a page
that is still open has reconnected.
"""

import math
from dataclasses import dataclass
from typing import Literal

Side = Literal["", "visitor", "network", "platform", "robot", "operator"]
WEB, MANAGER = "web_process", "session_manager"
LEASE_GONE = "lease_gone"
TERMS_UNREADABLE = "terms_unreadable"
RETURN_SECONDS = 60.0
# WebSocket close codes (RFC 6455, 7.4.1) of a page that was closed or left, not cut off.
CLOSED_BY_VISITOR = frozenset({1000, 1001})
LINK_OUTCOMES = frozenset({"connection_lost", "connection_refused"})
# Outcomes and reasons that decide it without further evidence; "" means every other reason.
_SIDES: dict[tuple[str, str], Side] = {
    ("robot_fault", ""): "robot",
    ("stopped_by_operator", ""): "operator",
    ("cancelled", ""): "visitor",
    ("timed_out", "idle"): "visitor",
    ("timed_out", "no_picture"): "network",
}


@dataclass(frozen=True)
class ServerAbsence:
    """A part of the server (WEB or MANAGER) was away from `since` to `until`, Unix seconds; `until`
    is None when it was still away when the session ended.
    """

    part: str
    since: float
    until: float | None = None


@dataclass(frozen=True)
class SessionEnd:
    """The evidence of a session's end; times are Unix seconds.

    `lost_at` is when the visitor's connection was lost for the last time, None if it was connected
    at the end; `close_code` is that of the page's socket, None if it was open at the end.
    """

    outcome: str
    reason: str
    begun_at: float
    ended_at: float
    lost_at: float | None = None
    close_code: int | None = None
    absences: tuple[ServerAbsence, ...] = ()


@dataclass(frozen=True)
class FaultAttribution:
    """The side at fault, and for the platform which part."""

    side: Side = ""
    part: str = ""


def fault_of(end: SessionEnd) -> FaultAttribution:
    """Attribute the end of a session."""
    if end.outcome in {"", "completed"}:
        return FaultAttribution()
    if end.reason in {LEASE_GONE, TERMS_UNREADABLE}:
        return FaultAttribution("platform", MANAGER)
    absence = _absence(end)
    if absence is not None:
        return FaultAttribution("platform", absence.part)
    known = _SIDES.get((end.outcome, end.reason)) or _SIDES.get((end.outcome, ""))
    if known is not None:
        return FaultAttribution(known)
    if end.outcome in LINK_OUTCOMES or end.lost_at is not None:
        return FaultAttribution("visitor" if end.close_code in CLOSED_BY_VISITOR else "network")
    return FaultAttribution()


def _absence(end: SessionEnd) -> ServerAbsence | None:
    """Return the absence that explains the end, if one does."""
    is_lost = end.outcome in LINK_OUTCOMES or end.lost_at is not None
    if not is_lost and end.outcome != "timed_out":
        return None
    lost = end.begun_at if end.outcome == "connection_refused" else end.lost_at
    for absence in end.absences:
        until = math.inf if absence.until is None else absence.until
        begins_then = lost is not None and absence.since <= lost <= until + RETURN_SECONDS
        meets_start = end.outcome == "connection_refused" and absence.since <= end.ended_at
        if until >= end.ended_at or begins_then or (meets_start and until >= end.begun_at):
            return absence
    return None
