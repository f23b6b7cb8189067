"""The servers that are loaded: as `make demo` runs them, and as a server does (PostgreSQL, Redis,
Mosquitto or a cluster of three NATS nodes, one web process and one session manager or more).

Settings, processes and commands are those of the project; only the proxy is left out, whose share
is small and whose TLS would cost the load generator more than all the rest.
"""

import asyncio
import contextlib
import json
import re
import signal
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.traffic.machines.machine import Partition
from benchmarks.traffic.machines.site import Placed, running_machines
from benchmarks.traffic.verdicts import DrivePeriod, NumberedState
from telepresence_site.serving import APPLICATION, DAPHNE
from tests.support.clustered_brokers.nats import HOST, NatsNodes
from tests.support.clustered_brokers.node import Node
from tests.support.clustered_brokers.site import ClusterSite
from tests.support.programs.janus import Janus
from tests.support.programs.postgres import Postgres, running_postgres
from tests.support.programs.redis import Redis
from tests.support.sessions.site import LOOPBACK, Site, free_port, wait_for

ROBOTS = """
import json
from django.utils import timezone
from robots.enrol.credentials import make_credentials
from robots.models import Robot
made = [Robot.objects.create(name=name, title=name, returns_home=False) for name in {names!r}]
print(json.dumps([[robot.name, make_credentials(robot, timezone.now()).token] for robot in made]))
"""
VISITORS = """
import json
from importlib import import_module
from django.conf import settings
from django.contrib.auth import BACKEND_SESSION_KEY, HASH_SESSION_KEY, SESSION_KEY
from accounts.models import User
made = []
for name in {names!r}:
    user = User.objects.create(username=name)
    session = import_module(settings.SESSION_ENGINE).SessionStore()
    session[SESSION_KEY] = str(user.pk)
    session[BACKEND_SESSION_KEY] = settings.AUTHENTICATION_BACKENDS[0]
    session[HASH_SESSION_KEY] = user.get_session_auth_hash()
    session.save()
    made.append(session.session_key)
print(json.dumps(made))
"""
RECORD = """
import json
from sessions.models import SessionEvent, StateChunk
chunks = StateChunk.objects.order_by("first_stamp").select_related("session__robot")
states = [
    [chunk.session.robot.name, chunk.boot, state["seq"], state["session"], state.get("epoch", 0)]
    for chunk in chunks
    for state in chunk.states
]
events = SessionEvent.objects.filter(type="states_missing")
missing = [[str(event.session_id), event.data["count"]] for event in events]
print(json.dumps({"states": states, "missing": missing}))
"""
STORED = """
import json
from django.db.models import Sum
from sessions.models import StateChunk
rows = StateChunk.objects.values("session").annotate(total=Sum("count"))
print(json.dumps({str(row["session"]): row["total"] for row in rows}))
"""
APPLIED = """
import json
from collections import defaultdict
from sessions.models import StateChunk
applied = defaultdict(list)
for session, states in StateChunk.objects.values_list("session", "states"):
    for state in states:
        applied[str(session)] += [one["stamp"] + one["age"] for one in state.get("applied", ())]
print(json.dumps(list(applied.values())))
"""
DRIVEN = """
import json
from sessions.models import StateChunk
chunks = StateChunk.objects.filter(first_stamp__gt={since})
driven = {{
    name
    for name, states in chunks.values_list("session__robot__name", "states")
    if any(state.get("applied") for state in states)
}}
print(json.dumps(sorted(driven)))
"""
SESSIONS = """
import json
from sessions.models import Session
rows = Session.objects.exclude(granted_at=None).order_by("granted_at").select_related("robot")
print(json.dumps([
    [
        str(row.pk),
        row.robot.name,
        row.granted_at.timestamp(),
        row.ended_at and row.ended_at.timestamp(),
        row.outcome,
    ]
    for row in rows
]))
"""
UNCLOSED = """
import json
from sessions.models import Session
unclosed = Session.objects.filter(closed_at=None)
print(json.dumps([str(pk) for pk in unclosed.values_list("pk", flat=True)]))
"""
MANAGERS = """
from sessions.models import Shard
print(len(set(Shard.objects.exclude(owner=None).values_list("owner", flat=True))))
"""


