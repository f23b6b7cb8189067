"""`/metrics`: how the site does, in figures, as Prometheus reads them. No label names a person, an
address or a session.

A web process tells its own figures (its pages, its share of the relaying, its HTTP requests), and
what the database knows of the whole site (sessions, robots, queues, and what the session manager
reports with its beat), which is therefore the same from every web process.

It answers 404 unless its bearer token (METRICS_TOKEN) comes along, or the connection comes straight
from an address of METRICS_ALLOWED. A connection through a proxy, recognized by X-Forwarded-For,
never counts as one of those: behind a proxy everybody has its address.
"""

import datetime
import hmac
import ipaddress
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from channels.db import database_sync_to_async
from django.conf import settings
from django.db.models import Count
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

Labelled = dict[str, float]
PREFIX = "telepresence_"


@never_cache
@require_safe
async def metrics(request: HttpRequest) -> HttpResponse:
    """Answer with every figure, to those who may see them."""
    if not may_read(request):
        raise Http404
    _word, free = await disk.read()  # None of a disk that does not answer
    of_the_site = await database_sync_to_async(_of_the_site)(timezone.now())
    families = [*_of_this_process(free), *of_the_site]
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Ready(families))
    return HttpResponse(
        generate_latest(REGISTRY) + generate_latest(registry), content_type=CONTENT_TYPE_LATEST
    )


def may_read(request: HttpRequest) -> bool:
    """Tell whether whoever asks has the token, or one of the addresses."""
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


class _Ready(Collector):
    """Families that are counted already."""

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
    yield _counter(
        "bridge",
        "Messages between broker and pages, by outcome.",
        "what",
        dict(bridge.counts),
    )
    yield _gauges(
        "pages", "Open drive pages, by activity.", "standing", dict(peers.counts_by_role())
    )
    yield _counter(
        "refused_frames",
        "Refused messages from pages, by reason.",
        "reason",
        dict(peers.refusals()),
    )


def _of_the_site(now: datetime.datetime) -> list[Metric]:
    return [
        *_sessions(),
        *_robots(now),
        *_managers(list(ManagerBeat.objects.order_by("name")), now),
    ]


def _sessions() -> Iterator[Metric]:
    ended = (
        Session.objects.filter(state=Session.State.ENDED)
        .order_by()
        .values_list("outcome")
        .annotate(n=Count("pk"))
    )
    live = dict(
        Session.objects.exclude(state=Session.State.ENDED)
        .order_by()
        .values_list("state")
        .annotate(n=Count("pk"))
    )
    outcomes = dict.fromkeys(Session.Outcome.values, 0) | dict(ended)
    states = {
        state: live.get(state, 0) for state in Session.State.values if state != Session.State.ENDED
    }
    yield _gauges("sessions_ended", "Sessions in the database by outcome.", "outcome", outcomes)
    yield _gauges("sessions_live", "Sessions in progress, by state.", "state", states)
    yield _gauge(
        "records_open",
        "Ended sessions whose record is not complete yet.",
        Session.objects.filter(state="ended", closed_at=None).count(),
    )


def _robots(now: datetime.datetime) -> Iterator[Metric]:
    in_use = Robot.objects.filter(enabled=True, practice=False)
    robots = list(
        in_use.only(
            "name",
            "enabled",
            "presence__connection",
            "presence__last_seen_at",
            "presence__report",
        )
    )
    waiting = Session.objects.filter(state=Session.State.WAITING).order_by()
    queues = dict(waiting.values_list("robot").annotate(n=Count("pk")))
    held = set(Lease.objects.filter(session__isnull=False).values_list("robot_id", flat=True))
    charges = {
        robot.name: (robot.presence.report or {}).get("battery", {}).get("charge")
        for robot in robots
    }
    yield _gauges(
        "robot_online",
        "Whether a robot is online.",
        "robot",
        {robot.name: robot.is_online(now) for robot in robots},
    )
    yield _gauges(
        "robot_leased",
        "Whether somebody is using a robot.",
        "robot",
        {robot.name: robot.pk in held for robot in robots},
    )
    yield _gauges(
        "robot_queue_length",
        "Visitors who wait for a robot.",
        "robot",
        {robot.name: queues.get(robot.pk, 0) for robot in robots},
    )
    yield _gauges(
        "robot_charge",
        "A robot's charge, 0 to 1.",
        "robot",
        {name: charge for name, charge in charges.items() if charge is not None},
    )


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
    yield _gauge(
        "recorder_waiting",
        "Items that wait to be written into the record.",
        sum(report.get("waiting", 0) for report in reports),
    )
    yield _counter(
        "recorded",
        "Items that the recorder handled since it started.",
        "what",
        _sum(reports, "counts"),
    )
    yield _counter(
        "robot_refused_commands",
        "Commands that robots refused during sessions, by reason.",
        "reason",
        _sum(reports, "refused"),
    )
    yield _counter(
        "rejected_messages",
        "Malformed messages to the session manager.",
        "reason",
        _sum(reports, "rejected"),
    )


def _sum(reports: Sequence[dict[str, Any]], name: str) -> Labelled:
    total: Counter[str] = Counter()
    for report in reports:
        total.update(report.get(name, {}))
    return dict(total)


def _gauge(name: str, says: str, value: float) -> Metric:
    return GaugeMetricFamily(PREFIX + name, says, value=value)


def _gauges(name: str, says: str, label: str, values: Labelled) -> Metric:
    return _filled(GaugeMetricFamily(PREFIX + name, says, labels=[label]), values)


def _counter(name: str, says: str, label: str, values: Labelled) -> Metric:
    return _filled(CounterMetricFamily(PREFIX + name, says, labels=[label]), values)


def _filled(family: GaugeMetricFamily | CounterMetricFamily, values: Labelled) -> Metric:
    for label, value in sorted(values.items()):
        family.add_metric([label], float(value))
    return family
