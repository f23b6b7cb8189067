"""The terms on which a participant gets a robot: the assigned condition, and all that it fixes.

Called by sessions (sessions/leases/terms.py) in the process that grants the robot, perhaps by two
processes at once and again after one was killed: every answer equals the first. Participants are
assigned at the first grant, or earlier: on reaching instructions that only some conditions have,
or a drive whose robot depends on the condition, which participants must not choose. Those who were
not exposed give up their place and are drawn again, unless they have learned of their condition in
another way.

Assignment does not rely on transactions. A draw is a row with a number that is unique in its study;
it considers the places of all draws before that number, so that of two participants drawn at once
the later draw is repeated. A stored draw is decided: any process that finds one which is not yet
applied writes it into the participant's row.
"""

import secrets
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

import msgspec
import structlog
from django.db import IntegrityError, transaction

from accounts import audit
from accounts.models import User
from experiments.access import may
from experiments.definition import conditions, start_condition
from experiments.definition.course import CourseError, lay_out
from experiments.definition.schema import Condition, StudyDefinition, as_stored
from experiments.definition.step import DriveStep
from experiments.models import Draw, Drive, Participant, ParticipantKind, Study
from experiments.participation import assignment, places, progress
from experiments.participation.drive_status import conditions_on_robot, kind_of, status_at
from experiments.participation.robot_eligibility import may_use
from experiments.versions import versions_of
from robots.access import may_operate
from robots.api import floorplan
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
MAX_REPORT_AGE_S = 5.0  # of a robot's last state; states are written every two seconds
ATTEMPTS = 200  # each failed one means that another participant was assigned at the same time


class AssignmentContention(RuntimeError):
    """Another participant was assigned during every attempt."""


@dataclass(frozen=True)
class PendingDrive:
    """A participant's current step, with a robot that fits; `assigned` is None without a place."""

    participant: Participant
    definition: StudyDefinition
    step: DriveStep
    robot: Robot
    assigned: Condition | None

    def why_not(self, now: datetime) -> str:
        one = self.participant
        if not progress.may_begin_drive(one, now):
            return "closed"
        access = progress.access_of(one)
        if not self.assigned and progress.is_full(one.study, access, now, one.kind):
            return "full"
        has_moved = status_at(one, progress.place(one)).state == "moved"
        return "not_allowed" if has_moved else ""


class StudyTerms:
    """The provider of terms (sessions.leases.terms.Provider) for participants of studies."""

    def why_not(self, user: User, robot: Robot, now: datetime) -> str:
        """Return `closed`, `full` or `not_allowed` for a participant who may not drive now,
        `reserved` for other visitors while a study has the robot; empty for all others.
        """
        drive = pending_drive(user, robot)
        if drive is not None:
            return drive.why_not(now)
        return "reserved" if _is_reserved(robot, now) and not may_operate(user, robot) else ""

    def not_ready(self, user: User, robot: Robot, now: datetime) -> str:
        """Return the unmet part of the start condition (definition/start_condition.py)."""
        drive = pending_drive(user, robot)
        return _unmet(drive, now) if drive is not None else ""

    def granted(self, session: Session, now: datetime) -> Terms | None:
        """Assign the participant, make their drive, and return the terms of the condition; None for
        a visitor without a study. Raises NotGranted when there is no place for them, or no course.
        """
        made = Drive.objects.filter(session=session).first()
        if made is not None:
            return msgspec.convert(made.assigned["terms"], Terms)
        drive = pending_drive(session.visitor, session.robot)
        if drive is None:
            return None
        condition = draw(drive.participant, now)
        if condition is None:
            raise NotGranted("full")
        if not is_for(condition, session.robot):
            raise NotGranted("not_allowed")
        return _begin(drive, condition, session, now)

    def claims(self, user: User, robot: Robot) -> bool:
        return pending_drive(user, robot) is not None

    def may_watch(self, user: User, session: str) -> bool:
        slug = Drive.objects.filter(session=session).values_list("participant__study__slug").first()
        return slug is not None and may(user, slug[0], "researcher")

    def shown(self, session: str) -> dict[str, Any]:
        row = Drive.objects.filter(session=session).values_list("shown", flat=True).first()
        return row or {}


def is_for(condition: Condition, robot: Robot) -> bool:
    kind = (condition.robot, condition.site)
    return not robot.practice and robot.floor_plan is not None and kind_of(robot) == kind


def pending_drive(user: User, robot: Robot) -> PendingDrive | None:
    """Return the drive for which a user may take a robot, in the study seen last."""
    return _pending_drives(user, [robot]).get(robot.pk)


def claimed(user: User, robots: Sequence[Robot]) -> list[Robot]:
    return [drive.robot for drive in _pending_drives(user, robots).values()]


