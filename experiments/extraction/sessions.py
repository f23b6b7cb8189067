"""Drives as the sessions of a dataset. Times are seconds since the grant, by the server's clock."""

import datetime
import math
from collections.abc import Collection, Sequence

import msgspec
from django.db.models import QuerySet

from experiments.dataset.levels import VERSIONED
from experiments.dataset.records import SessionRecord
from experiments.definition.schema import Condition, StudyDefinition
from experiments.extraction.allow_list import BROWSERS, OS, device, end_reason
from experiments.extraction.forms import NEAR, Release
from experiments.extraction.people import people_of
from experiments.extraction.selection import Selection
from experiments.extraction.states import STORED
from experiments.models import Drive, Participant, Study
from robots.api.messages import LabReport
from robots.api.network_words import spell
from sessions.leases.absences import end_of, faults_of
from sessions.leases.fault_side import FaultAttribution
from sessions.models import Session as Visit, SessionEvent
from sessions.visitor_motion import VisitorMotion

NAN = math.nan
WHOLE = Selection()


def drives_of(study: Study, choice: Selection = WHOLE) -> QuerySet[Drive]:
    """Return the drives whose data are in a dataset: all but those of participants who withdrew."""
    rows = Drive.objects.filter(participant__in=people_of(study, choice))
    rows = rows.exclude(participant__status=Participant.Status.WITHDRAWN)
    related = rows.select_related("session__robot", "participant__user")
    # numbers are no order: each step counts its own drives
    return related.order_by("participant__code", "granted_at", "number")


def sessions_of(study: Study, drives: Sequence[Drive], release: Release) -> list[SessionRecord]:
    definition = study.as_definition()
    rows = SessionEvent.objects.filter(source=SessionEvent.Source.SERVER)
    acts = rows.filter(type__startswith="operator", session__drive__isnull=False)
    with_operator = set(acts.values_list("session_id", flat=True))
    faults = faults_of(drive.session for drive in drives)
    return [
        _session(one, definition, release, faults[one.session_id], with_operator) for one in drives
    ]


def _session(
    drive: Drive,
    definition: StudyDefinition,
    release: Release,
    fault: FaultAttribution,
    with_operator: Collection[object],
) -> SessionRecord:
    visit, condition = drive.session, definition.condition(drive.condition)
    names, about = release.names, visit.device or {}
    by_operator = visit.outcome == Visit.Outcome.STOPPED_BY_OPERATOR
    stopped = by_operator and visit.outcome_reason != "robot_disabled"
    # what an operator wrote is free text, even if it is one word
    is_withheld = stopped and not release.choice.has_text
    return SessionRecord(
        names.session(visit.pk),
        drive.participant.code,
        visit.robot.name,
        kind=drive.participant.kind,
        visit=drive.visit,
        round=drive.round + 1,
        practice=drive.step in definition.practice_keys,
        condition=drive.condition,
        mismatch="|".join(drive.mismatches),
        **_assigned(condition),
        **_applied(drive),
        outcome=drive.outcome or visit.outcome,
        reason="" if is_withheld else end_reason(visit.outcome_reason, release),
        os=device(about.get("os", ""), release, OS),
        browser=device(about.get("browser", ""), release, BROWSERS),
        network="" if release.choice.public else names.network(about.get("network", "")),
        first_frame=_first_frame(drive),
        first_motion=_first_motion(drive),
        ended=_after(drive, end_of(visit)),
        **_ends(drive),
        **_docking(drive),
        operator=stopped or drive.session_id in with_operator,
        missing=visit.summary.get("missing", 0),
        excluded=drive.excluded_reason,
        excluded_at=_excluded_at(drive, release),
        fault_side=fault.side,
        fault_part=fault.part,
        **{f"{name}_version": drive.versions.get(name, "") for name in VERSIONED},
    )


def _assigned(condition: Condition | None) -> dict[str, object]:
    if condition is None:
        return {}
    return {
        "site": condition.site,
        "control_way": condition.control_way,
        "assist": condition.assist,
        "doors_closed": tuple(sorted(condition.doors_closed)),
        "control_network": spell(condition.network.control),
        "video_network": spell(condition.network.video),
    }


def _applied(drive: Drive) -> dict[str, str]:
    found = {name: drive.applied.get(f"{name}_network") for name in ("control", "video")}
    return {
        f"{name}_applied": spell(msgspec.convert(report, LabReport).lab)
        for name, report in found.items()
        if report
    }


def _ends(drive: Drive) -> dict[str, float]:
    """Return the robot's state at the beginning and at the end; NaN for unknown values."""
    found = {"began": drive.began_with, "ended": drive.ended_with}
    return {
        f"{name}_{word}": NAN if (value := known.get(word)) is None else round(float(value), 6)
        for name, known in found.items()
        for word in ("x", "y", "theta", "docked", "charge")
    }


def _docking(drive: Drive) -> dict[str, float]:
    """Return the rule of docking and the number of attempts, where there was such a rule."""
    rule = (drive.assigned.get("track") or {}).get("docked")
    if rule is None:
        return {}
    contacts = float(drive.result.get("dock_contacts", NAN))
    return {"docked_seconds": float(rule["seconds"]), "dock_contacts": contacts}


def _excluded_at(drive: Drive, release: Release) -> str:
    """Return when a researcher excluded a drive: what was known of the results by then."""
    at = drive.excluded_at
    if at is None:
        return ""
    return f"{at:%Y-%m-%d}" if release.choice.public else f"{at:%Y-%m-%d %H:%M}"


def granted(drive: Drive) -> float:
    """Return the time of the grant in Unix seconds, from which the times of a session count."""
    return drive.granted_at.timestamp()


def _after(drive: Drive, at: datetime.datetime | None) -> float:
    return NAN if at is None else round(at.timestamp() - granted(drive), 6)


def _first_frame(drive: Drive) -> float:
    """Return the time from which the task counted; without a task, of the first video frame."""
    started = drive.result.get("started")
    if started is not None:
        return float(round(started - granted(drive), 6))
    return _after(drive, drive.exposed_at)


def _first_motion(drive: Drive) -> float:
    """Return the session manager's note; without one, the time that the states show, or that of
    their reception where the robot's clock was never set.
    """
    if drive.settled_at is not None and not drive.moved:
        return NAN
    noted = _after(drive, drive.session.first_motion_at)
    if not drive.moved or not math.isnan(noted):
        return noted
    motion = VisitorMotion()
    for chunk in STORED.chunks_of(drive.session_id):
        for state in chunk.states:
            if motion.take(state):
                at = state.stamp - (chunk.clock_offset or 0.0) - granted(drive)
                received = chunk.received_at - granted(drive)
                return round(at if abs(at) < NEAR else received, 6)
    return NAN
