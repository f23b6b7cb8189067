"""People and the audit log in the administration."""

import uuid
from typing import Any

from allauth.account.admin import EmailAddressAdmin
from allauth.account.models import EmailConfirmation
from django.contrib import admin
from django.contrib.auth.admin import UserAdmin
from django.db.models import Q, QuerySet
from django.http import HttpRequest
from django.utils.translation import gettext_lazy as _

from accounts.admin_filters import ReadOnlyAdmin, ShownFilters
from accounts.models import AuditEntry, User

RIGHTS = ("is_active", "is_staff", "is_superuser", "groups", "user_permissions")

# allauth offers it to everyone who may view addresses.
EmailAddressAdmin.make_verified.allowed_permissions = ("change",)

# Links in e-mails, for their receivers alone.
admin.site.unregister(EmailConfirmation)


@admin.register(User)
class PersonAdmin(ShownFilters, UserAdmin):
    """Visitors, researchers and owners. Only administrators may change an administrator's account,
    its password or anyone's rights: permission to change people must not make administrators.
    """

    list_display = (
        "username",
        "display_name",
        "email",
        "kind",
        "date_joined",
        "last_login",
        "is_staff",
        "is_active",
    )
    list_filter = ("kind", "is_staff", "is_superuser", "is_active", "date_joined", "groups")
    search_fields = ("username", "display_name", "email")
    date_hierarchy = "date_joined"
    ordering = ("-date_joined",)
    list_per_page = 50
    readonly_fields = ("kind", "last_login", "date_joined")
    fieldsets = (
        (None, {"fields": ("username", "password")}),
        (_("Person"), {"fields": ("display_name", "email", "kind")}),
        (_("Visits"), {"fields": ("date_joined", "last_login")}),
        (_("Permissions"), {"classes": ("collapse",), "fields": RIGHTS}),
    )
    add_fieldsets = (
        (
            None,
            {
                "classes": ("wide",),
                "fields": (
                    "username",
                    "display_name",
                    "email",
                    "usable_password",
                    "password1",
                    "password2",
                ),
            },
        ),
    )
    actions = ("close_accounts", "open_accounts")

    def has_change_permission(self, request: HttpRequest, obj: User | None = None) -> bool:
        return super().has_change_permission(request, obj) and _is_below(request, obj)

    def has_delete_permission(self, request: HttpRequest, obj: User | None = None) -> bool:
        return super().has_delete_permission(request, obj) and _is_below(request, obj)

    def get_readonly_fields(
        self, request: HttpRequest, _obj: User | None = None
    ) -> tuple[str, ...]:
        return (*self.readonly_fields, *(() if _user(request).is_superuser else RIGHTS))

    @admin.action(description=_("Close selected accounts"), permissions=["change"])
    def close_accounts(self, request: HttpRequest, queryset: Any) -> None:
        """Close accounts, except the user's own; their records stay."""
        count = _of(request, queryset).exclude(pk=request.user.pk).update(is_active=False)
        self.message_user(request, _("Accounts closed: %(n)d.") % {"n": count})

    @admin.action(description=_("Reopen selected accounts"), permissions=["change"])
    def open_accounts(self, request: HttpRequest, queryset: Any) -> None:
        count = _of(request, queryset).update(is_active=True)
        self.message_user(request, _("Accounts reopened: %(n)d.") % {"n": count})


@admin.register(AuditEntry)
class AuditAdmin(ReadOnlyAdmin):
    """For administrators alone because it is about everyone."""

    list_display = ("at", "act", "actor", "person", "robot", "study", "thing", "detail", "role")
    list_filter = ("act", "at", "robot", "study")
    search_fields = ("=actor", "=person", "thing", "robot", "study")
    search_help_text = _("Search by the ID of a person or item, or the name of a robot or study.")
    date_hierarchy = "at"
    list_per_page = 100

    def has_module_permission(self, request: HttpRequest) -> bool:
        return bool(_user(request).is_active and _user(request).is_superuser)

    def has_view_permission(self, request: HttpRequest, _obj: AuditEntry | None = None) -> bool:
        return self.has_module_permission(request)

    def get_search_results(
        self, _request: HttpRequest, queryset: "QuerySet[AuditEntry]", search_term: str
    ) -> tuple[Any, bool]:
        """Search an id among people and items, any other text among items, robots and studies."""
        words = search_term.strip()
        try:
            key = uuid.UUID(words)
        except ValueError:
            found = (
                Q(thing__icontains=words) | Q(robot__icontains=words) | Q(study__icontains=words)
            )
        else:
            found = Q(actor=key) | Q(person=key) | Q(thing__icontains=str(key))
        return queryset.filter(found) if words else queryset, False


def _user(request: HttpRequest) -> Any:
    return request.user


def _is_below(request: HttpRequest, obj: User | None) -> bool:
    return obj is None or not obj.is_superuser or _user(request).is_superuser


def _of(request: HttpRequest, people: "QuerySet[User]") -> "QuerySet[User]":
    return people if _user(request).is_superuser else people.filter(is_superuser=False)