def _pending_drives(user: User, robots: Sequence[Robot]) -> dict[Any, PendingDrive]:
    found: dict[Any, PendingDrive] = {}
    active = progress.of_user(user).filter(status=Participant.Status.ACTIVE)
    no_draft = active.exclude(study__status=Study.Status.DRAFT, kind=ParticipantKind.PARTICIPANT)
    for participant in no_draft.order_by("-seen_at"):
        definition = participant.study.as_definition()
        step = definition.drive(participant.step)
        if step is None:
            continue
        assigned = progress.wanted_condition(participant, definition)
        fitting = conditions_on_robot(participant)
        for robot in robots:
            if any(is_for(condition, robot) for condition in fitting):
                drive = PendingDrive(participant, definition, step, robot, assigned)
                found.setdefault(robot.pk, drive)
    return found


def invited_to(user: User, robots: Sequence[Robot]) -> list[Robot]:
    """Return the robots that a study has invited the user to drive now
    (robots.access.register_guest_list). For the many visitors without an invitation it costs one
    query, and reads no study.
    """
    own = progress.of_user(user).filter(status=Participant.Status.ACTIVE, access="invitation")
    if not own.exists():
        return []
    return [
        drive.robot
        for drive in _pending_drives(user, robots).values()
        if drive.participant.access == "invitation" and may_use(drive.definition.slug, drive.robot)
    ]


def _unmet(drive: PendingDrive, now: datetime) -> str:
    robots = Robot.objects.select_related("floor_plan").defer("floor_plan__image")
    robot = robots.get(pk=drive.robot.pk)
    if robot.floor_plan is None:
        return ""
    kind, definition = kind_of(robot), drive.definition
    courses = (one for one in definition.courses if (one.robot, one.site) == kind)
    course = next(courses, None)
    docks = [
        dock
        for dock in robot.floor_plan.plan.get("docks", ())
        if course and dock["type"] == course.robot and course.dock in {"", dock["name"]}
    ]
    if len(docks) != 1:
        return ""  # the site has no course, which is the reason that the grant gives
    pose = Pose2D(docks[0]["x"], docks[0]["y"], docks[0].get("theta", 0.0))
    return start_condition.unmet(definition.start, _fresh_snapshot(robot, now), pose)


def _fresh_snapshot(robot: Robot, now: datetime) -> start_condition.RobotSnapshot | None:
    """Return a robot's reported state; None when that is old, or of an earlier run of its agent."""
    presence = robot.presence
    report, seen_at = presence.report or {}, presence.last_seen_at
    is_fresh = seen_at is not None and (now - seen_at).total_seconds() <= MAX_REPORT_AGE_S
    is_current = bool(report) and report.get("boot", "") == presence.boot
    return start_condition.snapshot(report) if is_fresh and is_current else None


def _is_reserved(robot: Robot, now: datetime) -> bool:
    """Tell whether a study that is open now has exclusive use of the robot."""
    exclusive = Study.objects.filter(status=Study.Status.PUBLISHED, exclusive=True)
    return any(
        progress.is_open(study, now)
        and any(is_for(condition, robot) for condition in study.as_definition().conditions)
        and may_use(study.slug, robot)
        for study in exclusive
    )


def draw(participant: Participant, now: datetime) -> Condition | None:
    """Draw a cell for a participant, unless they have one, and return the condition of their round;
    None when every cell is full, AssignmentContention when other participants are drawn during
    every attempt.
    """
    definition = participant.study.as_definition()
    for _ in range(ATTEMPTS):
        if (condition := progress.wanted_condition(participant, definition)) is not None:
            return condition
        # a draw that another process has decided and not yet applied
        decided = participant.draws.filter(nth=participant.draws_applied + 1).first()
        try:
            # PostgreSQL: without it the error would abort the transaction of a caller
            with transaction.atomic():
                drawn = decided or _new_draw(participant, now)
        except IntegrityError:  # another process took the number, or drew for this participant
            continue
        if drawn is None:
            return None
        _apply(participant, drawn)
        participant.refresh_from_db()
    raise AssignmentContention(participant.study.slug)


def _new_draw(participant: Participant, now: datetime) -> Draw | None:
    study, kind = participant.study, participant.kind
    definition = study.as_definition()
    allocation, access = definition.allocation, progress.access_of(participant)
    number, levels = places.next_number(study, kind), balance_levels(participant)
    held, seed = places.held(study, kind, now), secrets.randbits(31)
    chosen = assignment.choose(assignment.cells(definition, access), held, allocation, seed, levels)
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
    stages = (Participant.Stage.UNASSIGNED, Participant.Stage.FREED)
    rows = Participant.objects.filter(pk=participant.pk, stage__in=stages)
    fields = {"cell": drawn.cell, "conditions": list(order), "draws_applied": drawn.nth}
    unapplied = rows.filter(draws_applied=drawn.nth - 1)
    unapplied.update(stage=Participant.Stage.UNDER_WAY, **fields)


