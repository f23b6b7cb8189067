"""Pages of the whole site: the robots, the recorded data, and the manifest for home screens."""

import datetime
from dataclasses import asdict, dataclass, replace
from typing import Any

from django.conf import settings
from django.db.models import Q, QuerySet
from django.http import HttpRequest, HttpResponse, JsonResponse
from django.shortcuts import render
from django.templatetags.static import static
from django.urls import reverse
from django.utils import timezone
from django.utils.http import urlencode
from django.utils.translation import get_language, gettext as _
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from accounts.attempts import Attempts
from accounts.rate_limits import limited
from experiments.participation.landing import invitations
from experiments.participation.withdrawal.receipt import STAYS
from robots.access import may_drive_each, robots_visible_to
from robots.cards import STATES, RobotCard, card
from robots.models import Robot
from sessions.leases.traffic import living_sessions, traffic_at
from sessions.practice import trial_length

PER_PAGE = 24
MAX_PAGE, MAX_SEARCH, MAX_WORDS = 100_000, 100, 5
# a page polls every few seconds, and a class of visitors has one address
LISTS = Attempts("robots-json", limit=1200)


@dataclass(frozen=True)
class Invitation:
    """The one big button of the landing page."""

    label: str
    url: str


@require_safe
@never_cache
def home(request: HttpRequest) -> HttpResponse:
    """Show the robots, a page at a time."""
    shown = robots_page(request, timezone.now())
    cards = shown.cards
    context = {
        "cards": cards,
        "shown": shown,
        "invitation": _invitation(request.user, cards),
        "can_try": settings.PRACTICE_ROBOTS > 0,
        "trial": trial_length(request.user),
        "studies": invitations(get_language() or "", timezone.now()),
    }
    return render(request, "site/home.html", context)


@require_safe
@never_cache
@limited(LISTS, reading=True, json=True)
def robots_json(request: HttpRequest) -> JsonResponse:
    """Return the invitation and the cards, with which the landing page updates itself."""
    cards = robots_page(request, timezone.now()).cards
    return JsonResponse(
        {
            "invitation": asdict(_invitation(request.user, cards)),
            "robots": [asdict(card) for card in cards],
        }
    )


@require_safe
def about(request: HttpRequest) -> HttpResponse:
    return render(request, "site/about.html", {"stays": STAYS.values()})


@require_safe
def manifest(_request: HttpRequest) -> JsonResponse:
    """Return the web app manifest; a view, because the icons' addresses contain hashes."""
    icons = [
        {
            "src": static(f"img/icons/{name}.png"),
            "sizes": size,
            "type": "image/png",
            "purpose": purpose,
        }
        for name, size, purpose in (
            ("icon-192", "192x192", "any"),
            ("icon-512", "512x512", "any"),
            ("maskable-512", "512x512", "maskable"),
        )
    ]
    home = reverse("home")
    small = {name: value for name, value in icons[0].items() if name != "purpose"}
    shortcuts = ((_("Robots"), f"{home}#robots"), (_("What we record"), reverse("about")))
    content = {
        "name": _("Telepresence"),
        "short_name": _("Telepresence"),
        "description": _("Drive a real robot somewhere else."),
        "display": "standalone",
        "orientation": "any",
        "background_color": "#fbf7f0",
        "theme_color": "#0b6662",
        "icons": icons,
        "id": home,
        "start_url": home,
        "scope": home,
        "lang": get_language(),
        "dir": "ltr",
        "categories": ["utilities", "social"],
        "shortcuts": [{"name": name, "url": url, "icons": [small]} for name, url in shortcuts],
        "screenshots": _screenshots(),
    }
    return JsonResponse(content, content_type="application/manifest+json")


def _screenshots() -> list[dict[str, str]]:
    """Return the pictures that browsers show when the page is installed, taken by
    tests/support/browsers/screenshots.py.
    """
    shown = (
        ("wide", "1280x800", _("Driving, on a large screen")),
        ("narrow", "390x844", _("Driving, on a phone")),
    )
    return [
        {
            "src": static(f"img/screens/drive-{form}.webp"),
            "sizes": size,
            "type": "image/webp",
            "form_factor": form,
            "label": label,
        }
        for form, size, label in shown
    ]


