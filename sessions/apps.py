"""Configuration of the app."""

from typing import Any

from django.apps import AppConfig
from django.contrib.auth.signals import user_logged_out
from django.db.models.signals import post_delete, post_save
from django.utils.translation import gettext_lazy as _


class TelepresenceSessionsConfig(AppConfig):
    """Sessions with robots. The label differs because Django has an app `sessions`."""

    name = "sessions"
    label = "telepresence_sessions"
    verbose_name = _("Sessions with robots")

    def ready(self) -> None:
        """Have open pages check whether they may stay when permissions may have changed."""
        from accounts.models import User
        from robots.access import register_guest_rule
        from robots.models import Robot, RobotPermit
        from sessions.leases import terms
        from sessions.leases.trial_terms import TRIAL_TERMS

        terms.register(TRIAL_TERMS)
        register_guest_rule(
            User.Kind.VISITOR, lambda _user, robots: [robot for robot in robots if robot.practice]
        )
        post_save.connect(_user_changed, sender=User, dispatch_uid="sessions.user")
        user_logged_out.connect(_user_logged_out, dispatch_uid="sessions.logged_out")
        post_save.connect(_robot_changed, sender=Robot, dispatch_uid="sessions.robot")
        for signal in (post_save, post_delete):
            signal.connect(_permit_changed, sender=RobotPermit, dispatch_uid="sessions.permit")


def _user_changed(
    instance: Any, created: bool, update_fields: frozenset[str] | None = None, **_more: Any
) -> None:
    if not created and update_fields != {"last_login"}:
        _check_visitor(instance.pk)


def _user_logged_out(user: Any, **_more: Any) -> None:
    if user is not None:
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
