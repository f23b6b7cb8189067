"""The administration's first page: a card with the figures of the studies, one with those of the
robots, and the lists of all other models.
"""

import datetime
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

from django import template
from django.contrib import admin
from django.db.models import Count, Q, QuerySet
from django.http import HttpRequest
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import ngettext

from experiments.models import Participant, ParticipantKind, Study
from experiments.participation import progress
from experiments.research.live import RECENT
from experiments.research.study_access import slugs_of
from robots.models import Robot
from robots.presence.report import has_problem
from sessions.models import ManagerBeat, Session

MANAGER_SILENT_AFTER = datetime.timedelta(seconds=15)
SEES_SITE = ("robots.view_robot", "telepresence_sessions.view_session")
# By the model that a user must be able to view to get a card: the apps whose lists are in it.
CARDS = {"Study": ("experiments", "surveys"), "Robot": ("robots",)}
register = template.Library()


@dataclass(frozen=True)
class Fact:
    """A number, its label, and the list of what it counts; `of` is the total that it is part of."""

    number: int
    label: str
    url: str
    of: int | None = None
    is_problem: bool = False


@dataclass(frozen=True)
class Card:
    """Figures, and lists from Django's `app_list`; `own` is the first."""

    name: str
    facts: list[Fact]
    own: dict[str, Any]
    lists: list[dict[str, Any]]


@dataclass(frozen=True)
class Home:
    """Cards, the rest of `app_list`, and for users with SEES_SITE whether the session manager is
    silent.
    """

    cards: list[Card]
    system: list[dict[str, Any]]
    is_manager_silent: bool


@register.simple_tag(takes_context=True)
def admin_home(context: template.Context) -> Home:
    """Return the first page, with what the user may view."""
    request, apps = context["request"], context["app_list"]
    now = timezone.now()
    cards, taken = [], set[Any]()
    for name, labels in CARDS.items():
        by_label = {app["app_label"]: app["models"] for app in apps}
        lists = [one for label in labels for one in by_label.get(label, ())]
        own = next((one for one in lists if one["object_name"] == name), None)
        if own is not None and own["admin_url"]:
            facts = (_of_studies if name == "Study" else _of_robots)(request, now)
            cards.append(Card(name, facts, own, [one for one in lists if one is not own]))
            taken.update(labels)
    return Home(
        cards,
        [app for app in apps if app["app_label"] not in taken],
        request.user.has_perms(SEES_SITE)
        and not ManagerBeat.objects.filter(beat_at__gte=now - MANAGER_SILENT_AFTER).exists(),
    )


def _of_studies(request: HttpRequest, now: datetime.datetime) -> list[Fact]:
    """Return figures of study versions; a published one outside its opening hours is paused."""
    user: Any = request.user
    studies = Study.objects.order_by()
    if not user.is_superuser:
        studies = studies.filter(slug__in=list(slugs_of(user)))
    rows = list(studies.only("status", "opening_hours", "time_zone"))
    published = [row for row in rows if row.status == Study.Status.PUBLISHED]
    n_open = sum(progress.is_open(row, now) for row in published)
    n_paused = len(published) - n_open
    n_drafts = sum(row.status == Study.Status.DRAFT for row in rows)
    people = Participant.objects.filter(kind=ParticipantKind.PARTICIPANT, study__in=rows).aggregate(
        now=Count("pk", filter=Q(status=Participant.Status.ACTIVE, seen_at__gte=now - RECENT)),
        done=Count("pk", filter=Q(status=Participant.Status.FINISHED)),
    )
    listed = reverse("admin:experiments_study_changelist")
    listed_people = reverse("admin:experiments_participant_changelist")
    of_status, of_people = f"{listed}?status__exact=", f"{listed_people}?kind__exact=participant"
    n_now, n_done = people["now"], people["done"]
    paused = ngettext(
        "study paused, outside its hours", "studies paused, outside their hours", n_paused
    )
    recent = ngettext("participant in the last hour", "participants in the last hour", n_now)
    done = ngettext("participant finished", "participants finished", n_done)
    return [
        Fact(n_open, ngettext("study open", "studies open", n_open), f"{of_status}published"),
        Fact(n_paused, paused, f"{of_status}published"),
        Fact(n_drafts, ngettext("draft study", "draft studies", n_drafts), f"{of_status}draft"),
        Fact(n_now, recent, f"{of_people}&status__exact=active"),
        Fact(n_done, done, f"{of_people}&status__exact=finished"),
    ]


def _of_robots(request: HttpRequest, now: datetime.datetime) -> list[Fact]:
    robots = list(
        admin.site.get_model_admin(Robot)
        .get_queryset(request)
        .filter(enabled=True)
        .select_related(None)
        .select_related("presence")
    )
    visits = Session.objects.filter(robot__in=robots).order_by()
    states = list(visits.exclude(state=Session.State.ENDED).values_list("state", flat=True))
    waiting = states.count(Session.State.WAITING)
    online = sum(robot.is_online(now) for robot in robots)
    in_use = len(states) - waiting
    troubled = sum(has_problem(robot, now) for robot in robots)
    listed = f"{reverse('admin:robots_robot_changelist')}?now="  # robots/admin.py, NowFilter
    labels = (
        ngettext("robot online", "robots online", online),
        ngettext("robot in use", "robots in use", in_use),
        ngettext("robot with a problem", "robots with a problem", troubled),
    )
    facts = [
        Fact(online, labels[0], f"{listed}online", of=len(robots)),
        Fact(in_use, labels[1], f"{listed}in_use"),
        Fact(troubled, labels[2], f"{listed}problem", is_problem=troubled > 0),
    ]
    if admin.site.get_model_admin(Session).has_view_permission(request):
        facts += _of_visits(visits, waiting, now)
    return facts


def _of_visits(visits: QuerySet[Session], waiting: int, now: datetime.datetime) -> list[Fact]:
    midnight = timezone.localtime(now).replace(hour=0, minute=0, second=0, microsecond=0)
    today = visits.filter(queued_at__gte=midnight).count()
    listed_visits = reverse("admin:telepresence_sessions_session_changelist")
    since = urlencode({"queued_at__gte": midnight.isoformat(sep=" ")})
    in_queue = f"{listed_visits}?state__exact={Session.State.WAITING}"
    return [
        Fact(waiting, ngettext("visitor waiting", "visitors waiting", waiting), in_queue),
        Fact(today, ngettext("visit today", "visits today", today), f"{listed_visits}?{since}"),
    ]
