"""Who may do what with a study in the administration: its researchers by their role, superusers
everything, all others nothing.

Studies of others are not forbidden but absent. What a model's own permissions say counts only for
bringing in new studies.
"""

import datetime
from typing import Any

from django.db.models import Model, QuerySet
from django.http import Http404, HttpRequest
from django.utils import timezone

from accounts.admin_filters import ShownFilters
from experiments.access import Role, may
from experiments.models import Study, StudyMember


def slugs_of(user: Any) -> "QuerySet[StudyMember, str]":
    """Return the names of the studies that somebody has a part in; coders and hidden operators have
    pages of their own alone.
    """
    own = (StudyMember.Role.CODER, StudyMember.Role.WIZARD)
    members = StudyMember.objects.filter(user=user).exclude(role__in=own)
    return members.values_list("slug", flat=True)


def shown_time(at: datetime.datetime | None) -> str:
    """Return a time as pages of studies show it, "2026-11-27 13:36 CET"; a dash for none."""
    return "–" if at is None else f"{timezone.localtime(at):%Y-%m-%d %H:%M %Z}"


def study_for(request: HttpRequest, pk: Any, least: Role) -> Study:
    """Return a study for a page.

    Raises:
        Http404: there is none, or whoever asks is not at least that in it.
    """
    row = Study.objects.filter(pk=pk).first()
    if row is None or not may(request.user, row.slug, least):
        raise Http404
    return row


class OfStudies(ShownFilters):
    """Rows that belong to a study; `study` is the way to it, in Django's notation, empty for the
    study itself.
    """

    study = ""

    def study_of(self, row: Any) -> Study:
        """Return the study that a row belongs to."""
        for name in filter(None, self.study.split("__")):
            row = getattr(row, name)
        found: Study = row
        return found

    def slug_of(self, row: Any) -> str:
        """Return the name of the study that a row belongs to."""
        return self.study_of(row).slug

    def get_queryset(self, request: HttpRequest) -> Any:
        """Leave out what belongs to studies of others."""
        rows = super().get_queryset(request)
        user: Any = request.user
        if user.is_superuser:
            return rows
        return rows.filter(
            **{f"{self.study}__slug__in" if self.study else "slug__in": list(slugs_of(user))}
        )

    def has_module_permission(self, request: HttpRequest) -> bool:
        """Studies are listed for whoever has a part in one, or may bring one in."""
        user: Any = request.user
        return bool(
            user.is_staff
            and (
                user.is_superuser
                or user.has_perm("experiments.add_study")
                or slugs_of(user).exists()
            )
        )

    def has_view_permission(self, request: HttpRequest, obj: Model | None = None) -> bool:
        """Anybody with a part in it may look."""
        return (
            self.has_module_permission(request)
            if obj is None
            else may(request.user, self.slug_of(obj), "viewer")
        )

    def has_add_permission(self, _request: HttpRequest) -> bool:
        """Most rows come of themselves."""
        return False

    def has_change_permission(self, _request: HttpRequest, _obj: Model | None = None) -> bool:
        """And are not changed by hand."""
        return False

    def has_delete_permission(self, _request: HttpRequest, _obj: Model | None = None) -> bool:
        """Nor deleted."""
        return False
