"""What a list of the administration may be asked in its address.

Django takes any lookup on a model's own fields, also on those that no page shows: the number of
rows would then tell a field letter by letter to whoever may look at the list and not at the field.
"""

from typing import Any

from django.contrib import admin
from django.db.models import Model
from django.http import HttpRequest


class ShownFilters(admin.ModelAdmin):
    """A list that answers the filters it shows, those of the site's own links to
    it, and no others; and a form that overwrites nothing that it does not show.
    """

    linked: tuple[str, ...] = ()  # lookups of links to it, such as `robot__id__exact`

    def save_model(self, request: HttpRequest, obj: Model, form: Any, change: bool) -> None:
        """Save only the fields changed in the form, so that it overwrites no other change."""
        own = {field.name for field in obj._meta.concrete_fields}
        obj.save(**({"update_fields": own & {*form.changed_data}} if change else {}))

    def lookup_allowed(self, lookup: str, value: Any, request: Any = None) -> bool:
        """Refuse what is no filter of whoever asks; administrators ask anything that Django
        answers.
        """
        if not super().lookup_allowed(lookup, value, request):
            return False
        if request is not None and request.user.is_superuser:
            return True
        return lookup in self.linked or any(_is_of(one, lookup) for one in self._filters(request))

    def _filters(self, request: HttpRequest | None) -> list[Any]:
        shown = self.list_filter if request is None else self.get_list_filter(request)
        return [*shown, *([self.date_hierarchy] if self.date_hierarchy else [])]


def _is_of(shown: Any, lookup: str) -> bool:
    """Tell whether a filter of a list makes such a lookup: a class its one parameter, a field all
    that begin with its name.
    """
    if isinstance(shown, type):
        return bool(lookup == shown.parameter_name)  # type: ignore[attr-defined]
    name = shown[0] if isinstance(shown, (list, tuple)) else shown
    return lookup == name or lookup.startswith(f"{name}__")
