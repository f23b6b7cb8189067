"""Shared by the pages of a study: the study of a request, who may open it, and a note of changes.

Studies of others are not forbidden but absent.
"""

import datetime
from collections.abc import Callable
from typing import Any

from django.contrib import messages
from django.db.models import QuerySet
from django.http import Http404, HttpRequest, HttpResponseBase
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from accounts import audit
from experiments import publishing
from experiments.access import Role, for_role, may
from experiments.models import Study, StudyMember


def slugs_of(user: Any) -> "QuerySet[StudyMember, str]":
    """Return the names of the studies that a user is a member of. Coders and hidden operators do
    not count: they have only pages of their own.
    """
    others = (StudyMember.Role.CODER, StudyMember.Role.WIZARD)
    members = StudyMember.objects.filter(user=user).exclude(role__in=others)
    return members.values_list("slug", flat=True)


def shown_time(at: datetime.datetime | None, clock: str = "%H:%M") -> str:
    """Return a time as pages of studies show it, "2026-11-27 13:36 CET"; a dash for none."""
    return "–" if at is None else timezone.localtime(at).strftime(f"%Y-%m-%d {clock} %Z")


def study_for(request: HttpRequest, pk: Any, least: Role) -> Study:
    """Return a study for a page; Http404 when there is none, or the user's role in it is below
    `least`.
    """
    row = Study.objects.filter(pk=pk).first()
    if row is None or not may(request.user, row.slug, least):
        raise Http404
    return row


def version_of(slug: str, wanted: str) -> Study:
    """Return `Study.version_of`, or raise Http404."""
    study = Study.version_of(slug, wanted)
    if study is None:
        raise Http404
    return study


def viewer_page(view: Callable[..., HttpResponseBase]) -> Callable[..., HttpResponseBase]:
    """Keep a view that only reads, and has a study's name as its first argument, to those who may
    view the study, and its answers out of caches.
    """
    return never_cache(require_safe(for_role("viewer")(view)))


def note_change(request: HttpRequest, row: Study, entry: str, text: str = "", **about: Any) -> None:
    """Record a change of a study in its history and in the audit trail, and show a text to the user
    on the next page; `about` as of `audit.note`, with its event as `event` ("study_changed").
    """
    publishing.log(row, request.user, entry)
    event = about.pop("event", "study_changed")
    audit.note(event, actor=request.user, study=row.slug, **about)
    if text:
        messages.success(request, text)
