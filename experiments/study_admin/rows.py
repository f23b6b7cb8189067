"""Lists of participants, drives and rehearsals: their study's tabs, filters, computed columns."""

import uuid
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from django.contrib import admin
from django.db.models import Model, Q
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import render
from django.urls import path
from django.utils.html import format_html_join
from django.utils.safestring import SafeString, mark_safe
from django.utils.translation import gettext_lazy as _
from django.views.decorators.cache import never_cache

from accounts.admin_filters import ReadOnlyAdmin
from experiments.access import Role, may
from experiments.builder.labels import ENDING_NAMES
from experiments.models import Study
from experiments.research.study_access import slugs_of
from robots.admin import NOTHING
from surveys.document_forms.fields import language_name


def column(description: Any, value: Callable[[Any], Any], **options: Any) -> Any:
    """Return a column of the administration, a dash for ""; `options` as of `admin.display`."""

    def shown(_admin: Any, row: Any) -> Any:
        found = value(row)
        return NOTHING if found == "" else found

    return admin.display(description=description, **options)(shown)


def by_line(line: str, values: Any) -> SafeString:
    return format_html_join(mark_safe("<br>"), line, values)


def section(title: Any, *fields: str) -> tuple[Any, dict[str, Any]]:
    return title, {"fields": fields}


class StudyFilter(admin.SimpleListFilter):
    """The studies of the rows that the user may see; `lookup` leads from a row to its study."""

    title = _("study")
    parameter_name = lookup = "study"

    def lookups(self, request: HttpRequest, model_admin: Any) -> list[tuple[str, str]]:
        rows = model_admin.get_queryset(request)
        found = Study.objects.filter(pk__in=rows.order_by().values_list(self.lookup).distinct())
        return [(str(row.pk), str(row)) for row in found]

    def queryset(self, _request: HttpRequest, queryset: Any) -> Any:
        chosen = self.value()
        if chosen is None:
            return queryset
        is_known = any(chosen == key for key, _title in self.lookup_choices)
        return queryset.filter(**{self.lookup: chosen}) if is_known else queryset.none()


class StudyOfDriveFilter(StudyFilter):
    lookup = "participant__study"


class ChoiceFilter(admin.SimpleListFilter):
    """Kinds of rows, by their key in the address: what each is called, and its condition."""

    kinds: dict[str, tuple[Any, Q]] = {}

    def lookups(self, _request: HttpRequest, _model_admin: Any) -> list[tuple[str, Any]]:
        return [(key, name) for key, (name, _condition) in self.kinds.items()]

    def queryset(self, _request: HttpRequest, queryset: Any) -> Any:
        kind = self.kinds.get(self.value() or "")
        return queryset.filter(kind[1]) if kind is not None else queryset


class ExcludedFilter(ChoiceFilter):
    title = _("excluded")
    parameter_name = "excluded"
    kinds = {
        "yes": (_("excluded"), ~Q(excluded_reason="")),
        "no": (_("not excluded"), Q(excluded_reason="")),
    }


class MismatchFilter(ChoiceFilter):
    """Drives in which a setting was not applied as the condition assigns it."""

    title = _("condition applied")
    parameter_name = "applied"
    kinds = {"yes": (_("as assigned"), Q(mismatches=[])), "no": (_("differs"), ~Q(mismatches=[]))}


class NamedValuesFilter(admin.AllValuesFieldListFilter):
    """The values of a field, each by its name on pages."""

    names: Mapping[str, Any] = {}

    def name_of(self, value: str) -> Any:
        return self.names.get(value, value)

    def choices(self, changelist: Any) -> Iterator[dict[str, Any]]:
        for one in super().choices(changelist):
            yield {**one, "display": self.name_of(str(one["display"]))}


class CompletionFilter(NamedValuesFilter):
    names = ENDING_NAMES


class LanguageFilter(NamedValuesFilter):
    def name_of(self, value: str) -> str:
        return language_name(value)


class OfStudies(ReadOnlyAdmin):
    """Rows of studies, for the members of each by their role, all for superusers. `study` is the
    lookup that leads to a row's study, empty for studies themselves. Permissions of models count
    only for new studies.
    """

    study = ""

    def study_of(self, row: Any) -> Study:
        for name in filter(None, self.study.split("__")):
            row = getattr(row, name)
        found: Study = row
        return found

    def slug_of(self, row: Any) -> str:
        return self.study_of(row).slug

    def get_queryset(self, request: HttpRequest) -> Any:
        rows = super().get_queryset(request)
        user: Any = request.user
        if user.is_superuser:
            return rows
        lookup = f"{self.study}__slug__in" if self.study else "slug__in"
        return rows.filter(**{lookup: list(slugs_of(user))})

    def has_module_permission(self, request: HttpRequest) -> bool:
        """Studies are listed for staff who are members of one, or may add one; superusers may."""
        user: Any = request.user
        may_add = user.has_perm("experiments.add_study")
        return bool(user.is_staff and (may_add or slugs_of(user).exists()))

    def has_view_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        if obj is None:
            return self.has_module_permission(request)
        return may(request.user, self.slug_of(obj), "viewer")


class StudyRows(OfStudies):
    """Rows of a study, with its tabs above them: above a list as soon as a study is chosen."""

    study_tab = ""
    list_per_page = 50

    def changelist_view(self, request: HttpRequest, extra_context: Any = None) -> HttpResponse:
        try:
            chosen = uuid.UUID(request.GET.get(StudyFilter.parameter_name, ""))
        except ValueError:
            study = None
        else:
            study = Study.objects.filter(pk=chosen).first()
        tabs = {"study": study, "study_tab": self.study_tab} if study else {}
        return super().changelist_view(request, {**(extra_context or {}), **tabs})

    def render_change_form(self, request: Any, context: Any, *args: Any, **options: Any) -> Any:
        study = self.study_of(context["original"])
        context |= {
            "study": study,
            "study_tab": self.study_tab,
            "may_research": may(request.user, study.slug, "researcher"),
        }
        return super().render_change_form(request, context, *args, **options)

    def row_for(self, request: HttpRequest, pk: Any, least: Role) -> Any:
        """Return a row for a page; Http404 when there is none, or the user's role is lower."""
        rows = self.model.objects.select_related(*self.list_select_related)
        row = rows.filter(pk=pk).first()
        if row is None or not may(request.user, self.slug_of(row), least):
            raise Http404
        return row

    def row_page(
        self, request: HttpRequest, row: Any, page: str, context: dict[str, Any], status: int = 200
    ) -> HttpResponse:
        around = self.admin_site.each_context(request) | {
            "opts": self.opts,
            "study": self.study_of(row),
            "study_tab": self.study_tab,
            self.opts.model_name: row,
        }
        name = f"admin/experiments/{self.opts.model_name}/{page}.html"
        return render(request, name, around | context, status=status)

    def row_path(self, view: Callable[..., HttpResponseBase], name: str, end: str = "/") -> Any:
        guarded: Any = self.admin_site.admin_view(never_cache(view))
        full_name = f"experiments_{self.opts.model_name}_{name}"
        return path(f"<uuid:pk>/{name}{end}", guarded, name=full_name)