def balance_levels(participant: Participant) -> dict[str, str]:
    """Return a participant's level of each balance factor of the study; empty without an answer."""
    found = {}
    for factor in participant.study.as_definition().allocation.balance:
        questionnaire, _point, item = factor.item.rpartition(".")
        value = participant.age
        if questionnaire:
            own = Answer.objects.filter(response__asked_at__participant=participant, item=item)
            answers = own.filter(response__questionnaire__slug=questionnaire)
            newest = answers.order_by("-response__started_at")
            value = newest.values_list("value", flat=True).first()
        found[factor.item] = assignment.level_of(factor, value)
    return found


def _begin(drive: PendingDrive, condition: Condition, session: Session, now: datetime) -> Terms:
    """Store the drive of a session that has just got the robot; return its terms. Of two processes
    that do so, the later one returns the stored terms.

    Raises:
        NotGranted: the site has no course for the study, or the participant has withdrawn.
    """
    participant, definition, seed = drive.participant, drive.definition, secrets.randbits(31)
    terms = terms_of(drive, condition, session.robot, seed)
    assigned = _assigned(drive, condition, session.robot, terms)
    before = Drive.objects.filter(participant=participant, step=participant.step).count()
    factsheet = session.robot.presence.factsheet or {}
    try:
        with transaction.atomic():  # as in draw
            Drive.objects.create(
                session=session,
                granted_at=now,
                participant=participant,
                **asdict(progress.place(participant)),
                number=before + 1,
                condition=condition.key,
                seed=seed,
                assigned=assigned,
                versions=versions_of(factsheet, participant.study.sha256),
            )
    except IntegrityError as error:  # another process has made it at the same moment
        made = Drive.objects.filter(session=session).first()
        if made is None:  # or the participant has withdrawn
            raise NotGranted("not_allowed") from error
        stored: Terms = msgspec.convert(made.assigned["terms"], Terms)
        return stored
    about = {"person": participant.user_id, "robot": session.robot, "study": definition.slug}
    audit.note("robot_granted", thing=session, detail=condition.key, at=now, **about)
    return terms


def _assigned(
    drive: PendingDrive, condition: Condition, robot: Robot, terms: Terms
) -> dict[str, Any]:
    """Return `Drive.assigned`; raises NotGranted when the robot's site has no course."""
    definition, track = drive.definition, None
    if not drive.step.is_practice:
        try:
            track = _track(definition, condition, robot)
        except CourseError as error:
            log.error("study_without_course", study=definition.slug, reason=str(error))
            raise NotGranted("not_allowed") from error
    return {
        "condition": as_stored(condition),
        "terms": msgspec.to_builtins(terms),
        "track": track,
        "start": as_stored(definition.start),
    }


def _track(study: StudyDefinition, condition: Condition, robot: Robot) -> dict[str, Any]:
    """Return the course as laid out now, for `Drive.assigned`; a CourseError when the robot's site
    has no plan, or not the one that the course needs.
    """
    if robot.floor_plan is None or not robot.floor_plan.plan:
        raise CourseError(f"{robot.name} has no floor plan of its site")
    try:
        plan = floorplan.decode(msgspec.json.encode(robot.floor_plan.plan))
    except floorplan.FloorPlanError as error:
        raise CourseError(f"the floor plan of {robot.floor_plan.name} cannot be read") from error
    track: dict[str, Any] = msgspec.to_builtins(lay_out(study, condition, plan))
    return track


def terms_of(drive: PendingDrive, condition: Condition, robot: Robot, seed: int) -> Terms:
    """Return the terms that a condition fixes; `seed` is that of its simulated network."""
    definition, step = drive.definition, drive.step
    wizard = None if step.is_practice else definition.wizard_of(condition.key)
    if wizard is not None:
        condition = conditions.without_driving(condition)
    limits = conditions.lease_limits(condition)
    study = {"slug": definition.slug, "version": definition.version}
    config = conditions.config(condition, _doors(robot), stamp=0.0, seed=seed)
    return Terms(
        label=spoken(step.title, drive.participant.language),
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
        doors=dict(config.doors),
        control_network=config.control_network,
        video_network=config.video_network,
        leaving_completes=step.is_practice,
        private=not definition.observers_allowed,
        study={"condition": condition.key, "step": step.key, **study},
    )


def _doors(robot: Robot) -> list[str]:
    """Return the doors that the server can move: those of a simulated site."""
    if "doors" not in (robot.presence.factsheet or {}).get("capabilities", ()):
        return []
    return [door["name"] for door in robot.floor_plan.plan.get("doors", ())]
