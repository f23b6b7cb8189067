"""On what terms a participant gets a robot: the condition that they are assigned to, and all that
it fixes.

Asked by sessions (sessions/leases/terms.py), in whichever process grants the robot, perhaps by two
of them at once and again after one was killed: every answer is the same as the first. A participant
is assigned at the first grant, or before: whoever reads instructions that only some conditions have
is drawn when they come to them, and keeps that cell. Of all others, who never moved the robot gave
their place back, and is drawn anew.

Nothing rests on transactions: a draw has a number that no other one of its study has, and the
places that it was decided on are those that stood there before that number, so that of two who are
drawn at the same moment one has to look again.
"""

import datetime
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import structlog
from django.db import IntegrityError, transaction

from accounts import audit
from accounts.models import User
from experiments.access import may
from experiments.definition import conditions, start_condition
from experiments.definition.course import CourseError
from experiments.definition.schema import Condition, StudyDefinition
from experiments.definition.step import DriveStep
from experiments.models import Drive, Participant, ParticipantKind, Study
from experiments.participation import assignment, places, progress
from experiments.participation.assignment import AssignmentChoice, Cell, Held
from experiments.participation.drive_status import driven, series_of
from experiments.participation.layout import laid_out
from experiments.participation.robot_eligibility import is_lent
from experiments.recruitment import appointments
from robots.access import may_operate
from robots.api.floorplan import DoorState
from robots.api.geometry import Pose2D
from robots.models import Robot
from sessions.leases.terms import NotGranted, Terms
from sessions.models import Session
from surveys.documents import spoken

log = structlog.stdlib.get_logger(__name__)

GRACE_SECONDS = 120.0
# to connect, and to see the end: a turn is never over before the time limit of the task
SLACK_SECONDS = 180.0
# after which a robot's last state does not say any more how it stands; states are written every two
SAID_SECONDS = 5.0
ATTEMPTS = 200  # every failed one means that somebody else was assigned meanwhile


class AssignmentContention(RuntimeError):
    """Somebody else was assigned under every attempt."""


@dataclass(frozen=True)
class Standing:
    """A participant who is to drive a robot now, and what may await them on it."""

    participant: Participant
    definition: StudyDefinition
    step: DriveStep
    robot: Robot

    @property
    def assigned(self) -> Condition | None:
        """The condition of this round, if it is assigned already."""
        return assigned(self.participant, self.definition)

    @property
    def cells(self) -> list[Cell]:
        """The cells that they may be assigned to on this robot."""
        access: assignment.Access = (
            "invitation" if self.participant.access == "invitation" else "open"
        )
        number = self.participant.round
        offered = []
        for cell in assignment.cells(self.definition, access):
            condition = (
                self.definition.condition(cell.conditions[number])
                if number < len(cell.conditions)
                else None
            )
            if condition is not None and is_for(condition, self.robot):
                offered.append(cell)
        return offered


class StudyTerms:
    """The provider of terms (sessions.leases.terms.Provider) for participants of studies."""

    def why_not(self, user: User, robot: Robot, now: datetime.datetime) -> str:
        """Return `closed`, `full`, `not_allowed` for a participant who may not drive now,
        `reserved` for who is none; empty for all others.
        """
        standing = standing_of(user, robot)
        if standing is None:
            return "reserved" if _is_reserved(robot, now) and not may_operate(user, robot) else ""
        return _why_not(standing, now)

    def not_ready(self, user: User, robot: Robot, now: datetime.datetime) -> str:
        """Return what of the study's start condition (definition/start_condition.py) does not hold;
        empty for a visitor without a study.
        """
        standing = standing_of(user, robot)
        return _unmet(standing, now) if standing is not None else ""

    def granted(self, session: Session, now: datetime.datetime) -> Terms | None:
        """Assign the participant, make their drive, and return the terms of the condition; None for
        who drives for themselves.

        Raises:
            NotGranted: there is no place for them, or no course.
        """
        drive = Drive.objects.filter(session=session).first()
        if drive is not None:
            return msgspec.convert(drive.assigned["terms"], Terms)
        standing = standing_of(session.visitor, session.robot)
        if standing is None:
            return None
        condition = standing.assigned or assign(standing, now)
        if condition is None:
            raise NotGranted("full")
        if not is_for(condition, session.robot):
            raise NotGranted("not_allowed")
        return _begin(standing, condition, session, now)

    def claims(self, user: User, robot: Robot) -> bool:
        """Tell whether somebody is to drive a robot for a study now."""
        return standing_of(user, robot) is not None

    def may_watch(self, user: User, session: str) -> bool:
        """Tell whether somebody is of the staff of a drive's study: its owners and researchers, but
        not its viewers, who see pseudonymous data alone.
        """
        slug = Drive.objects.filter(session=session).values_list("participant__study__slug").first()
        return slug is not None and may(user, slug[0], "researcher")

    def shown(self, session: str) -> dict[str, Any]:
        """Return what the page shows of the task of a session."""
        row = Drive.objects.filter(session=session).values_list("shown", flat=True).first()
        return row or {}