@dataclass(frozen=True)
class StateRecord:
    """All stored states in the order of their stamps, and how many are known to be missing, by
    session.
    """

    states: list[NumberedState]
    missing: dict[str, int]


@dataclass
class Database:
    """PostgreSQL, which can crash."""

    postgres: Postgres

    @property
    def pid(self) -> int:
        return int(
            (self.postgres.directory / "data" / "postmaster.pid").read_text().splitlines()[0]
        )

    def start(self) -> None:
        """Start it again."""
        self.postgres.start()

    def kill(self) -> None:
        """End it without a word to its clients."""
        self.postgres.stop()


@dataclass
class BrokerNode:
    """A node of a clustered broker, which can crash."""

    node: Node

    @property
    def pid(self) -> int:
        return int(self.node.process.pid)

    def start(self) -> None:
        """Start it again."""
        self.node.start()

    def kill(self) -> None:
        """End it without a word."""
        self.node.kill()


OutsidePart = Redis | Database | BrokerNode | Placed | Janus


@dataclass
class RunningSite:
    """A running site and queries to it. `webs` has the host and port of each web process, `outside`
    the programs of others, `cables` the links that can be cut.
    """

    site: Site
    webs: dict[str, str]
    outside: dict[str, OutsidePart]
    cables: dict[str, Partition] = field(default_factory=dict)

    @property
    def brokers(self) -> list[tuple[str, int]]:
        if isinstance(self.site, ClusterSite):
            return [(node.host, node.mqtt) for node in self.site.cluster.places]
        return [(LOOPBACK, self.site.mqtt_port)]

    @property
    def processes(self) -> dict[str, int]:
        ours = {name: process.pid for name, process in self.site.processes.items()}
        return {**ours, **{name: part.pid for name, part in self.outside.items()}}

    def kill(self, part: str) -> None:
        if part in self.cables:
            self.cables[part].begin()
        elif part in self.outside:
            self.outside[part].kill()
        else:
            self.site.stop(part, signal.SIGKILL)

    def start(self, part: str) -> None:
        if part in self.cables:
            self.cables[part].end()
        elif part in self.outside:
            self.outside[part].start()
        else:
            self.site.start(part)

    def make_robots(self, names: list[str]) -> list[list[str]]:
        made: list[list[str]] = json.loads(self.site.django(ROBOTS.format(names=names)))
        if isinstance(self.site, ClusterSite):
            self.site.write_users()
            self.site.cluster.reload()
        return made

    def make_visitors(self, names: list[str], robots: list[str]) -> list[list[str]]:
        """Return [address of the WebSocket, cookie] of new visitors, each at its robot, spread over
        the web processes.
        """
        cookies: list[str] = json.loads(self.site.django(VISITORS.format(names=names)))
        webs = list(self.webs.values())
        addresses = [
            f"http://{webs[number % len(webs)]}/ws/robots/{robot}/"
            for number, robot in enumerate(robots)
        ]
        return [list(pair) for pair in zip(addresses, cookies, strict=True)]

    def stored(self) -> dict[str, int]:
        """Return how many states the record has, by session."""
        found: dict[str, int] = json.loads(self.site.django(STORED))
        return found

    def record(self) -> StateRecord:
        found = json.loads(self.site.django(RECORD))
        return StateRecord([NumberedState(*row) for row in found["states"]], dict(found["missing"]))

    def took_commands(self, since: float) -> list[str]:
        """Return the robots that took a command after this time, by the stored record; for these,
        every part between page and database works.
        """
        found: list[str] = json.loads(self.site.django(DRIVEN.format(since=since)))
        return found

    def applied(self) -> list[list[float]]:
        """Return when commands were applied, by drive."""
        found: list[list[float]] = json.loads(self.site.django(APPLIED))
        return found

    def unclosed(self) -> list[str]:
        """Return the sessions of whose record something is still awaited."""
        found: list[str] = json.loads(self.site.django(UNCLOSED))
        return found

    def sessions(self) -> list[DrivePeriod]:
        return [DrivePeriod(*row) for row in json.loads(self.site.django(SESSIONS))]

    def managers(self) -> int:
        """Return how many session managers share the robots."""
        return int(self.site.django(MANAGERS))

    def is_ready(self) -> bool:
        """Tell whether every web process says that broker, database and session
        manager are there.
        """
        return all(_is_ready(web) for web in self.webs.values())


