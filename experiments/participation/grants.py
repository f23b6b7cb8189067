"""On what terms a participant gets a robot: the condition that they are assigned to, and all that
it fixes.

Called by sessions (sessions/leases/terms.py) in the process that grants the robot, perhaps by two
at once and again after one was killed: every answer is the same as the first. A participant is
assigned at the first grant, or on reaching instructions that only some conditions have.
Participants who were not exposed give up their place and are drawn again, unless they have learned
of their condition in another way.

Assignment does not rely on transactions. A draw is a row with a number that is unique in its study;
it considers the places of all draws before that number, so that of two participants drawn at once
the later draw is repeated. It is decided once it is stored: a participant's row takes it over
afterwards, by any process that finds one not taken over yet.
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
from experiments.definition.schema import Condition, StudyDefinition, as_stored
from experiments.definition.step import DriveStep
from experiments.models import Draw, Drive, Participant, ParticipantKind, Study
from experiments.participation import assignment, places, progress
from experiments.participation.assignment import Cell
from experiments.participation.drive_status import driven, series_of
from experiments.participation.layout import laid_out
from experiments.participation.robot_eligibility import is_lent
from experiments.recruitment import appointments
from experiments.versions import versions_of
from robots.access import may_operate
from robots.api.floorplan import DoorState
from robots.api.geometry import Pose2D
from robots.models import Robot
from sessions.leases.terms import NotGranted, Terms
from sessions.models import Session
from surveys.documents import spoken
from surveys.models import Answer

log = structlog.stdlib.get_logger(__name__)

GRACE_SECONDS = 120.0
# to connect, and to see the end: a turn is never over before the time limit of the task
SLACK_SECONDS = 180.0
# after which a robot's last state does not say any more how it stands; states are written every two
SAID_SECONDS = 5.0
ATTEMPTS = 200  # every failed one means that another participant was assigned meanwhile


class AssignmentContention(RuntimeError):
    """Another participant was assigned during every attempt."""


@dataclass(frozen=True)
class Standing:
    """A participant who is to drive a robot now, and what may await them on it."""

    participant: Participant
    definition: StudyDefinition
    step: DriveStep
    robot: Robot

    @property
    def assigned(self) -> Condition | None:
        return progress.wanted_condition(self.participant, self.definition)

    @property
    def cells(self) -> list[Cell]:
        access, number = progress.access_of(self.participant), self.participant.round
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
        condition = draw(standing.participant, standing.cells, now)
        if condition is None:
            raise NotGranted("full")
        if not is_for(condition, session.robot):
            raise NotGranted("not_allowed")
        return _begin(standing, condition, session, now)

    def claims(self, user: User, robot: Robot) -> bool:
        """Tell whether a user's current step of a study is a drive with this robot."""
        return standing_of(user, robot) is not None

    def may_watch(self, user: User, session: str) -> bool:
        """Tell whether a user is an owner or a researcher of a drive's study; viewers see
        pseudonymous data alone.
        """
        slug = Drive.objects.filter(session=session).values_list("participant__study__slug").first()
        return slug is not None and may(user, slug[0], "researcher")

    def shown(self, session: str) -> dict[str, Any]:
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
        condition = progress.wanted_condition(participant, definition)
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
    if standing.assigned is None and not places.free_cells(
        participant.study, participant.kind, standing.cells, now
    ):
        return "full"
    return (
        "not_allowed"
        if driven(participant, progress.place(participant)).standing == "moved"
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


def draw(
    participant: Participant, cells: Sequence[Cell], now: datetime.datetime
) -> Condition | None:
    """Draw the cell of a participant among some, unless they have one, and return the condition of
    their round; None when every cell is full.

    Raises:
        AssignmentContention: another participant was assigned during every attempt.
    """
    definition = participant.study.as_definition()
    for _ in range(ATTEMPTS):
        if (condition := progress.wanted_condition(participant, definition)) is not None:
            return condition
        try:
            # only so that PostgreSQL survives the refusal within a caller's transaction
            with transaction.atomic():
                drawn = _undone_draw(participant) or _new_draw(participant, cells, now)
        except IntegrityError:  # somebody else took the number, or drew for this participant
            continue
        if drawn is None:
            return None
        _apply(participant, drawn)
        participant.refresh_from_db()
    raise AssignmentContention(participant.study.slug)


def assign_reader(participant: Participant, now: datetime.datetime) -> Condition | None:
    """Draw the cell of a participant who is about to read what only some conditions say: among all
    that are open to them.
    """
    definition = participant.study.as_definition()
    cells = assignment.cells(definition, progress.access_of(participant))
    return draw(participant, cells, now)


def _undone_draw(participant: Participant) -> Draw | None:
    """Return a draw that another process has decided and not written into the participant's row."""
    found: Draw | None = participant.draws.filter(nth=participant.draws_applied + 1).first()
    return found


def _new_draw(
    participant: Participant, cells: Sequence[Cell], now: datetime.datetime
) -> Draw | None:
    study, kind = participant.study, participant.kind
    allocation = study.as_definition().allocation
    number, levels = places.next_number(study, kind), balance_levels(participant)
    chosen = assignment.choose(
        cells, places.held(study, kind, now), allocation, secrets.randbits(31), levels
    )
    if chosen is None:
        return None
    nth = participant.draws_applied + 1
    made: Draw = participant.draws.create(
        study=study,
        kind=kind,
        number=number,
        nth=nth,
        reason=Draw.DrawReason.FIRST if nth == 1 else Draw.DrawReason.AGAIN,
        cell=chosen.cell.key,
        best=list(chosen.best),
        counts=chosen.counts,
        scores=chosen.scores,
        levels=levels,
        best_probability=allocation.best_probability,
        seed=chosen.seed,
        at=now,
    )
    log.info("participant_assigned", study=study.pk, cell=made.cell, reason=made.reason)
    return made


def _apply(participant: Participant, drawn: Draw) -> None:
    """Write a draw into the participant's row, if no other process has."""
    study = participant.study.as_definition()
    cells = (*assignment.cells(study), *assignment.cells(study, "invitation"))
    order = next(cell.conditions for cell in cells if cell.key == drawn.cell)
    Participant.objects.filter(
        pk=participant.pk,
        draws_applied=drawn.nth - 1,
        stage__in=(Participant.Stage.UNASSIGNED, Participant.Stage.FREED),
    ).update(
        cell=drawn.cell,
        conditions=list(order),
        draws_applied=drawn.nth,
        stage=Participant.Stage.UNDER_WAY,
    )


def balance_levels(participant: Participant) -> dict[str, str]:
    """Return a participant's level of each balance factor of the study; empty without an answer."""
    found = {}
    for factor in participant.study.as_definition().allocation.balance:
        questionnaire, _point, item = factor.item.rpartition(".")
        value = (
            Answer.objects.filter(
                response__asked_at__participant=participant,
                response__questionnaire__slug=questionnaire,
                item=item,
            )
            .order_by("-response__started_at")
            .values_list("value", flat=True)
            .first()
            if questionnaire
            else participant.age
        )
        found[factor.item] = assignment.level_of(factor, value)
    return found


# --- the drive ------------------------------------------------------------------------------------


def _begin(
    standing: Standing, condition: Condition, session: Session, now: datetime.datetime
) -> Terms:
    participant, definition, seed = standing.participant, standing.definition, secrets.randbits(31)
    terms = terms_of(standing, condition, session.robot, seed)
    assigned = {
        "condition": as_stored(condition),
        "terms": msgspec.to_builtins(terms),
        "track": None,
        "start": as_stored(definition.start),
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
        "versions": versions_of(session.robot.presence.factsheet or {}, participant.study.sha256),
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
    """Return the doors that the server can move: those of a simulated site. A person closes a real
    door.
    """
    movable = "doors" in (robot.presence.factsheet or {}).get("capabilities", ())
    return (
        [door["name"] for door in robot.floor_plan.plan.get("doors", ())]
        if movable and robot.floor_plan
        else []
    )
