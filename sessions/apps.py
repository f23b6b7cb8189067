"""Configuration of the app."""

from typing import Any

from django.apps import AppConfig
from django.contrib.auth.signals import user_logged_out
from django.db.models.signals import m2m_changed, post_delete, post_save, pre_delete
from django.utils.translation import gettext_lazy as _


class TelepresenceSessionsConfig(AppConfig):
    """Sessions with robots. The label differs because Django has an app `sessions`."""

    name = "sessions"
    label = "telepresence_sessions"
    verbose_name = _("Sessions with robots")

    def ready(self) -> None:
        """Have open pages check whether they may stay when permissions may have changed."""
        from django.contrib.auth.models import Group

        from accounts.models import User
        from robots.access import register_guest_rule
        from robots.models import Robot, RobotPermit
        from sessions import signals
        from sessions.leases import terms
        from sessions.leases.trial_terms import TRIAL_TERMS
        from sessions.safety_test.course import SAFETY_TEST_TERMS, take_end, take_result

        terms.register(SAFETY_TEST_TERMS)
        terms.register(TRIAL_TERMS)
        signals.message_received.connect(take_result, dispatch_uid="sessions.safety_test")
        signals.session_ended.connect(take_end, dispatch_uid="sessions.safety_test")
        register_guest_rule(
            User.Kind.VISITOR, lambda _user, robots: [robot for robot in robots if robot.practice]
        )
        post_save.connect(_user_changed, sender=User, dispatch_uid="sessions.user")
        for through in (User.groups.through, User.user_permissions.through):
            m2m_changed.connect(_rights_changed, sender=through, dispatch_uid="sessions.rights")
        m2m_changed.connect(
            _group_rights_changed, sender=Group.permissions.through, dispatch_uid="sessions.group"
        )
        pre_delete.connect(_group_deleted, sender=Group, dispatch_uid="sessions.group_deleted")
        user_logged_out.connect(_user_logged_out, dispatch_uid="sessions.logged_out")
        post_save.connect(_robot_changed, sender=Robot, dispatch_uid="sessions.robot")
        for signal in (post_save, post_delete):
            signal.connect(_permit_changed, sender=RobotPermit, dispatch_uid="sessions.permit")


def _user_changed(
    instance: Any, created: bool, update_fields: frozenset[str] | None = None, **_more: Any
) -> None:
    if not created and update_fields != frozenset({"last_login"}):
        _check_visitor(instance.pk)


def _rights_changed(
    instance: Any, action: str, reverse: bool, pk_set: set[Any] | None, **_more: Any
) -> None:
    """A user got or lost groups or permissions, or (`reverse`) one of these got or lost users."""
    if not reverse:
        _check_after(action, instance, {instance.pk})
    elif pk_set is None:
        _check_after(action, instance, set(instance.user_set.values_list("pk", flat=True)))
    else:
        _check_after(action, instance, pk_set)


def _group_rights_changed(
    instance: Any, action: str, reverse: bool, pk_set: set[Any] | None, **_more: Any
) -> None:
    """A group got or lost permissions, or (`reverse`) a permission got or lost groups."""
    groups = pk_set if reverse else {instance.pk}
    if groups is None:
        groups = set(instance.group_set.values_list("pk", flat=True))
    _check_after(action, instance, _members(groups))


def _check_after(action: str, instance: Any, users: set[Any]) -> None:
    """Have pages look again after a change; whom a `clear` affects is known only before it."""
    if action == "pre_clear":
        instance.users_before_clear = users
    elif action == "post_clear":
        users = instance.users_before_clear
    if action.startswith("post_"):
        for user in users:
            _check_visitor(user)


def _group_deleted(instance: Any, **_more: Any) -> None:
    # Django deletes in a transaction, so that pages look when the group is gone
    for user in _members({instance.pk}):
        _check_visitor(user)


def _members(groups: set[Any]) -> set[Any]:
    from accounts.models import User

    return set(User.objects.filter(groups__in=groups).values_list("pk", flat=True))


def _user_logged_out(user: Any, request: Any = None, **_more: Any) -> None:
    if user is not None:
        if request is not None:
            request.session.flush()  # Django does so after this signal, and pages could check first
        _check_visitor(user.pk)


def _robot_changed(instance: Any, created: bool, **_more: Any) -> None:
    from sessions.page_channel import check_pages, robot_group

    if not created:
        check_pages(robot_group(instance.name))


def _permit_changed(instance: Any, **_more: Any) -> None:
    _check_visitor(instance.user_id)


def _check_visitor(user: Any) -> None:
    from sessions.page_channel import check_pages, visitor_group

    check_pages(visitor_group(user))
