"""What lists of participants and drives are filtered by."""

from collections.abc import Iterator
from typing import Any

from django.contrib import admin
from django.http import HttpRequest
from django.utils.translation import gettext_lazy as _

from experiments.builder.labels import ENDING_NAMES
from experiments.models import Study
from surveys.document_forms.fields import language_name


class StudyFilter(admin.SimpleListFilter):
    """Studies that whoever asks has a part in."""

    title = _("study")
    parameter_name = "study"
    way = "study"

    def lookups(self, request: HttpRequest, model_admin: Any) -> list[tuple[str, str]]:
        rows = model_admin.get_queryset(request)
        found = Study.objects.filter(pk__in=rows.order_by().values_list(self.way).distinct())
        return [(str(row.pk), str(row)) for row in found]

    def queryset(self, _request: HttpRequest, queryset: Any) -> Any:
        """Return what belongs to the chosen one; an address that was made up chooses none."""
        known = {choice for choice, _title in self.lookup_choices}
        if self.value() is None:
            return queryset
        return (
            queryset.filter(**{self.way: self.value()})
            if self.value() in known
            else queryset.none()
        )


class StudyOfDriveFilter(StudyFilter):
    way = "participant__study"


class ExcludedFilter(admin.SimpleListFilter):
    title = _("excluded")
    parameter_name = "excluded"

    def lookups(self, _request: HttpRequest, _model_admin: Any) -> list[tuple[str, Any]]:
        return [("yes", _("excluded")), ("no", _("not excluded"))]

    def queryset(self, _request: HttpRequest, queryset: Any) -> Any:
        rows: dict[str | None, Any] = {
            "yes": queryset.exclude(excluded_reason=""),
            "no": queryset.filter(excluded_reason=""),
        }
        return rows.get(self.value(), queryset)


class MismatchFilter(admin.SimpleListFilter):
    """Drives in which something was not as the condition says."""

    title = _("condition applied")
    parameter_name = "applied"

    def lookups(self, _request: HttpRequest, _model_admin: Any) -> list[tuple[str, Any]]:
        return [("yes", _("as assigned")), ("no", _("differs"))]

    def queryset(self, _request: HttpRequest, queryset: Any) -> Any:
        rows: dict[str | None, Any] = {
            "yes": queryset.filter(mismatches=[]),
            "no": queryset.exclude(mismatches=[]),
        }
        return rows.get(self.value(), queryset)


class LanguageFilter(admin.AllValuesFieldListFilter):
    def choices(self, changelist: Any) -> Iterator[dict[str, Any]]:
        for one in super().choices(changelist):
            yield {**one, "display": language_name(str(one["display"]))}


class CompletionFilter(admin.AllValuesFieldListFilter):
    def choices(self, changelist: Any) -> Iterator[dict[str, Any]]:
        for one in super().choices(changelist):
            yield {**one, "display": ENDING_NAMES.get(str(one["display"]), one["display"])}
