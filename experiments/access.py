"""The roles of users in studies. Superusers own all studies; users without a role in a study get a
404 for its pages.
"""

import functools
import uuid
from collections.abc import Callable
from typing import Any, Literal

from django.http import Http404, HttpRequest, HttpResponseBase
from django.shortcuts import get_object_or_404

from experiments.models import Drive, Participant, ResearcherInvitation, Study, StudyMember
from sessions.models import Session

Role = Literal["owner", "researcher", "viewer", "coder", "wizard"]
View = Callable[..., HttpResponseBase]
# Coders and hidden operators have no rank: they only see their own pages.
RANK: dict[str, int] = {"viewer": 1, "researcher": 2, "owner": 3}
CODING = frozenset({"coder", "researcher", "owner"})
OPERATING = frozenset({"wizard", "researcher", "owner"})
SEES_SESSIONS = "telepresence_sessions.view_session"


def role_of(user: Any, slug: str) -> Role | None:
    if not (user.is_authenticated and user.is_active):
        return None
    if user.is_superuser:
        return "owner"
    members = StudyMember.objects.filter(slug=slug, user=user)
    role: Role | None = members.values_list("role", flat=True).first()
    return role


def may(user: Any, slug: str, least: Role) -> bool:
    return RANK.get(role_of(user, slug) or "", 0) >= RANK[least]


def may_operate_as_wizard(user: Any, slug: str) -> bool:
    return role_of(user, slug) in OPERATING


def may_code(user: Any, slug: str) -> bool:
    return role_of(user, slug) in CODING


def forget_members(instance: Study, **_more: Any) -> None:
    """Remove the members of a study with its last version: the name is free for another study."""
    if not Study.objects.filter(slug=instance.slug).exists():
        StudyMember.objects.filter(slug=instance.slug).delete()
        ResearcherInvitation.objects.filter(slug=instance.slug).delete()


def for_role(least: Role) -> Callable[[View], View]:
    """Protect a view, whose first argument is a study's name, by a role."""

    def keep(view: View) -> View:
        @functools.wraps(view)
        def kept(request: HttpRequest, slug: str, *args: Any, **kwargs: Any) -> HttpResponseBase:
            if not may(request.user, slug, least):
                raise Http404
            return view(request, slug, *args, **kwargs)

        return kept

    return keep


def drive_to_code(user: Any, session: uuid.UUID) -> Drive:
    """Return a finished drive of a study for its coding; Http404 when there is none, when its
    participant has withdrawn, or when the user may not code it.
    """
    drives = Drive.objects.select_related("participant__study", "session__robot__floor_plan")
    rows = drives.exclude(participant__status=Participant.Status.WITHDRAWN)
    rows = rows.defer("session__robot__floor_plan__image")
    drive = get_object_or_404(rows, session=session, session__ended_at__isnull=False)
    if not may_code(user, drive.participant.study.slug):
        raise Http404
    return drive


def session_for(user: Any, session: uuid.UUID) -> tuple[Session, Drive | None, bool]:
    """Return a session for its replay, its drive in a study, and whether the user may see photos.

    Staff with the permission see every session; researchers of a study those of participants who
    have not withdrawn; viewers, who see pseudonymous data only, these without photos. Any other
    session is an Http404.
    """
    rows = Session.objects.select_related("robot", "visitor", "robot__floor_plan")
    row = get_object_or_404(rows.defer("robot__floor_plan__image"), pk=session)
    drive = Drive.objects.filter(session=row).select_related("participant__study").first()
    if user.is_active and user.is_staff and user.has_perm(SEES_SESSIONS):
        return row, drive, True
    if drive is None or drive.participant.status == Participant.Status.WITHDRAWN:
        raise Http404
    slug = drive.participant.study.slug
    if not may(user, slug, "viewer"):
        raise Http404
    return row, drive, may(user, slug, "researcher")