def _is_ready(web: str) -> bool:
    try:
        with urllib.request.urlopen(f"http://{web}/readyz", timeout=5) as answer:
            return bool(answer.status == 200)
    except (urllib.error.URLError, OSError):
        return False


KIND = re.compile(r"demo|server-(?P<webs>\d+)(-managers-(?P<managers>\d+))?(?P<nats>-nats)?")


# all visitors come from this computer
SETTINGS = {"LOG_LEVEL": "WARNING", "SOCKETS_PER_ADDRESS": "10000"}


@contextlib.contextmanager
def running_place(kind: str, directory: Path, **more: str) -> Iterator[RunningSite]:
    """Run a place: `demo`, or `server-W` with W web processes, `server-W-managers-M` with M session
    managers, either with `-nats` for a broker of three nodes, or `machines` for a cluster on three
    machines; everything is ended afterwards. `more` are settings.
    """
    if kind == "machines":
        with running_machines(directory, **SETTINGS, **more) as on:
            one, *others = on.machines
            cables = {"partition": Partition([one], others)}
            place = RunningSite(on.site, on.webs, dict(on.placed), cables)
            _await(place, len(on.machines))
            yield place
        return
    found = KIND.fullmatch(kind)
    if found is None:
        raise ValueError(
            f"there is no place {kind}: demo, machines, or server-W[-managers-M][-nats]"
        )
    with contextlib.ExitStack() as stack:
        outside: dict[str, OutsidePart] = {}
        settings = SETTINGS | more
        if kind != "demo":
            database, redis = Database(stack.enter_context(running_postgres())), Redis(directory)
            redis.start()
            stack.callback(redis.kill)
            outside = {"database": database, "redis": redis}
            settings |= {"DATABASE_URL": database.postgres.url, "REDIS_URL": redis.url}
        site = _site(directory, settings, is_clustered=bool(found["nats"]))
        stack.callback(site.stop_all)
        ports = (
            {"web": site.web_port}
            if kind == "demo"
            else {f"web-{n}": free_port() for n in range(int(found["webs"]))}
        )
        webs = {name: f"{LOOPBACK}:{port}" for name, port in ports.items()}
        place = RunningSite(site, webs, outside)
        if kind == "demo":
            site.prepare()
        else:
            site.var.mkdir(parents=True, exist_ok=True)
            site.run("manage.py", "migrate", "-v", "0")
        _start_broker(place, stack)
        _start(place, int(found["managers"] or 1))
        yield place


def _site(directory: Path, settings: Mapping[str, str], *, is_clustered: bool) -> Site:
    if not is_clustered:
        return Site(directory / "var", settings=dict(settings))
    nodes = directory / "nats"
    nodes.mkdir()
    return ClusterSite(
        directory / "var", settings=dict(settings), cluster=NatsNodes(nodes, [HOST] * 3)
    )


def _start_broker(place: RunningSite, stack: contextlib.ExitStack) -> None:
    site = place.site
    if not isinstance(site, ClusterSite):
        site.start_broker()
        return
    site.write_users()
    site.cluster.start()
    stack.callback(site.cluster.stop)
    asyncio.run(site.cluster.ready())
    place.outside |= {f"broker-{n}": BrokerNode(node) for n, node in enumerate(site.cluster.nodes)}


def _start(place: RunningSite, managers: int) -> None:
    site = place.site
    for n in range(managers):
        name = "session-manager" if n == 0 else f"session-manager-{n}"
        site.start(name, ["manage.py", "run_session_manager"])
    for name, web in place.webs.items():
        host, _, port = web.partition(":")
        site.start(name, [*DAPHNE, "-b", host, "-p", port, APPLICATION])
    _await(place, managers)


def _await(place: RunningSite, managers: int) -> None:
    wait_for(place.is_ready, 60, "a site with all its parts")
    wait_for(lambda: place.managers() == managers, 60, f"{managers} session managers with shards")
