"""Who may drive, watch and operate a robot, whether or not it is online or in use."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from django.db.models import Q, QuerySet

from robots.models import Robot, RobotPermit

Reason = Literal["", "disabled", "not_invited", "not_trained", "not_allowed"]
# The permit that a robot's access requires, and the reason for a user without it.
_DEMANDS: dict[str, tuple[str, Reason]] = {
    Robot.Access.INVITATION: (RobotPermit.Privilege.INVITED, "not_invited"),
    Robot.Access.TRAINED: (RobotPermit.Privilege.TRAINED, "not_trained"),
}


@dataclass(frozen=True)
class Verdict:
    """Yes, or no with a reason of `session/refused`."""

    allowed: bool
    reason: Reason = ""

    def __bool__(self) -> bool:
        return self.allowed


YES = Verdict(allowed=True)
CHANGE_ROBOTS = "robots.change_robot"
Chosen = Callable[[Any, Sequence[Robot]], Iterable[Robot]]  # (user, robots) → robots for the user
_guest_lists: list[Chosen] = []
_guest_rules: dict[str, Chosen] = {}


def register_guest_list(invites: Chosen) -> None:
    """Let an app above this one invite visitors to drive (not to watch) robots that require an
    invitation. Idempotent.
    """
    if invites not in _guest_lists:
        _guest_lists.append(invites)


def register_guest_rule(kind: str, admits: Chosen) -> None:
    """Let an app above this one decide which robots guests of a kind (accounts.models.User.Kind)
    may drive, among those that the robots' access allows. Without a rule they may drive none.
    """
    _guest_rules[kind] = admits


def _no(reason: Reason) -> Verdict:
    return Verdict(allowed=False, reason=reason)


def manages_all_robots(user: Any) -> bool:
    """Tell whether a user is an administrator, or staff with Django's permission to change robots.

    Being staff is not enough: owners and researchers are staff too, for their own robots and data.
    """
    return bool(
        _is_known(user) and user.is_staff and not user.is_guest and user.has_perm(CHANGE_ROBOTS)
    )


def may_manage(user: Any, robot: Robot) -> bool:
    """Tell whether a user may change a robot, its keys, its doors and its permits: its owner, and
    users who manage all robots.
    """
    return bool(_is_known(user) and not user.is_guest) and (
        robot.owner_id == user.pk or manages_all_robots(user)
    )


def may_operate(user: Any, robot: Robot) -> Verdict:
    """Tell whether a user may stop, pause and message sessions and clear an emergency stop: users
    who manage the robot, and its operators.
    """
    if not _is_known(user) or user.is_guest:
        return _no("not_allowed")
    if may_manage(user, robot) or _has_permit(user, robot, RobotPermit.Privilege.OPERATOR):
        return YES
    return _no("not_allowed")


def may_drive(user: Any, robot: Robot) -> Verdict:
    """Tell whether a user may drive: by the robot's access, as its operator, or on a guest list.
    An account without a password also needs a guest rule that allows it.
    """
    return _verdicts(user, [robot])[robot.pk]


def may_drive_each(user: Any, robots: Iterable[Robot]) -> dict[Any, Verdict]:
    """Return `may_drive` for many robots, by their keys, in as many queries as for one."""
    asked = list(robots)
    prefetch_permits(user, asked)
    return _verdicts(user, asked)


def _verdicts(user: Any, robots: Sequence[Robot]) -> dict[Any, Verdict]:
    found = {robot.pk: _is_admitted(user, robot) for robot in robots}
    uninvited = [robot for robot in robots if found[robot.pk].reason == "not_invited"]
    for invites in _guest_lists if uninvited else ():
        found |= {robot.pk: YES for robot in invites(user, uninvited)}
    admitted = [robot for robot in robots if found[robot.pk]]
    if admitted and user.is_guest:
        rule = _guest_rules.get(user.kind)
        let_in = {robot.pk for robot in rule(user, admitted)} if rule is not None else set()
        found |= {robot.pk: _no("not_allowed") for robot in admitted if robot.pk not in let_in}
    return found


def _is_admitted(user: Any, robot: Robot) -> Verdict:
    if not _is_known(user):
        return _no("not_allowed")
    if not robot.enabled:
        return _no("disabled")
    is_open = robot.shown_to_visitors and robot.access == Robot.Access.OPEN
    if is_open or may_operate(user, robot):
        return YES
    if not robot.shown_to_visitors:
        return _no("disabled")
    kind, reason = _DEMANDS[robot.access]
    return YES if _has_permit(user, robot, kind) else _no(reason)


def may_observe(user: Any, robot: Robot) -> Verdict:
    """Tell whether a user may watch: its operators always, and where the robot allows observers,
    users who may drive without being on a guest list. Accounts without a password never may.
    """
    if not _is_known(user) or user.is_guest:
        return _no("not_allowed")
    if not robot.enabled:
        return _no("disabled")
    if may_operate(user, robot):
        return YES
    return _is_admitted(user, robot) if robot.observers_allowed else _no("not_allowed")


def has_a_robot(user: Any) -> bool:
    """Tell whether any enabled robot is visible to a user, or a guest list lets them drive one."""
    if not _is_known(user):
        return False
    by_invitation = Robot.objects.filter(
        enabled=True, shown_to_visitors=True, access=Robot.Access.INVITATION
    )
    return robots_visible_to(user).filter(enabled=True).exists() or any(
        may_drive_each(user, by_invitation).values()
    )


def robots_visible_to(user: Any) -> "QuerySet[Robot]":
    """Return the robots to show a user: their own, and the enabled ones that are open or for which
    they have a permit. A robot that is hidden from visitors is visible to its operators.

    Users who manage all robots see all, visitors without a login the open ones, and accounts
    without a password those that they may drive now.
    """
    if not _is_known(user):
        return Robot.objects.filter(enabled=True, shown_to_visitors=True, access=Robot.Access.OPEN)
    if user.is_guest:
        enabled = Robot.objects.filter(enabled=True, shown_to_visitors=True)
        rows = enabled.select_related("floor_plan").defer("floor_plan__image")
        verdicts = may_drive_each(user, rows)
        return enabled.filter(pk__in=[key for key, verdict in verdicts.items() if verdict])
    if manages_all_robots(user):
        return Robot.objects.all()
    permits = RobotPermit.objects.filter(user=user)
    operated = permits.filter(kind=RobotPermit.Privilege.OPERATOR).values("robot")
    admitted = Q(access=Robot.Access.OPEN) | Q(pk__in=permits.values("robot"))
    return Robot.objects.filter(
        Q(owner=user)
        | Q(enabled=True, shown_to_visitors=True) & admitted
        | Q(enabled=True, pk__in=operated)
    )


def _is_known(user: Any) -> bool:
    return bool(user is not None and user.is_authenticated and user.is_active)


def prefetch_permits(user: Any, robots: Iterable[Robot]) -> None:
    """Read the permits of a user for many robots in one query, and cache them in these objects."""
    asked = list(robots)
    if not _is_known(user) or all(robot.access == Robot.Access.OPEN for robot in asked):
        return
    found: dict[Any, set[str]] = {}
    rows = RobotPermit.objects.filter(user=user, robot__in=asked)
    for robot, kind in rows.values_list("robot_id", "kind"):
        found.setdefault(robot, set()).add(kind)
    for robot in asked:
        robot.permit_cache = (user.pk, frozenset(found.get(robot.pk, ())))


def _has_permit(user: Any, robot: Robot, kind: str) -> bool:
    if robot.permit_cache is not None and robot.permit_cache[0] == user.pk:
        return kind in robot.permit_cache[1]
    return RobotPermit.objects.filter(robot=robot, user=user, kind=kind).exists()
