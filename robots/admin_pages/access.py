"""The robots that a user sees in the administration: owners their own, users with Django's
permission for a model all. Other robots do not exist for them.
"""

from typing import Any

from django.contrib import admin
from django.core.exceptions import ValidationError
from django.db.models import Model, QuerySet, Value
from django.forms import CharField, ModelForm, TextInput
from django.http import HttpRequest
from django.utils.translation import gettext, gettext_lazy as _

from accounts.admin_filters import ShownFilters
from accounts.models import User
from robots.models import Robot, RobotPermit


def _user(request: HttpRequest) -> Any:
    return request.user


class OfRobots(ShownFilters):
    """Rows that belong to a robot; `robot` is the name of that field, empty for robots."""

    robot = ""

    def sees_all(self, request: HttpRequest) -> bool:
        return bool(super().has_view_permission(request))

    def is_of(self, request: HttpRequest, row: Model | None) -> bool:
        """Tell whether a row belongs to a robot of the user; without a row, whether the user is
        staff and has a robot.
        """
        if row is None:
            user = _user(request)
            return bool(user.is_staff) and Robot.objects.filter(owner=user).exists()
        robot = getattr(row, self.robot) if self.robot else row
        return robot is not None and robot.owner_id == _user(request).pk

    def get_queryset(self, request: HttpRequest) -> "QuerySet[Any]":
        rows: QuerySet[Any] = super().get_queryset(request)
        if self.sees_all(request):
            return rows
        owner = f"{self.robot}__owner" if self.robot else "owner"
        return rows.filter(**{owner: _user(request)})

    def has_module_permission(self, request: HttpRequest) -> bool:
        return bool(super().has_module_permission(request)) or self.is_of(request, None)

    def has_view_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        return bool(super().has_view_permission(request, obj)) or self.is_of(request, obj)


class WithDriver(OfRobots):
    """Rows with the driver, whom only users who see all rows can identify."""

    def get_queryset(self, request: HttpRequest) -> "QuerySet[Any]":
        """Annotate each row with whether it may show names: a column does not get the request."""
        return super().get_queryset(request).annotate(names_driver=Value(self.sees_all(request)))

    @staticmethod
    def driver_of(row: Any, session: Any) -> str:
        """Return the visitor's name, or "someone"."""
        if getattr(row, "names_driver", False):
            return str(session.visitor.shown_name)
        return gettext("someone")


def theirs_to_change(request: HttpRequest, robots: "QuerySet[Robot]") -> "QuerySet[Robot]":
    """Leave out robots that the user may only view: Django checks the permission for an action, but
    not for each of its rows.
    """
    user = _user(request)
    return robots if user.has_perm("robots.change_robot") else robots.filter(owner=user)


class PermitForm(ModelForm):
    """A permit by user name, because owners cannot look people up."""

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
                text = _("This user doesn't exist. Check the user name.")
                raise ValidationError({"person": text})
            given = RobotPermit.objects.filter(robot=self.instance.robot_id, user=found)
            if given.filter(kind=cleaned.get("kind", "")).exists():
                raise ValidationError({"person": _("This person already has that permit.")})
            self.instance.user = found
        return cleaned


class OwnersPermits(admin.TabularInline):
    """Permits, changed by users who may change their robot; new ones by user name."""

    model = RobotPermit
    form = PermitForm
    extra = 0
    fields = ("who", "person", "kind", "granted_at")
    readonly_fields = ("who", "granted_at")

    def has_view_permission(self, _request: HttpRequest, _obj: Robot | None = None) -> bool:
        return True  # the robot's page has checked it

    has_add_permission = has_change_permission = has_delete_permission = has_view_permission

    @admin.display(description=_("user"))
    def who(self, permit: RobotPermit) -> str:
        return permit.user.shown_name if permit.user_id else ""
