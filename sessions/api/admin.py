"""Keys of the JSON API in the administration: created and shown once, listed with their last use,
and revoked. Owners manage the keys of their own robots. A key cannot be changed.
"""

from typing import Any

from django.contrib import admin
from django.db.models import Model, QuerySet
from django.http import HttpRequest, HttpResponse
from django.shortcuts import render
from django.utils import timezone
from django.utils.translation import gettext, gettext_lazy as _

from accounts import audit
from robots.admin_pages.access import OfRobots
from robots.models import Robot
from sessions.api.keys import issue
from sessions.models import ApiKey


@admin.register(ApiKey)
class ApiKeyAdmin(OfRobots):
    """The keys of programs that monitor and stop robots."""

    robot = "robot"
    list_display = ("label", "robot", "made_at", "used")
    list_filter = ("robot",)
    list_select_related = ("robot",)
    search_fields = ("label", "robot__name", "robot__title")
    readonly_fields = ("made_at", "used")
    ordering = ("robot__title", "label")

    # --- who may ----------------------------------------------------------------------------------

    def has_add_permission(self, request: HttpRequest) -> bool:
        return bool(super().has_add_permission(request)) or self.is_of(request, None)

    def has_change_permission(self, _request: HttpRequest, _obj: Model | None = None) -> bool:
        return False

    def has_delete_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Allow it also to the owner of the key's robot."""
        return bool(super().has_delete_permission(request, obj)) or self.is_of(request, obj)

    def get_list_filter(self, request: HttpRequest) -> tuple[str, ...]:
        return self.list_filter if self.sees_all(request) else ()

    # --- making -----------------------------------------------------------------------------------

    def get_fields(self, _request: HttpRequest, obj: ApiKey | None = None) -> tuple[str, ...]:
        return ("robot", "label") if obj is None else ("robot", "label", "made_at", "used")

    def formfield_for_foreignkey(self, db_field: Any, request: HttpRequest, **kwargs: Any) -> Any:
        if db_field.name == "robot" and not super().has_add_permission(request):
            kwargs["queryset"] = Robot.objects.filter(owner=request.user)
        return super().formfield_for_foreignkey(db_field, request, **kwargs)

    def get_form(
        self, request: HttpRequest, obj: ApiKey | None = None, change: bool = False, **kwargs: Any
    ) -> Any:
        return super().get_form(
            request,
            obj,
            change,
            help_texts={"label": _("Purpose of the key, for example home-assistant.")},
            **kwargs,
        )

    def save_model(self, request: HttpRequest, obj: ApiKey, form: Any, change: bool) -> None:
        """Create the key; only its hash is stored, and this response alone shows it."""
        request.api_key = issue(obj, timezone.now())
        obj.save(force_insert=True)
        audit.note("api_key_made", actor=request.user, robot=obj.robot, thing=obj, detail=obj.label)

    def response_add(
        self, request: HttpRequest, obj: ApiKey, post_url_continue: str | None = None
    ) -> HttpResponse:
        context = self.admin_site.each_context(request) | {
            "title": gettext("API key for %(robot)s") % {"robot": obj.robot},
            "opts": self.opts,
            "robot": obj.robot,
            "key": request.api_key,
            "site": request.build_absolute_uri("/").rstrip("/"),
        }
        return render(request, "admin/telepresence_sessions/apikey/shown.html", context)

    # --- taking away ------------------------------------------------------------------------------

    def delete_model(self, request: HttpRequest, obj: ApiKey) -> None:
        audit.note(
            "api_key_revoked", actor=request.user, robot=obj.robot, thing=obj, detail=obj.label
        )
        super().delete_model(request, obj)

    def delete_queryset(self, request: HttpRequest, queryset: "QuerySet[ApiKey]") -> None:
        for key in queryset.select_related("robot"):
            self.delete_model(request, key)

    @admin.display(description=_("last used"), ordering="last_used_at", empty_value=_("never"))
    def used(self, key: ApiKey) -> Any:
        return key.last_used_at
