"""The base of pages of one study in the administration."""

from collections.abc import Callable
from typing import Any
from uuid import UUID

from django.contrib.admin import AdminSite
from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import render
from django.urls import URLPattern, path
from django.views.decorators.cache import never_cache

from experiments.access import Role
from experiments.models import Study
from experiments.research.study_access import study_for

View = Callable[..., HttpResponseBase]


def study_view(
    route: str, name: str, least: Role = "viewer", guard: Callable[[View], View] = lambda one: one
) -> Callable[[View], View]:
    """Give a method of StudyPages an address below its study's, for staff with at least a role in
    it; it may have several. `guard` decorates the view, as `require_POST` does.
    """

    def with_address(view: Any) -> Any:
        view.addresses = [*getattr(view, "addresses", ()), (route, name, least, guard)]
        return view

    return with_address


class StudyPages:
    """A mixin of the studies' administration."""

    admin_site: AdminSite
    opts: Any

    def study_path(self, route: str, view: View, name: str, least: Role = "viewer") -> URLPattern:
        """Return the address of an uncached page that gets the study, for staff with a role."""

        def shown(request: HttpRequest, pk: UUID, **place: Any) -> HttpResponseBase:
            return view(request, study_for(request, pk, least), **place)

        guarded: Any = self.admin_site.admin_view(never_cache(shown))
        return path(f"<uuid:pk>/{route}", guarded, name=f"experiments_study_{name}")

    def study_urls(self) -> list[URLPattern]:
        """Return the addresses of all methods with `study_view`."""
        members = {name: one for cls in type(self).__mro__ for name, one in vars(cls).items()}
        views = {name: getattr(one, "addresses", ()) for name, one in members.items()}
        return [
            self.study_path(route, guard(getattr(self, method)), name, least)
            for method, addresses in views.items()
            for route, name, least, guard in addresses
        ]

    def study_page(
        self,
        request: HttpRequest,
        row: Study,
        template: str,
        title: Any,
        context: dict[str, Any],
        *,
        tab: str,
        status: int = 200,
    ) -> HttpResponse:
        around = self.admin_site.each_context(request) | {
            "title": title,
            "opts": self.opts,
            "study": row,
            "study_tab": tab,
            "is_nav_sidebar_enabled": False,  # forms, tables and tabs need the width
        }
        name = f"admin/experiments/study/{template}.html"
        return render(request, name, around | context, status=status)
