"""`/metrics`: figures for Prometheus. No label names a person, an address or a session.

Each web process reports its own figures (pages, relayed messages, HTTP requests), and those of the
whole site, which it reads in the database (sessions, robots, queues, reports of session managers).

A request needs the bearer token METRICS_TOKEN, or a direct connection from METRICS_ALLOWED; any
other is answered with 404. A request with X-Forwarded-For is not direct: behind a proxy, every
client has the proxy's address.
"""

import datetime
import hmac
import ipaddress
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from channels.db import database_sync_to_async
from django.conf import settings
from django.db.models import Count, Q, QuerySet
from django.http import Http404, HttpRequest, HttpResponse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe
from prometheus_client import REGISTRY, CollectorRegistry, Metric
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest
from prometheus_client.registry import Collector

from robots.bridge import bridge as mqtt_bridge
from robots.models import Robot
from sessions.consumers import peers
from sessions.models import Lease, ManagerBeat, Session
from telepresence_site.ops.health import WELL, disk, managers_state

Labelled = Mapping[str, float]  # a figure by the value of its label
PREFIX = "telepresence_"


@never_cache
@require_safe
async def metrics(request: HttpRequest) -> HttpResponse:
    if not may_read(request):
        raise Http404
    _word, free = await disk.read()  # None of a disk that does not answer
    of_the_site = await database_sync_to_async(_of_the_site)(timezone.now())
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collected([*_of_this_process(free), *of_the_site]))
    return HttpResponse(
        generate_latest(REGISTRY) + generate_latest(registry), content_type=CONTENT_TYPE_LATEST
    )


def may_read(request: HttpRequest) -> bool:
    """Tell whether a request has the token, or comes from one of the addresses."""
    given = request.headers.get("Authorization", "")
    if settings.METRICS_TOKEN and hmac.compare_digest(
        given.encode(), f"Bearer {settings.METRICS_TOKEN}".encode()
    ):
        return True
    if "X-Forwarded-For" in request.headers or "Forwarded" in request.headers:
        return False
    try:
        address = ipaddress.ip_address(request.META.get("REMOTE_ADDR", ""))
    except ValueError:
        return False
    return any(
        address in ipaddress.ip_network(network, strict=False)
        for network in settings.METRICS_ALLOWED
    )


class _Collected(Collector):
    def __init__(self, families: list[Metric]) -> None:
        self._families = families

    def collect(self) -> Iterator[Metric]:
        return iter(self._families)


def _of_this_process(free: int | None) -> Iterator[Metric]:
    bridge = mqtt_bridge.current()
    yield _gauge(
        "broker_connected", "Whether this web process reaches the broker.", float(bridge.connected)
    )
    yield _gauge("disk_silent", "Whether the disk of VAR_DIR does not answer.", float(free is None))
    if free is not None:
        yield _gauge("disk_free_bytes", "Free space on the disk of VAR_DIR.", float(free))
    messages = "Messages between broker and pages, by outcome."
    yield _counter("bridge", messages, "what", bridge.counts)
    yield _gauges("pages", "Open drive pages, by activity.", "standing", peers.counts_by_role())
    refused = "Refused messages from pages, by reason."
    yield _counter("refused_frames", refused, "reason", peers.refusals())


def _of_the_site(now: datetime.datetime) -> list[Metric]:
    return [
        *_sessions(),
        *_robots(now),
        *_managers(list(ManagerBeat.objects.order_by("name")), now),
    ]


def _sessions() -> Iterator[Metric]:
    ended, live = Q(state=Session.State.ENDED), ~Q(state=Session.State.ENDED)
    sessions = Session.objects.order_by()
    outcomes = dict.fromkeys(Session.Outcome.values, 0) | _count(sessions.filter(ended), "outcome")
    states = dict.fromkeys(Session.State.values, 0) | _count(sessions.filter(live), "state")
    del states[Session.State.ENDED]
    yield _gauges("sessions_ended", "Sessions in the database by outcome.", "outcome", outcomes)
    yield _gauges("sessions_live", "Sessions in progress, by state.", "state", states)
    yield _gauge(
        "records_open",
        "Ended sessions whose record is not complete yet.",
        Session.objects.filter(state="ended", closed_at=None).count(),
    )


