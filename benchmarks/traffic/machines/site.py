"""A whole site on three machines, as docs/howto/run-a-cluster.md has it: on each of them etcd,
PostgreSQL run by Patroni, a node of NATS, a session manager and a web process, and one Redis.
"""

import asyncio
import contextlib
import secrets
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from benchmarks.traffic.machines.machine import NETWORK, Machine, machines
from telepresence_site.serving import APPLICATION, DAPHNE
from tests.support.clustered_brokers.nats import NatsNodes
from tests.support.clustered_brokers.site import ClusterSite
from tests.support.collected import collected_files
from tests.support.programs.patroni import PASSWORD, EtcdNode, PatroniNode, owned_folder
from tests.support.programs.postgres import OWNER
from tests.support.programs.redis import Redis
from tests.support.sessions.site import free_port, wait_for

WEB_PORT = 8000
MANAGER, WEB = "session-manager", "web"
ONLINE = """
from django.utils import timezone
from robots.models import Robot
print(Robot.objects.get(name={name!r}).is_online(timezone.now()))
"""
DOCKED = """
from robots.models import Robot
print(Robot.objects.filter(name={name!r}, presence__report__docked=True).exists())
"""


@dataclass
class MachinesSite(ClusterSite):
    """A site whose processes `session-manager-N` and `web-N` run on machine N; all others run
    beside the machines, as robots and staff do.
    """

    machines: list[Machine] = field(kw_only=True)
    here: Machine | None = None

    @property
    def environment(self) -> dict[str, str]:
        if self.here is None:
            return super().environment
        nodes = self.cluster.places[self.here.number :] + self.cluster.places[: self.here.number]
        own = {
            "VAR_DIR": str(self.here.folder),
            "MQTT_URL": ",".join(node.url for node in nodes),
        }
        return {**super().environment, **own}

    def start(self, name: str, arguments: list[str] | None = None) -> None:
        kind, _, number = name.rpartition("-")
        if kind not in (MANAGER, WEB):
            super().start(name, arguments)
            return
        self.here = self.machines[int(number)]
        try:
            with self.here.within():
                super().start(name, arguments)
        finally:
            self.here = None

    def robot_is_online(self, name: str) -> bool:
        return self.django(ONLINE.format(name=name)).strip() == "True"

    def robot_is_docked(self, name: str) -> bool:
        return self.django(DOCKED.format(name=name)).strip() == "True"

    def start_processes(self) -> dict[str, str]:
        """Start a session manager and a web process on each machine; return the host and port of
        each web process.
        """
        webs = {}
        for machine in self.machines:
            (machine.folder / "static").symlink_to(collected_files())
            self.start(f"{MANAGER}-{machine.number}", ["manage.py", "run_session_manager"])
            name = f"{WEB}-{machine.number}"
            self.start(name, [*DAPHNE, "-b", machine.address, "-p", str(WEB_PORT), APPLICATION])
            webs[name] = f"{machine.address}:{WEB_PORT}"
        return webs


@dataclass(frozen=True)
class Placed:
    """A program on a machine, which can crash: how it is started, killed, and which process it
    is.
    """

    machine: Machine
    begin: Callable[[], object]
    kill: Callable[[], object]
    find: Callable[[], int]

    @property
    def pid(self) -> int:
        """Return the id of its first process."""
        return self.find()

    def start(self) -> None:
        """Start it, again if it was killed."""
        with self.machine.within():
            self.begin()


@dataclass
class Machines:
    """Everything that runs on three machines, by name; `webs` has host and port of each web
    process.
    """

    machines: list[Machine]
    site: MachinesSite
    webs: dict[str, str] = field(default_factory=dict)
    placed: dict[str, Placed] = field(default_factory=dict)


@contextlib.contextmanager
def running_machines(folder: Path, **settings: str) -> Iterator[Machines]:
    """Start all of it on three machines."""
    with contextlib.ExitStack() as stack:
        on = stack.enter_context(machines(3, folder))
        (folder / "nats").mkdir()
        nodes = NatsNodes(folder / "nats", on)
        site = MachinesSite(folder / "var", settings=dict(settings), cluster=nodes, machines=on)
        site.var.mkdir()
        made = Machines(on, site)
        site.settings["SECRET_KEY"] = secrets.token_urlsafe(48)
        site.settings["ALLOWED_HOSTS"] = ",".join(machine.address for machine in on)
        redis = Redis(on[-1].folder, on[-1].address)
        made.placed["redis"] = Placed(on[-1], redis.start, redis.kill, lambda: redis.pid)
        site.settings["REDIS_URL"] = redis.url
        _databases(made, stack)
        stack.callback(redis.kill)
        made.placed["redis"].start()
        site.write_users()
        stack.callback(nodes.stop)
        nodes.start()
        asyncio.run(nodes.ready())
        for machine, node in zip(on, nodes.nodes, strict=True):
            made.placed[f"broker-{machine.number}"] = Placed(
                machine, node.start, node.kill, lambda node=node: node.process.pid
            )
        stack.callback(site.stop_all)
        made.webs = site.start_processes()
        yield made


def _databases(made: Machines, stack: contextlib.ExitStack) -> None:
    on = made.machines
    etcds = [
        EtcdNode(f"etcd-{one.number}", stack.enter_context(owned_folder()), one.address)
        for one in on
    ]
    servers = [
        PatroniNode(
            stack.enter_context(owned_folder()),
            free_port(),
            name=f"database-{one.number}",
            etcd=tuple(node.address for node in etcds),
            host=one.address,
            clients=NETWORK,
        )
        for one in on
    ]
    for machine, etcd, server in zip(on, etcds, servers, strict=True):
        made.placed[etcd.name] = Placed(
            machine, partial(etcd.start, etcds), etcd.kill, lambda etcd=etcd: etcd.process.pid
        )
        made.placed[server.name] = Placed(
            machine, server.begin, server.kill, lambda server=server: server.patroni[-1].pid
        )
    first, *others = servers
    first.adopt()
    for etcd in etcds:
        stack.callback(etcd.kill)
        made.placed[etcd.name].start()
    for server in servers:
        stack.callback(server.kill)
        made.placed[server.name].start()
        wait_for(first.is_leading, 90, "a primary", first.log)
    wait_for(lambda: all(one.is_following() for one in others), 120, "standbys", others[0].log)
    hosts = ",".join(f"{one.host}:{one.port}" for one in servers)
    made.site.settings["DATABASE_URL"] = f"postgres://{OWNER}:{PASSWORD}@{hosts}/postgres"
