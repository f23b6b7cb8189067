"""Which robots a user manages in the administration: owners their own, users with Django's
permission for a kind of rows all of them.

The robots of others are absent rather than forbidden.
"""

from typing import Any

from django.contrib import admin
from django.core.exceptions import ValidationError
from django.db.models import Model, QuerySet, Value
from django.forms import CharField, ModelForm, TextInput
from django.http import HttpRequest
from django.utils.translation import gettext
from django.utils.translation import gettext_lazy as _

from accounts.admin_filters import ShownFilters
from accounts.models import User
from robots.models import Robot, RobotPermit


def _user(request: HttpRequest) -> Any:
    return request.user


class OfRobots(ShownFilters):
    """Rows that belong to a robot; `robot` is the way to it in Django's notation, empty for the
    robot itself.
    """

    robot = ""

    def sees_all(self, request: HttpRequest) -> bool:
        """Tell whether the user has Django's permission to view all such rows."""
        return bool(super().has_view_permission(request))

    def is_of(self, request: HttpRequest, row: Model | None) -> bool:
        """Tell whether a row belongs to a robot of the user; without a row, whether the user has a
        robot at all.
        """
        if row is None:
            return (
                bool(_user(request).is_staff)
                and Robot.objects.filter(owner=_user(request)).exists()
            )
        robot = getattr(row, self.robot) if self.robot else row
        return robot is not None and robot.owner_id == _user(request).pk

    def get_queryset(self, request: HttpRequest) -> "QuerySet[Any]":
        """Leave out what belongs to robots of others."""
        rows: QuerySet[Any] = super().get_queryset(request)
        return (
            rows
            if self.sees_all(request)
            else rows.filter(**{f"{self.robot}__owner" if self.robot else "owner": _user(request)})
        )

    def has_module_permission(self, request: HttpRequest) -> bool:
        return bool(super().has_module_permission(request)) or self.is_of(request, None)

    def has_view_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Allow users who see all rows, and the owner."""
        return bool(super().has_view_permission(request, obj)) or self.is_of(request, obj)


class WithDriver(OfRobots):
    """Rows that show the driver: users who see all rows read the name, the robot's owner reads
    "someone".
    """

    def get_queryset(self, request: HttpRequest) -> "QuerySet[Any]":
        """Annotate each row with whether it may name the driver: a column gets its row but not the
        request.
        """
        return super().get_queryset(request).annotate(names_driver=Value(self.sees_all(request)))

    @staticmethod
    def driver_of(row: Any, session: Any) -> str:
        """Return what the page calls the visitor of a session."""
        return (
            str(session.visitor.shown_name)
            if getattr(row, "names_driver", False)
            else gettext("someone")
        )


def theirs_to_change(request: HttpRequest, robots: "QuerySet[Robot]") -> "QuerySet[Robot]":
    """Leave out robots that the user may only view: Django checks the permission for an action, but
    not for each of its rows.
    """
    return (
        robots
        if _user(request).has_perm("robots.change_robot")
        else robots.filter(owner=_user(request))
    )


# --- permits, for owners, who cannot look up people -----------------------------------------------


class PermitForm(ModelForm):
    """A permit by user name, which the owner must know: owners see no list of people."""

    person = CharField(
        label=_("User name"),
        max_length=150,
        required=False,
        widget=TextInput(attrs={"autocomplete": "off"}),
    )

    class Meta:
        model = RobotPermit
        fields = ("kind",)

    def clean(self) -> dict[str, Any]:
        cleaned = super().clean() or self.cleaned_data
        if self.instance._state.adding:
            found = User.objects.filter(username=cleaned.get("person", ""), is_active=True).first()
            if found is None:
                raise ValidationError(
                    {"person": _("This user doesn't exist. Check the user name.")}
                )
            if RobotPermit.objects.filter(
                robot=self.instance.robot_id, user=found, kind=cleaned.get("kind", "")
            ).exists():
                raise ValidationError({"person": _("This person already has that permit.")})
            self.instance.user = found
        return cleaned


class _ByRobot:
    """Permissions of an inline: users who may change the robot may change its permits."""

    def has_view_permission(self, _request: HttpRequest, _obj: Robot | None = None) -> bool:
        """The page of the robot was allowed already."""
        return True

    has_add_permission = has_change_permission = has_delete_permission = has_view_permission


class OwnersPermits(_ByRobot, admin.TabularInline):
    """Who was invited, trained, or made an operator; new ones by user name."""

    model = RobotPermit
    form = PermitForm
    extra = 0
    fields = ("who", "person", "kind", "granted_at")
    readonly_fields = ("who", "granted_at")

    @admin.display(description=_("user"))
    def who(self, permit: RobotPermit) -> str:
        return permit.user.shown_name if permit.user_id else ""