def _robots(now: datetime.datetime) -> Iterator[Metric]:
    read = ("connection", "last_seen_at", "report")
    rows = Robot.objects.filter(enabled=True, practice=False)
    robots = list(rows.only("name", "enabled", *(f"presence__{name}" for name in read)))
    queues = _count(Session.objects.order_by().filter(state=Session.State.WAITING), "robot")
    leased = set(Lease.objects.filter(session__isnull=False).values_list("robot_id", flat=True))
    charges = {
        robot.name: (robot.presence.report or {}).get("battery", {}).get("charge")
        for robot in robots
    }
    figures: dict[str, tuple[str, Labelled]] = {
        "online": ("Whether a robot is online.", {r.name: r.is_online(now) for r in robots}),
        "leased": ("Whether somebody is using a robot.", {r.name: r.pk in leased for r in robots}),
        "queue_length": (
            "Visitors who wait for a robot.",
            {r.name: queues.get(r.pk, 0) for r in robots},
        ),
        "charge": (
            "A robot's charge, 0 to 1.",
            {name: charge for name, charge in charges.items() if charge is not None},
        ),
    }
    for name, (text, values) in figures.items():
        yield _gauges(f"robot_{name}", text, "robot", values)


def _managers(rows: Sequence[ManagerBeat], now: datetime.datetime) -> Iterator[Metric]:
    yield _gauge(
        "session_manager_well",
        "Whether the session managers work.",
        float(managers_state(rows, now) == WELL),
    )
    if not rows:
        return
    held = [row for row in rows if row.holder] or rows
    yield _gauge(
        "session_manager_beat_age_seconds",
        "Time since the last heartbeat of the session manager that has been silent longest.",
        max((now - row.beat_at).total_seconds() for row in held),
    )
    yield _gauges(
        "session_manager_shards",
        "Shards of the robots that a session manager owns, of 64.",
        "manager",
        {row.name: row.report.get("shards", 0) for row in held if row.holder},
    )
    yield from _of_recorders([row.report for row in held])


def _of_recorders(reports: Sequence[dict[str, Any]]) -> Iterator[Metric]:
    waiting = sum(report.get("waiting", 0) for report in reports)
    yield _gauge("recorder_waiting", "Items that wait to be written into the record.", waiting)
    for name, text, label, key in (
        ("recorded", "Items that the recorder handled since it started.", "what", "counts"),
        (
            "robot_refused_commands",
            "Commands that robots refused during sessions, by reason.",
            "reason",
            "refused",
        ),
        ("rejected_messages", "Malformed messages to the session manager.", "reason", "rejected"),
    ):
        total: Counter[str] = Counter()
        for report in reports:
            total.update(report.get(key, {}))
        yield _counter(name, text, label, total)


def _count(sessions: "QuerySet[Session]", field: str) -> dict[Any, int]:
    """Return the number of sessions by the value of a field."""
    return dict(sessions.values_list(field).annotate(n=Count("pk")))


def _gauge(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(PREFIX + name, text, value=value)


def _gauges(name: str, text: str, label: str, values: Labelled) -> Metric:
    return _filled(GaugeMetricFamily(PREFIX + name, text, labels=[label]), values)


def _counter(name: str, text: str, label: str, values: Labelled) -> Metric:
    return _filled(CounterMetricFamily(PREFIX + name, text, labels=[label]), values)


def _filled(family: GaugeMetricFamily | CounterMetricFamily, values: Labelled) -> Metric:
    for label, value in sorted(values.items()):
        family.add_metric([label], float(value))
    return family