# --- who stands where -----------------------------------------------------------------------------


def is_for(condition: Condition, robot: Robot) -> bool:
    """Tell whether a condition is driven with a robot, where it is."""
    return (
        not robot.practice
        and condition.robot == series_of(robot)
        and robot.floor_plan is not None
        and condition.site == robot.floor_plan.name
    )


def standing_of(user: User, robot: Robot) -> Standing | None:
    """Return in which study somebody is to drive a robot now: where they were seen last; None when
    in none.
    """
    return _participation_by_robot(user, [robot]).get(robot.pk)


def claimed(user: User, robots: Sequence[Robot]) -> list[Robot]:
    """Return the robots that the user's current step of a study is about."""
    return [standing.robot for standing in _participation_by_robot(user, robots).values()]


def _participation_by_robot(user: User, robots: Sequence[Robot]) -> dict[Any, Standing]:
    found: dict[Any, Standing] = {}
    for participant in (
        progress.of_user(user).filter(status=Participant.Status.ACTIVE).order_by("-seen_at")
    ):
        if (
            participant.study.status == Study.Status.DRAFT
            and participant.kind == ParticipantKind.PARTICIPANT
        ):
            continue
        definition = participant.study.as_definition()
        step = definition.drive(participant.step)
        if step is None:
            continue
        condition = assigned(participant, definition)
        for robot in robots:
            standing = Standing(participant, definition, step, robot)
            if is_for(condition, robot) if condition is not None else standing.cells:
                found.setdefault(robot.pk, standing)
    return found


def invited_to(user: User, robots: Sequence[Robot]) -> list[Robot]:
    """Return the robots that a study has invited the user to drive now
    (robots.access.register_guest_list).

    Called for every visitor to whom robots by invitation are shown: without an invitation it costs
    one query, and reads no study.
    """
    if (
        not progress.of_user(user)
        .filter(status=Participant.Status.ACTIVE, access="invitation")
        .exists()
    ):
        return []
    return [
        standing.robot
        for standing in _participation_by_robot(user, robots).values()
        if standing.participant.access == "invitation"
        and is_lent(standing.robot, standing.definition.slug)
    ]


def _why_not(standing: Standing, now: datetime.datetime) -> str:
    participant = standing.participant
    if not progress.is_open(participant.study, now) or not appointments.may_drive(participant, now):
        return "closed"
    if (
        standing.assigned is None
        and _choose(standing.cells, _held(participant, now), standing.definition, 0) is None
    ):
        return "full"
    return (
        "not_allowed"
        if driven(participant, progress.place(participant)).standing == "exposed"
        else ""
    )


