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


def overseer(name="staff"):
    user = person(name, is_staff=True)
    user.user_permissions.add(Permission.objects.get(codename="change_robot"))
    return user


def robot(**fields):
    return create_robot(**({"name": "giraff", "title": "Giraff"} | fields))


def permit(user, robot, kind):
    RobotPermit.objects.create(robot=robot, user=user, kind=kind)


def test_signed_in_visitor_drives_and_watches_an_open_robot():
    visitor = person("visitor")
    assert may_drive(visitor, robot())
    assert may_observe(visitor, Robot.objects.get())


@pytest.mark.parametrize("user", [None, AnonymousUser()])
def test_visitor_without_login_may_do_nothing(user):
    open_robot = robot()
    for question in (may_drive, may_observe, may_operate):
        assert question(user, open_robot).reason == "not_allowed"


def test_deactivated_user_may_not_drive():
    assert may_drive(person("gone", is_active=False), robot()).reason == "not_allowed"


@pytest.mark.parametrize(
    ("access", "kind", "reason"),
    [
        (Access.INVITATION, Kind.INVITED, "not_invited"),
        (Access.TRAINED, Kind.TRAINED, "not_trained"),
    ],
)
def test_closed_robot_needs_its_kind_of_permit(access, kind, reason):
    closed, visitor = robot(access=access), person("visitor")
    other = Kind.TRAINED if kind == Kind.INVITED else Kind.INVITED
    permit(visitor, closed, other)
    assert may_drive(visitor, closed).reason == reason
    assert may_observe(visitor, closed).reason == reason
    permit(visitor, closed, kind)
    assert may_drive(visitor, closed)
    assert may_observe(visitor, closed)


def test_permit_is_for_one_robot_only():
    one, visitor = robot(access=Access.INVITATION), person("visitor")
    other = robot(name="rhodon", access=Access.INVITATION)
    permit(visitor, one, Kind.INVITED)
    assert may_drive(visitor, other).reason == "not_invited"


def test_owner_operator_and_overseer_operate_drive_and_watch_a_closed_robot():
    owner, operator, visitor = person("owner"), person("operator"), person("visitor")
    closed = robot(owner=owner, access=Access.INVITATION, observers_allowed=False)
    permit(operator, closed, Kind.OPERATOR)
    for user in (owner, operator, overseer()):
        assert may_operate(user, closed)
        assert may_drive(user, closed)
        assert may_observe(user, closed)
    assert may_operate(visitor, closed).reason == "not_allowed"


def test_robot_without_observers_can_be_driven_and_not_watched():
    private, visitor = robot(observers_allowed=False), person("visitor")
    assert may_drive(visitor, private)
    assert may_observe(visitor, private).reason == "not_allowed"


def test_disabled_robot_can_only_be_operated():
    staff, disabled = overseer(), robot(enabled=False)
    assert may_drive(staff, disabled).reason == "disabled"
    assert may_observe(staff, disabled).reason == "disabled"
    assert may_operate(staff, disabled)


def test_hidden_robot_is_visible_only_to_owner_operators_and_overseers():
    owner, operator, visitor = person("owner"), person("operator"), person("visitor")
    hidden = robot(owner=owner, shown_to_visitors=False)
    permit(operator, hidden, Kind.OPERATOR)
    permit(visitor, hidden, Kind.TRAINED)
    for user in (owner, operator, overseer()):
        assert may_drive(user, hidden)
        assert may_observe(user, hidden)
        assert robots_visible_to(user).exists()
        assert has_a_robot(user)
    for user in (visitor, person("other")):
        assert may_drive(user, hidden).reason == "disabled"
        assert may_observe(user, hidden).reason == "disabled"
        assert not robots_visible_to(user).exists()
        assert not has_a_robot(user)
    assert not robots_visible_to(AnonymousUser()).exists()


def test_guest_drives_no_hidden_robot(monkeypatch):
    hidden, guest = robot(access=Access.INVITATION, shown_to_visitors=False), person("guest")
    monkeypatch.setattr(access, "_guest_lists", [lambda _user, robots: robots])
    assert may_drive(guest, hidden).reason == "disabled"
    assert not has_a_robot(guest)


def test_every_reason_is_known_to_the_page():
    closed = robot(access=Access.TRAINED, enabled=False)
    for user in (None, person("visitor")):
        for question in (may_drive, may_observe, may_operate):
            Refused(reason=question(user, closed).reason)


def test_visible_robots_depend_on_permits_ownership_and_role():
    visitor, owner, staff = person("visitor"), person("owner"), overseer()
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
    assert names(staff) == ["disabled", "hidden", "invited", "open"]
    assert names(AnonymousUser()) == ["open"]


def test_staff_without_permission_neither_operate_nor_see_other_robots():
    staff = person("staff", is_staff=True)
    closed = robot(owner=person("owner"), access=Access.INVITATION)
    assert may_operate(staff, closed).reason == "not_allowed"
    assert may_drive(staff, closed).reason == "not_invited"
    assert not may_manage(staff, closed)
    assert not robots_visible_to(staff).exists()


def test_operator_manages_no_robot():
    operator, one = person("operator", is_staff=True), robot()
    permit(operator, one, Kind.OPERATOR)
    assert may_operate(operator, one)
    assert not may_manage(operator, one)


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


def test_signed_in_user_has_an_open_robot():
    robot()
    assert has_a_robot(person("visitor"))
    assert not has_a_robot(AnonymousUser())


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