@dataclass(frozen=True)
class RobotsPage:
    """One page of the visible robots that match a search: their cards, its number, the number of
    pages, and the search. `previous` and `next` are the queries of the pages beside it, or empty.
    """

    cards: list[RobotCard]
    number: int
    pages: int
    searched: str
    previous: str = ""
    next: str = ""

    @property
    def has_controls(self) -> bool:
        return self.pages > 1 or bool(self.searched)


def robots_page(request: HttpRequest, now: datetime.datetime) -> RobotsPage:
    """Return the page of a request (`page`, from 1; `q`, words of which each is in the title, name
    or description), or the nearest one. Robots that are online are first; on a page, those that can
    be driven now.
    """
    searched = request.GET.get("q", "").strip()[:MAX_SEARCH]
    rows = _in_order(_found(robots_visible_to(request.user).filter(practice=False), searched), now)
    given = request.GET.get("page", "")
    number = int(given) if given.isdecimal() and 0 < int(given[:9]) < MAX_PAGE else 1
    robots = list(rows[(number - 1) * PER_PAGE : number * PER_PAGE + 1])
    pages = number
    if number > 1 or len(robots) > PER_PAGE:  # most sites have one page, and need not count
        pages = max(1, -(-rows.count() // PER_PAGE))
    if number > pages:
        number = pages
        robots = list(rows[(number - 1) * PER_PAGE : number * PER_PAGE])
    words = {"q": searched} if searched else {}
    return RobotsPage(
        cards_for(request.user, robots[:PER_PAGE], now),
        number,
        pages,
        searched,
        previous=urlencode({**words, "page": number - 1}) if number > 1 else "",
        next=urlencode({**words, "page": number + 1}) if number < pages else "",
    )


def _found(robots: QuerySet[Robot], searched: str) -> QuerySet[Robot]:
    for word in searched.split()[:MAX_WORDS]:
        robots = robots.filter(
            Q(title__icontains=word) | Q(name__icontains=word) | Q(description__icontains=word)
        )
    return robots


def _in_order(robots: QuerySet[Robot], now: datetime.datetime) -> QuerySet[Robot]:
    return (
        robots.order_by(Robot.online_at(now).desc(), "for_experienced", "title", "name")
        .select_related("floor_plan")
        .defer("floor_plan__image")
    )


def cards_for(user: Any, robots: list[Robot], now: datetime.datetime) -> list[RobotCard]:
    """Return a card for each of these robots. Those that `user` can drive, now or in turn, are
    first, and of them those for beginners.
    """
    sessions = living_sessions(robots)
    verdicts = may_drive_each(user, robots) if user.is_authenticated else {}
    cards = []
    for robot in robots:
        traffic = traffic_at(robot, sessions.get(robot.pk, []), now, user)
        barred, url = (
            verdicts[robot.pk].reason if verdicts else "",
            reverse("drive", args=[robot.name]),
        )
        built = card(robot, traffic, barred=barred, url=url, now=now)
        if not user.is_authenticated:
            built = replace(built, url=f"{reverse('account_signup')}?{urlencode({'next': url})}")
        elif built.drives:
            built = replace(built, url=f"{url}?go=1")
        cards.append(built)
    return sorted(
        cards, key=lambda c: (not c.drives, c.drives and c.for_experienced, STATES.index(c.state))
    )


def _invitation(user: Any, cards: list[RobotCard]) -> Invitation:
    """Return the invitation to the visitor's own drive or queue, or else to a free robot. A robot
    for experienced drivers is never suggested: the visitor is invited to wait for another one.
    """
    easy = [c for c in cards if not c.for_experienced]
    first = next((c for c in cards if c.own), None)
    first = first or next((c for c in easy if c.state == "available"), None)
    if first is None and len(easy) < len(cards):
        first = next((c for c in easy if c.drives), None)
    if first is not None:
        label = first.action if user.is_authenticated else _("Sign up and drive")
        return Invitation(label=label, url=first.url)
    return Invitation(label=_("See the robots"), url="#robots")
