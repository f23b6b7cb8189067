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


class StudyPages:
    """A mixin of the studies' administration."""

    admin_site: AdminSite
    opts: Any

    def study_path(
        self,
        route: str,
        view: Callable[..., HttpResponseBase],
        name: str,
        least: Role = "viewer",
    ) -> URLPattern:
        """Return the address of a page of a study, for staff with at least a role in it; no cache
        keeps the page. The view gets the study.
        """

        def shown(request: HttpRequest, pk: UUID, **place: Any) -> HttpResponseBase:
            return view(request, study_for(request, pk, least), **place)

        guarded: Any = self.admin_site.admin_view(never_cache(shown))
        return path(f"<uuid:pk>/{route}", guarded, name=f"experiments_study_{name}")

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
