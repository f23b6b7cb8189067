"""Which users may drive, watch and operate a robot."""

import pytest
from django.contrib.auth import get_user_model
from django.contrib.auth.models import AnonymousUser, Permission

from accounts.models import User
from accounts.passwordless import create_guest
from robots import access
from robots.access import (
    has_a_robot,
    may_drive,
    may_manage,
    may_observe,
    may_operate,
    robots_visible_to,
)
from robots.models import Robot, RobotPermit
from sessions.protocol import Refused
from tests.support.robots import create_robot

pytestmark = pytest.mark.django_db
Kind, Access = RobotPermit.Privilege, Robot.Access


def person(name, **fields):
    return get_user_model().objects.create(username=name, **fields)


def robot(**fields):
    return create_robot(**({"name": "giraff", "title": "Giraff"} | fields))


def permit(user, robot, kind):
    RobotPermit.objects.create(robot=robot, user=user, kind=kind)


OPEN, INVITATION, TRAINED = {}, {"access": Access.INVITATION}, {"access": Access.TRAINED}
UNWATCHED, OFF, HIDDEN = (
    {"observers_allowed": False},
    {"enabled": False},
    {"shown_to_visitors": False},
)
YES, NO = "", "not_allowed"


def user_of(kind, robot):
    """Return a user in this relation to the robot."""
    if kind in {"nobody", "anonymous"}:
        return {"nobody": None, "anonymous": AnonymousUser()}[kind]
    flags = {"is_active": kind != "deactivated", "is_staff": kind in {"staff", "overseer"}}
    user = person(kind, **flags)
    if kind == "overseer":
        user.user_permissions.add(Permission.objects.get(codename="change_robot"))
    elif kind == "owner":
        Robot.objects.update(owner=user)
        robot.refresh_from_db()
    elif kind in Kind.values:
        permit(user, robot, kind)
    return user


@pytest.mark.parametrize(
    ("fields", "kind", "drive", "observe", "operate", "sees", "manages"),
    [
        (OPEN, "nobody", NO, NO, NO, True, False),
        (OPEN, "anonymous", NO, NO, NO, True, False),
        (OPEN, "deactivated", NO, NO, NO, True, False),
        (OPEN, "visitor", YES, YES, NO, True, False),
        (OPEN, "operator", YES, YES, YES, True, False),
        (INVITATION, "visitor", "not_invited", "not_invited", NO, False, False),
        (INVITATION, "staff", "not_invited", "not_invited", NO, False, False),
        (INVITATION, "trained", "not_invited", "not_invited", NO, True, False),
        (INVITATION, "invited", YES, YES, NO, True, False),
        (TRAINED, "invited", "not_trained", "not_trained", NO, True, False),
        (TRAINED, "trained", YES, YES, NO, True, False),
        (UNWATCHED, "visitor", YES, NO, NO, True, False),
        (INVITATION | UNWATCHED, "owner", YES, YES, YES, True, True),
        (INVITATION | UNWATCHED, "operator", YES, YES, YES, True, False),
        (INVITATION | UNWATCHED, "overseer", YES, YES, YES, True, True),
        (OFF, "visitor", "disabled", "disabled", NO, False, False),
        (OFF, "owner", "disabled", "disabled", YES, True, True),
        (OFF, "overseer", "disabled", "disabled", YES, True, True),
        (HIDDEN, "anonymous", NO, NO, NO, False, False),
        (HIDDEN, "visitor", "disabled", "disabled", NO, False, False),
        (HIDDEN, "trained", "disabled", "disabled", NO, False, False),
        (HIDDEN, "owner", YES, YES, YES, True, True),
        (HIDDEN, "operator", YES, YES, YES, True, False),
        (HIDDEN, "overseer", YES, YES, YES, True, True),
    ],
)
def test_robot_and_user_decide_what_is_allowed_and_why_not(
    fields, kind, drive, observe, operate, sees, manages
):
    one = robot(**fields)
    user = user_of(kind, one)
    for question, reason in ((may_drive, drive), (may_observe, observe), (may_operate, operate)):
        verdict = question(user, one)
        assert (bool(verdict), verdict.reason) == (not reason, reason), question.__name__
        if reason:
            Refused(reason=reason)  # the page knows it
    assert robots_visible_to(user).exists() is sees
    assert may_manage(user, one) is manages
    assert has_a_robot(user) is (sees and drive not in {NO, "disabled"})


def test_permit_is_for_one_robot_only():
    one, visitor = robot(access=Access.INVITATION), person("visitor")
    other = robot(name="rhodon", access=Access.INVITATION)
    permit(visitor, one, Kind.INVITED)
    assert may_drive(visitor, other).reason == "not_invited"