def _unmet(standing: Standing, now: datetime.datetime) -> str:
    robot = (
        Robot.objects.select_related("floor_plan")
        .defer("floor_plan__image")
        .get(pk=standing.robot.pk)
    )
    plan = robot.floor_plan.plan if robot.floor_plan is not None else {}
    courses = (
        one
        for one in standing.definition.courses
        if robot.floor_plan and (one.robot, one.site) == (series_of(robot), robot.floor_plan.name)
    )
    course = next(courses, None)
    docks = [
        dock
        for dock in plan.get("docks", ())
        if course and dock["type"] == course.robot and course.dock in {"", dock["name"]}
    ]
    if len(docks) != 1:
        return ""  # no course is laid out there: the grant says so
    dock = Pose2D(docks[0]["x"], docks[0]["y"], docks[0].get("theta", 0.0))
    return start_condition.unmet(standing.definition.start, said_lately(robot, now), dock)


def said_lately(robot: Robot, now: datetime.datetime) -> start_condition.RobotSnapshot | None:
    """Return how a robot stands as it last said; None when that is some seconds old, or from a run
    of its agent that is over.
    """
    fresh = (
        robot.presence.last_seen_at is not None
        and (now - robot.presence.last_seen_at).total_seconds() <= SAID_SECONDS
    )
    report = robot.presence.report or {}
    return (
        start_condition.snapshot(report)
        if fresh and report and report.get("boot", "") == robot.presence.boot
        else None
    )


def _is_reserved(robot: Robot, now: datetime.datetime) -> bool:
    """Tell whether a study that is open now keeps the robot to its participants."""
    exclusive = Study.objects.filter(status=Study.Status.PUBLISHED, exclusive=True)
    return any(
        progress.is_open(study, now)
        and any(is_for(condition, robot) for condition in study.as_definition().conditions)
        and is_lent(robot, study.slug)
        for study in exclusive
    )


# --- assignment -----------------------------------------------------------------------------------


def assign(standing: Standing, now: datetime.datetime) -> Condition | None:
    """Draw the cell of a participant, unless they have one, and return the condition of their
    round; None when every cell is full.

    Raises:
        AssignmentContention: somebody else was assigned under every attempt.
    """
    return draw(standing.participant, standing.cells, now)


def assigned(participant: Participant, definition: StudyDefinition) -> Condition | None:
    """Return the condition of a participant's round, if it is assigned already."""
    if not progress.has_place(participant):
        return None
    return progress.wanted_condition(participant, definition)


def draw(
    participant: Participant, cells: Sequence[Cell], now: datetime.datetime
) -> Condition | None:
    """Draw the cell of a participant among some, unless they have one, and return the condition of
    their round; None when every cell is full.

    Raises:
        AssignmentContention: somebody else was assigned under every attempt.
    """
    definition = participant.study.as_definition()
    for _ in range(ATTEMPTS):
        if (condition := assigned(participant, definition)) is not None:
            return condition
        held = _held(participant, now)
        chosen = _choose(cells, held, definition, secrets.randbits(31))
        if chosen is None:
            return None
        if _store(participant, chosen, 1 + max((number for number, _ in held), default=0), now):
            log.info("participant_assigned", study=participant.study_id, cell=chosen.cell.key)
        participant.refresh_from_db()
    raise AssignmentContention(participant.study.slug)


def assign_reader(participant: Participant, now: datetime.datetime) -> Condition | None:
    """Draw the cell of a participant who is about to read what only some conditions say: among all
    that are open to them.
    """
    definition = participant.study.as_definition()
    cells = assignment.cells(definition, progress.access_of(participant))
    return draw(participant, cells, now)


def _held(participant: Participant, now: datetime.datetime) -> list[tuple[int, Held]]:
    """Return (number of the draw, place) of everybody of the study and kind who was ever
    assigned.
    """
    return places.numbered(participant.study, participant.kind, now)


def _choose(
    cells: Sequence[Cell], held: list[tuple[int, Held]], definition: StudyDefinition, seed: int
) -> AssignmentChoice | None:
    return assignment.choose(cells, [place for _, place in held], definition.allocation.quota, seed)


