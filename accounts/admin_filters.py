"""Lists of the administration: the lookups in their addresses, and those that cannot be edited.

Django accepts any lookup on a model's fields, also on fields that no page shows. The number of rows
would then reveal such a field, character by character, to users who may only view the list.
"""

from typing import Any

from django.contrib import admin
from django.db.models import Model
from django.http import HttpRequest


class ShownFilters(admin.ModelAdmin):
    """A list that accepts only the filters that it shows and those of the site's links to it; and a
    form that saves only the fields changed in it.
    """

    linked: tuple[str, ...] = ()  # lookups of links to it, such as `robot__id__exact`

    def save_model(self, request: HttpRequest, obj: Model, form: Any, change: bool) -> None:
        own = {field.name for field in obj._meta.concrete_fields}
        obj.save(**({"update_fields": own & {*form.changed_data}} if change else {}))

    def lookup_allowed(self, lookup: str, value: Any, request: Any = None) -> bool:
        """Refuse a lookup that is not one of the user's filters; administrators may use all that
        Django accepts.
        """
        if not super().lookup_allowed(lookup, value, request):
            return False
        if lookup in self.linked or (request is not None and request.user.is_superuser):
            return True
        shown = self.list_filter if request is None else self.get_list_filter(request)
        return any(_is_of(one, lookup) for one in (*shown, self.date_hierarchy) if one)


class ReadOnlyAdmin(ShownFilters):
    """A list whose rows cannot be edited."""

    show_full_result_count = False

    def has_add_permission(self, _request: HttpRequest, _obj: Model | None = None) -> bool:
        return False

    has_change_permission = has_delete_permission = has_add_permission


def _is_of(shown: Any, lookup: str) -> bool:
    """Tell whether a filter of a list uses a lookup: a class uses its parameter, a field all
    lookups that begin with its name.
    """
    if isinstance(shown, type):
        return bool(lookup == shown.parameter_name)  # type: ignore[attr-defined]
    name = shown[0] if isinstance(shown, (list, tuple)) else shown
    return lookup == name or lookup.startswith(f"{name}__")
