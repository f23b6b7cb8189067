"""The result of a step in which the robot is driven, and which robot that is."""

import datetime
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

from experiments.definition.schema import Condition
from experiments.models import Drive, Participant, StepVisit
from experiments.participation import progress
from experiments.participation.journey import JourneyPlace
from robots.models import Robot
from sessions.leases.traffic import living_sessions, traffic_at
from sessions.models import Session


@dataclass(frozen=True)
class DriveStatus:
    state: Literal["never", "living", "moved", "unmoved"] = "never"
    session: Session | None = None
    outcome: str = ""

    @property
    def robot(self) -> Robot | None:
        return self.session.robot if self.session is not None else None


def status_at(participant: Participant, place: JourneyPlace) -> DriveStatus:
    """Return the status of a drive, also from sessions that never got the robot."""
    done = [_of_drive(drive) for drive in _drives(participant).filter(**asdict(place))]
    sessions = _own_sessions(participant, place)
    living = sessions.exclude(state=Session.State.ENDED).first()
    if living is not None:
        return DriveStatus("living", living)
    moved = next((one for one in done if one.state == "moved"), None)
    if moved or done:
        return moved or done[0]
    refused = sessions.filter(granted_at=None, drive=None).first()
    return DriveStatus("unmoved", refused, refused.outcome) if refused else DriveStatus()


def last_drive(participant: Participant, place: JourneyPlace) -> DriveStatus:
    """Return the drive that questions at a place are about: the last one of its visit and round."""
    drive = _drives(participant).filter(visit=place.visit, round=place.round).first()
    return _of_drive(drive) if drive is not None else DriveStatus()


def _drives(participant: Participant) -> Any:
    rows = Drive.objects.filter(participant=participant).order_by("-granted_at")
    return rows.select_related("session", "session__robot")


def _of_drive(drive: Drive) -> DriveStatus:
    session = drive.session
    if session.state != Session.State.ENDED:
        return DriveStatus("living", session)
    outcome = drive.outcome or session.outcome
    return DriveStatus("moved" if drive.has_moved else "unmoved", session, outcome)


def _own_sessions(participant: Participant, place: JourneyPlace) -> Any:
    """Return the sessions of a participant with a robot of the study since they reached a place."""
    visits = StepVisit.objects.filter(participant=participant, **asdict(place))
    since = visits.values_list("began_at", flat=True).first() or participant.created_at
    robots = robots_of(progress.open_conditions(participant))
    rows = Session.objects.filter(visitor=participant.user, robot__in=robots, queued_at__gte=since)
    return rows.select_related("robot").order_by("-queued_at")


def robots_of(conditions: tuple[Condition, ...]) -> list[Robot]:
    wanted = {(condition.robot, condition.site) for condition in conditions}
    rows = Robot.objects.filter(enabled=True, practice=False, floor_plan__isnull=False)
    robots = rows.select_related("floor_plan").defer("floor_plan__image").order_by("name")
    return [robot for robot in robots if kind_of(robot) in wanted]


def kind_of(robot: Robot) -> tuple[str, str]:
    """Return a robot's series and site, by which conditions name it; empty where unknown."""
    return series_of(robot), robot.floor_plan.name if robot.floor_plan is not None else ""


def series_of(robot: Robot) -> str:
    factsheet = robot.presence.factsheet
    series = factsheet.get("series") if isinstance(factsheet, dict) else None
    return series if isinstance(series, str) else ""


def conditions_on_robot(participant: Participant) -> tuple[Condition, ...]:
    """Return the conditions that a participant may get on the robot of their next drive; none while
    the draw has yet to decide which robot that is.
    """
    conditions = progress.open_conditions(participant)
    kinds = {(condition.robot, condition.site) for condition in conditions}
    return conditions if len(kinds) == 1 else ()


def robot_for(
    participant: Participant, now: datetime.datetime
) -> tuple[Robot | None, tuple[Condition, ...]]:
    """Return the robot that a participant is led to, and the conditions that they may get on it. Of
    several alike, it is the one that they already have, else one that is online, with the fewest
    visitors.
    """
    conditions = conditions_on_robot(participant)
    robots = [robot for robot in robots_of(conditions) if robot.shown_to_visitors]
    sessions = Session.objects.filter(robot__in=robots).exclude(state=Session.State.ENDED)
    living = list(sessions.values_list("robot_id", "visitor_id"))
    own = {robot for robot, visitor in living if visitor == participant.user_id}
    visitors = Counter(robot for robot, _ in living)
    best = min(
        robots,
        key=lambda robot: (robot.pk not in own, not robot.is_online(now), visitors[robot.pk]),
        default=None,
    )
    return best, conditions


def longest_wait(robots: Iterable[Robot], now: datetime.datetime) -> int:
    """Return the maximal wait for a robot in full minutes, over the kinds (series and site); 0 when
    each kind has a free one, or none is online.
    """
    online = [robot for robot in robots if robot.shown_to_visitors and robot.is_online(now)]
    sessions, waits = living_sessions(online), dict[tuple[str, str], float]()
    for robot in online:
        kind = kind_of(robot)
        minutes = traffic_at(robot, sessions.get(robot.pk, []), now).minutes or 0.0
        waits[kind] = min(minutes, waits.get(kind, math.inf))
    return math.ceil(max(waits.values(), default=0.0))
