"""Drives as the sessions of a dataset. Times are seconds since the grant, by the server's clock."""

import datetime
import math
from collections.abc import Sequence

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
from sessions.models import Session as Visit
from sessions.models import SessionEvent

NAN = float("nan")
WHOLE = Selection()
OPERATOR = "operator"  # events of the server that begin so were an operator's doing


def drives_of(study: Study, choice: Selection = WHOLE) -> QuerySet[Drive]:
    """Return the drives whose data are in a dataset: those of the withdrawn are not."""
    rows = Drive.objects.filter(participant__in=people_of(study, choice)).exclude(
        participant__status=Participant.Status.WITHDRAWN
    )
    return rows.select_related(
        "session", "session__robot", "participant", "participant__user"
    ).order_by("participant__code", "number", "granted_at")


def sessions_of(study: Study, drives: Sequence[Drive], release: Release) -> list[SessionRecord]:
    definition = study.as_definition()
    practice = definition.practice_keys
    touched = _touched([drive.session_id for drive in drives])
    faults = faults_of(drive.session for drive in drives)
    return [
        _session(
            drive,
            definition,
            release,
            is_practice=drive.step in practice,
            operator=drive.session_id in touched,
            fault=faults[drive.session_id],
        )
        for drive in drives
    ]


def _touched(sessions: Sequence[object]) -> set[object]:
    acts = SessionEvent.objects.filter(
        source=SessionEvent.Source.SERVER, type__startswith=OPERATOR, session__drive__isnull=False
    )
    return set(acts.values_list("session_id", flat=True)) & set(sessions)


def _session(
    drive: Drive,
    definition: StudyDefinition,
    release: Release,
    *,
    is_practice: bool,
    operator: bool,
    fault: FaultAttribution,
) -> SessionRecord:
    visit, condition = drive.session, definition.condition(drive.condition)
    names, about = release.names, visit.device or {}
    stopped = (
        visit.outcome == Visit.Outcome.STOPPED_BY_OPERATOR
        and visit.outcome_reason != "robot_disabled"
    )
    return SessionRecord(
        names.session(visit.pk),
        drive.participant.code,
        visit.robot.name,
        kind=drive.participant.kind,
        visit=drive.visit,
        round=drive.round + 1,
        practice=is_practice,
        site=condition.site if condition else "",
        condition=drive.condition,
        mismatch="|".join(drive.mismatches),
        **_assigned(condition),
        **_applied(drive),
        outcome=drive.outcome or visit.outcome,
        reason=_reason(visit, release, by_operator=stopped),
        os=device(about.get("os", ""), release, OS),
        browser=device(about.get("browser", ""), release, BROWSERS),
        network="" if release.choice.public else names.network(about.get("network", "")),
        first_frame=_first_frame(drive),
        first_motion=_first_motion(drive),
        ended=_after(drive, end_of(visit)),
        **_ends(drive),
        **_docking(drive),
        operator=operator or stopped,
        missing=visit.summary.get("missing", 0),
        excluded=drive.excluded_reason,
        fault_side=fault.side,
        fault_part=fault.part,
        **{f"{name}_version": drive.versions.get(name, "") for name in VERSIONED},
    )


def _reason(visit: Visit, release: Release, *, by_operator: bool) -> str:
    """What an operator wrote is free text, be it one word."""
    is_withheld = by_operator and not release.choice.has_text
    return "" if is_withheld else end_reason(visit.outcome_reason, release)


def _assigned(condition: Condition | None) -> dict[str, object]:
    if condition is None:
        return {}
    networks = {
        "control_network": spell(condition.network.control),
        "video_network": spell(condition.network.video),
    }
    return {
        "control_way": condition.control_way,
        "assist": condition.assist,
        "doors_closed": tuple(sorted(condition.doors_closed)),
        **networks,
    }


def _applied(drive: Drive) -> dict[str, str]:
    """What of the networks the robot says that it has put on."""
    found = {name: drive.applied.get(f"{name}_network") for name in ("control", "video")}
    return {
        f"{name}_applied": spell(msgspec.convert(report, LabReport).lab)
        for name, report in found.items()
        if report
    }


def _ends(drive: Drive) -> dict[str, float]:
    """How the robot stood at the beginning and at the end; NaN for what is not known."""
    found = {"began": drive.began_with, "ended": drive.ended_with}
    return {
        f"{name}_{word}": NAN if (value := stood.get(word)) is None else round(float(value), 6)
        for name, stood in found.items()
        for word in ("x", "y", "theta", "docked", "charge")
    }


def _docking(drive: Drive) -> dict[str, float]:
    """By which rule docking counted, and how often it was tried; NaN where there was none."""
    rule = (drive.assigned.get("track") or {}).get("docked")
    if rule is None:
        return {"docked_seconds": NAN, "dock_contacts": NAN}
    return {
        "docked_seconds": float(rule["seconds"]),
        "dock_contacts": float(drive.result.get("dock_contacts", NAN)),
    }


def granted(drive: Drive) -> float:
    """Return when the robot was granted, in Unix seconds: where a session's time begins."""
    return drive.granted_at.timestamp()


def _after(drive: Drive, at: datetime.datetime | None) -> float:
    return NAN if at is None else round(at.timestamp() - granted(drive), 6)


def _first_frame(drive: Drive) -> float:
    """What the task engine counted from; else when the page first showed the video, where there was
    no task.
    """
    started = drive.result.get("started")
    return (
        _after(drive, drive.exposed_at) if started is None else round(started - granted(drive), 6)
    )


def _first_motion(drive: Drive) -> float:
    """The session manager's note; one that it could not make, because it was away, is found in the
    states.
    """
    if drive.settled_at is not None and not drive.moved:
        return NAN
    noted = _after(drive, drive.session.first_motion_at)
    return _from_states(drive) if drive.moved and math.isnan(noted) else noted


def _from_states(drive: Drive) -> float:
    for chunk in STORED.chunks_of(drive.session_id):
        for state in chunk.states:
            if state.applied:
                at = round(state.stamp - (chunk.clock_offset or 0.0) - granted(drive), 6)
                return at if abs(at) < NEAR else NAN  # by a clock that nobody has set
    return NAN