def _store(
    participant: Participant, chosen: AssignmentChoice, number: int, now: datetime.datetime
) -> bool:
    """Write a draw down if its number is still free and nobody else, in another process, has drawn
    for the same participant.
    """
    before = Participant.objects.filter(
        pk=participant.pk, stage=participant.stage, drawn_as=participant.drawn_as
    )
    try:
        # only so that PostgreSQL survives the refusal within a caller's transaction
        with transaction.atomic():
            return bool(
                before.update(
                    cell=chosen.cell.key,
                    conditions=list(chosen.cell.conditions),
                    candidates=list(chosen.candidates),
                    draw_seed=chosen.seed,
                    drawn_as=f"{participant.study_id}:{participant.kind}:{number}",
                    assigned_at=now,
                    stage=Participant.Stage.UNDER_WAY,
                )
            )
    except IntegrityError:
        return False


# --- the drive ------------------------------------------------------------------------------------


def _begin(
    standing: Standing, condition: Condition, session: Session, now: datetime.datetime
) -> Terms:
    participant, definition, seed = standing.participant, standing.definition, secrets.randbits(31)
    terms = terms_of(standing, condition, session.robot, seed)
    assigned = {
        "condition": msgspec.to_builtins(condition),
        "terms": msgspec.to_builtins(terms),
        "track": None,
        "start": msgspec.to_builtins(definition.start),
    }
    if not standing.step.is_practice:
        try:
            assigned["track"] = laid_out(definition, condition, session.robot)
        except CourseError as error:
            log.error("study_without_course", study=definition.slug, reason=str(error))
            raise NotGranted("not_allowed") from error
    here = {"step": participant.step, "visit": participant.visit, "round": participant.round}
    number = 1 + Drive.objects.filter(participant=participant, step=participant.step).count()
    fields = {
        **here,
        "participant": participant,
        "number": number,
        "condition": condition.key,
        "seed": seed,
        "assigned": assigned,
    }
    try:
        with transaction.atomic():  # as above
            Drive.objects.create(session=session, granted_at=now, **fields)
    except IntegrityError as error:  # another process has made it at the same moment
        made = Drive.objects.filter(session=session).first()
        if made is None:  # or the participant has withdrawn
            raise NotGranted("not_allowed") from error
        stored: Terms = msgspec.convert(made.assigned["terms"], Terms)
        return stored
    audit.note(
        "robot_granted",
        person=participant.user_id,
        robot=session.robot,
        study=definition.slug,
        thing=session,
        detail=condition.key,
        at=now,
    )
    return terms


def terms_of(standing: Standing, condition: Condition, robot: Robot, seed: int) -> Terms:
    """Return what a condition fixes for a drive; `seed` is that of its network's chance."""
    participant, step = standing.participant, standing.step
    wizard = None if step.is_practice else standing.definition.wizard_of(condition.key)
    if wizard is not None:
        condition = conditions.without_driving(condition)
    limits, config = (
        conditions.lease_limits(condition),
        conditions.config(condition, _doors(robot), stamp=0.0, seed=seed),
    )
    doors: dict[str, DoorState] = dict(config.doors)
    return Terms(
        label=spoken(step.title, participant.language),
        driver="visitor" if wizard is None else "wizard",
        linear=limits.linear,
        angular=limits.angular,
        assist=condition.assist,
        actions=tuple(sorted(conditions.allowed_actions(condition))),
        controllers=tuple(condition.controllers),
        control_way=condition.control_way,
        interface=condition.interface,
        turn_seconds=step.minutes * 60.0 + SLACK_SECONDS,
        grace_seconds=GRACE_SECONDS,
        idle_seconds=condition.idle_seconds or 0.0,
        doors=doors,
        control_network=config.control_network,
        video_network=config.video_network,
        leaving_completes=step.is_practice,
        private=not standing.definition.observers_allowed,
        study={
            "slug": standing.definition.slug,
            "version": standing.definition.version,
            "condition": condition.key,
            "step": step.key,
        },
    )


def _doors(robot: Robot) -> list[str]:
    """Return the doors that the server can move: those of a simulated site. A real door is
    somebody's to close.
    """
    movable = "doors" in (robot.presence.factsheet or {}).get("capabilities", ())
    return (
        [door["name"] for door in robot.floor_plan.plan.get("doors", ())]
        if movable and robot.floor_plan
        else []
    )
