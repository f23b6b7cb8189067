"""What became of a step in which the robot is driven, and which robot that is."""

import datetime
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from experiments.definition.schema import Condition
from experiments.models import Drive, Participant, StepVisit
from experiments.participation import assignment, places, progress
from experiments.participation.journey import JourneyPlace
from robots.models import Robot
from sessions.leases.traffic import living_sessions, traffic_at
from sessions.models import Session

# Not yet; on the robot or in its queue now; over, with the robot moved for them; over without.
Standing = Literal["never", "living", "moved", "unmoved"]


@dataclass(frozen=True)
class DriveStatus:
    """How the last session of a step stands. `reason` is the session's own, for a sentence."""

    standing: Standing
    session: Session | None = None
    outcome: str = ""
    reason: str = ""

    @property
    def robot(self) -> Robot | None:
        return self.session.robot if self.session is not None else None


NEVER = DriveStatus("never")


def driven(participant: Participant, place: JourneyPlace) -> DriveStatus:
    """Return what became of a place at which the robot is driven: from its drives, and from visits
    that never got the robot.
    """
    drives = _drives(participant).filter(visit=place.visit, round=place.round, step=place.step)
    done = [_of_drive(drive) for drive in drives]
    living = _living(participant, place)
    if living is not None:
        return DriveStatus("living", living)
    moved = next((one for one in done if one.standing == "moved"), None)
    return moved or (done[0] if done else _without_drive(participant, place))


def last_drive(participant: Participant, place: JourneyPlace) -> DriveStatus:
    """Return what questions after driving are about: the last drive of the visit up to a place's
    round, or nothing.
    """
    drive = _drives(participant).filter(visit=place.visit, round=place.round).first()
    return _of_drive(drive) if drive is not None else NEVER


def _drives(participant: Participant) -> Any:
    return (
        Drive.objects.filter(participant=participant)
        .select_related("session", "session__robot")
        .order_by("-granted_at")
    )


def _of_drive(drive: Drive) -> DriveStatus:
    session = drive.session
    if session.state != Session.State.ENDED:
        return DriveStatus("living", session)
    moved = drive.moved or session.first_motion_at is not None
    return DriveStatus(
        "moved" if moved else "unmoved",
        session,
        drive.outcome or session.outcome,
        session.outcome_reason,
    )


def _own_sessions(participant: Participant, place: JourneyPlace) -> Any:
    """Sessions of the participant with a robot of the study since they came to a place."""
    began = StepVisit.objects.filter(
        participant=participant, visit=place.visit, round=place.round, step=place.step
    ).values_list("began_at", flat=True)
    robots = [robot.pk for robot in robots_of(progress.open_conditions(participant))]
    since = began.first() or participant.created_at
    return (
        Session.objects.filter(visitor=participant.user, robot__in=robots, queued_at__gte=since)
        .select_related("robot")
        .order_by("-queued_at")
    )


def _living(participant: Participant, place: JourneyPlace) -> Session | None:
    found: Session | None = (
        _own_sessions(participant, place).exclude(state=Session.State.ENDED).first()
    )
    return found


def _without_drive(participant: Participant, place: JourneyPlace) -> DriveStatus:
    session = _own_sessions(participant, place).filter(granted_at=None, drive=None).first()
    return (
        DriveStatus("unmoved", session, session.outcome, session.outcome_reason)
        if session is not None
        else NEVER
    )


# --- which robot ----------------------------------------------------------------------------------


def robots_of(conditions: tuple[Condition, ...]) -> list[Robot]:
    """Return the robots in use with which one of these conditions can be driven."""
    wanted = {(condition.robot, condition.site) for condition in conditions}
    rows = Robot.objects.filter(enabled=True, practice=False, floor_plan__isnull=False)
    robots = rows.select_related("floor_plan").defer("floor_plan__image").order_by("name")
    return [robot for robot in robots if (series_of(robot), robot.floor_plan.name) in wanted]


def series_of(robot: Robot) -> str:
    """Return of which series a robot says it is; one that never said anything is of none."""
    series = (
        robot.presence.factsheet.get("series")
        if isinstance(robot.presence.factsheet, dict)
        else None
    )
    return series if isinstance(series, str) else ""


def robot_for(
    participant: Participant, now: datetime.datetime
) -> tuple[Robot | None, tuple[Condition, ...]]:
    """Return the robot that a participant is led to, and the conditions that they may get on it.

    Before the assignment it is of the series that the smallest cell asks for, so that the robot
    does not decide the cell; of several of its kind the one that is online and where fewest wait.
    """
    conditions = progress.open_conditions(participant)
    series = _series_wanted(participant, conditions, now)
    fitting = tuple(
        condition for condition in conditions if (condition.robot, condition.site) == series
    )
    robots = [robot for robot in robots_of(fitting) if robot.shown_to_visitors]
    own = set(
        Session.objects.filter(visitor=participant.user, robot__in=robots)
        .exclude(state=Session.State.ENDED)
        .values_list("robot_id", flat=True)
    )
    busy = [
        Session.objects.filter(robot=robot).exclude(state=Session.State.ENDED).count()
        for robot in robots
    ]
    ranked = sorted(
        zip(robots, busy, strict=True),
        key=lambda pair: (pair[0].pk not in own, not pair[0].is_online(now), pair[1]),
    )
    return (ranked[0][0] if ranked else None), fitting


def longest_wait(robots: Iterable[Robot], now: datetime.datetime) -> int:
    """Return for how many minutes at most a participant who came now would wait for a robot, in
    full; 0 when there is one to drive at once for each kind (series and site), or none online.
    """
    online = [robot for robot in robots if robot.shown_to_visitors and robot.is_online(now)]
    sessions, waits = living_sessions(online), dict[tuple[str, str], float]()
    for robot in online:
        kind = series_of(robot), robot.floor_plan.name
        minutes = traffic_at(robot, sessions.get(robot.pk, []), now).minutes or 0.0
        waits[kind] = min(minutes, waits.get(kind, math.inf))
    return math.ceil(max(waits.values(), default=0.0))


def _series_wanted(
    participant: Participant, conditions: tuple[Condition, ...], now: datetime.datetime
) -> tuple[str, str]:
    definition = participant.study.as_definition()
    kinds = {(condition.robot, condition.site) for condition in conditions}
    if len(kinds) > 1:
        chosen = assignment.choose(
            assignment.cells(definition, progress.access_of(participant)),
            places.held(participant.study, participant.kind, now),
            definition.allocation,
            participant.pk.int % 2**31,
        )
        first = (
            definition.condition(chosen.cell.conditions[participant.round])
            if chosen is not None
            else None
        )
        if first is not None:
            return first.robot, first.site
    return next(iter(kinds), ("", ""))