def test_guest_drives_no_hidden_robot(monkeypatch):
    hidden, guest = robot(access=Access.INVITATION, shown_to_visitors=False), person("guest")
    monkeypatch.setattr(access, "_guest_lists", [lambda _user, robots: robots])
    assert may_drive(guest, hidden).reason == "disabled"
    assert not has_a_robot(guest)


def test_visible_robots_depend_on_permits_ownership_and_role():
    visitor, owner = person("visitor"), person("owner")
    robot(name="open")
    invited = robot(name="invited", access=Access.INVITATION)
    robot(name="hidden", access=Access.TRAINED)
    robot(name="disabled", enabled=False, owner=owner)
    permit(visitor, invited, Kind.INVITED)
    permit(visitor, invited, Kind.TRAINED)

    def names(user):
        return sorted(robots_visible_to(user).values_list("name", flat=True))

    assert names(visitor) == ["invited", "open"]
    assert names(owner) == ["disabled", "open"]
    assert names(user_of("overseer", None)) == ["disabled", "hidden", "invited", "open"]
    assert names(AnonymousUser()) == ["open"]


def test_user_has_a_robot_if_one_is_visible_or_on_a_guest_list(monkeypatch):
    visitor, owner = person("visitor"), person("owner")
    closed = robot(access=Access.INVITATION, owner=owner)
    assert has_a_robot(owner)
    assert not any(has_a_robot(user) for user in (visitor, None, AnonymousUser()))
    invited = lambda user, robots: [one for one in robots if (user, one) == (visitor, closed)]
    monkeypatch.setattr(access, "_guest_lists", [invited])
    assert has_a_robot(visitor)
    Robot.objects.update(enabled=False)
    assert not has_a_robot(visitor)
    assert not has_a_robot(owner)


# --- accounts without a password ------------------------------------------------------------------


def guest(kind="participant"):
    return create_guest(kind)


def let_in(monkeypatch, kind, rule):
    monkeypatch.setitem(
        access._guest_rules, kind, lambda user, robots: [one for one in robots if rule(user, one)]
    )


def test_guest_without_a_rule_drives_no_robot(monkeypatch):
    monkeypatch.setattr(access, "_guest_rules", {})
    open_robot, visitor = robot(), guest("visitor")
    assert may_drive(visitor, open_robot).reason == "not_allowed"
    assert not robots_visible_to(visitor).exists()
    assert not has_a_robot(visitor)


def test_guest_drives_the_robots_of_their_kinds_rule_and_watches_none(monkeypatch):
    one, other = robot(), robot(name="rhodon")
    let_in(monkeypatch, "participant", lambda _user, robot: robot == one)
    let_in(monkeypatch, "visitor", lambda _user, _robot: False)
    participant = guest()
    assert may_drive(participant, one)
    assert may_drive(participant, other).reason == "not_allowed"
    assert may_drive(guest("visitor"), one).reason == "not_allowed"
    assert may_observe(participant, one).reason == "not_allowed"
    assert list(robots_visible_to(participant)) == [one]


def test_rule_for_guests_does_not_override_the_robots_access(monkeypatch):
    let_in(monkeypatch, "participant", lambda _user, _robot: True)
    for name, fields, reason in (
        ("off", {"enabled": False}, "disabled"),
        ("asked", {"access": Access.INVITATION}, "not_invited"),
        ("taught", {"access": Access.TRAINED}, "not_trained"),
    ):
        assert may_drive(guest(), robot(name=name, **fields)).reason == reason


def test_guest_with_staff_rights_manages_and_operates_nothing():
    user = guest()
    User.objects.filter(pk=user.pk).update(is_staff=True, is_superuser=True)
    user.refresh_from_db()
    owned = robot(owner=user)
    permit(user, owned, Kind.OPERATOR)
    assert not may_manage(user, owned)
    assert not may_operate(user, owned)
    assert not may_observe(user, owned)


@pytest.mark.parametrize("count", [2, 40])
@pytest.mark.parametrize("kind", ["guest", "visitor"])
def test_number_of_queries_does_not_grow_with_the_robots(
    count, kind, django_assert_max_num_queries
):
    for number in range(count):
        robot(name=f"robot-{number}", access=Access.INVITATION)
    user = guest("participant") if kind == "guest" else person("visitor")
    with django_assert_max_num_queries(6):
        assert not has_a_robot(user)
    with django_assert_max_num_queries(4):
        assert not list(robots_visible_to(user))
