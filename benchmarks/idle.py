"""The cost of thousands of idle robots, and the time after a restart of the broker until all can be
driven again.

A server as installed (PostgreSQL, Redis, Mosquitto, the session manager, one web process) runs on
this computer beside the robots, which are light ones with their own MQTT connections and users
(benchmarks/traffic/idle_robots.py). They connect one after the other. Then a subscriber counts all
messages in a quiet period, some robots are woken, and the broker is killed and restarted. A robot
counts as leasable when its row says that it is online, from a message after the restart.

`IDLE_ROBOTS` is the number of robots, `IDLE_QUIET_SECONDS` the length of the quiet period.
"""

import asyncio
import json
import os
import random
import resource
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.table import Figure, keep
from benchmarks.traffic import shares
from benchmarks.traffic.mqtt_line import MqttLine, hello
from benchmarks.traffic.places import RunningSite, running_place
from benchmarks.traffic.worker import Hands
from robots.api import codec, messages as m, topics
from robots.api.idle import WATCHER
from tests.support.sessions.site import LOOPBACK, wait_for

ROBOTS = int(os.environ.get("IDLE_ROBOTS", "10000"))
SECONDS = float(os.environ.get("IDLE_QUIET_SECONDS", "60"))
SETTLE_SECONDS = 10.0
WOKEN = 50
BUS_BOUND, BACK_BOUND_S, WAKE_BOUND_S = 500.0, 60.0, 0.5
PATIENCE_S = 600.0
MAKE = """
import json, time
from django.utils import timezone
from robots.enrol import credentials
from tests.support.robots import create_robots, unsaved_robot
began, made = time.perf_counter(), []
for number in range({robots}):
    token = credentials.new_token()
    made.append((unsaved_robot(
        name=f"idle-{{number}}", title=f"Robot {{number}}", returns_home=False,
        credential_hash=credentials.hash_token(token), credential_made_at=timezone.now(),
    ), token))
hashed = time.perf_counter()
create_robots(*(robot for robot, _ in made))
stored = time.perf_counter()
print(json.dumps({{
    "robots": [[robot.name, token] for robot, token in made],
    "hash_s": hashed - began, "store_s": stored - hashed,
}}))
"""
FILES = """
import json, time
from robots.broker.mosquitto import password_file, permission_file
from robots.broker.users import users_now
began = time.perf_counter()
users = users_now()
read = time.perf_counter()
size = len(password_file(users)) + len(permission_file(users))
print(json.dumps({"read_s": read - began, "write_s": time.perf_counter() - read, "bytes": size}))
"""
SERVER = """
import json
from robots.enrol.credentials import server_credentials
print(json.dumps(server_credentials("web")))
"""
ONLINE = """
import datetime
from robots.models import RobotPresence
since = datetime.datetime.fromtimestamp({since}, datetime.UTC)
print(RobotPresence.objects.filter(connection="ONLINE", last_seen_at__gte=since).count())
"""


class BusListener:
    """A subscriber that counts everything that the broker passes on, by the end of its topic."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.is_open = asyncio.Event()

    def opened(self) -> None:
        self.is_open.set()

    def on_message(self, topic: str, payload: bytes, *, retained: bool) -> None:
        if not retained:
            self.counts[topic.rpartition("/")[2]] += 1

    def acknowledged(self, packet_id: int) -> None:
        pass

    def closed(self) -> None:
        pass


async def listen(place: RunningSite, credentials: list[str]) -> tuple[BusListener, MqttLine]:
    listener = BusListener()
    line = MqttLine(
        listener, hello("bus-listener", *credentials), [(f"{topics.ROOT}/#", 0)], keep_alive=30
    )
    await asyncio.get_running_loop().create_connection(lambda: line, LOOPBACK, place.site.mqtt_port)
    await asyncio.wait_for(listener.is_open.wait(), 30)
    await asyncio.sleep(SETTLE_SECONDS)
    return listener, line


async def count_bus(place: RunningSite, credentials: list[str]) -> dict[str, float]:
    """Return the messages a second that the broker passes on, by the end of their topic."""
    listener, line = await listen(place, credentials)
    listener.counts.clear()
    await asyncio.sleep(SECONDS)
    counts = {name: count / SECONDS for name, count in listener.counts.items()}
    line.leave()
    return counts


async def wake(place: RunningSite, credentials: list[str], names: list[str]) -> list[float]:
    """Wake robots by heartbeats; return the seconds until a state of each arrived."""
    asked: dict[str, float] = {}
    took: dict[str, float] = {}

    class Waiting(BusListener):
        def on_message(self, topic: str, payload: bytes, *, retained: bool) -> None:
            robot, suffix = topics.parse(topic) or ("", "")
            if suffix == "state" and robot in asked and robot not in took:
                took[robot] = time.perf_counter() - asked[robot]

    listener = Waiting()
    filters = [(topics.of(name, "state"), 0) for name in names]
    line = MqttLine(listener, hello("waker", *credentials), filters, keep_alive=30)
    await asyncio.get_running_loop().create_connection(lambda: line, LOOPBACK, place.site.mqtt_port)
    await asyncio.wait_for(listener.is_open.wait(), 30)
    for name in names:
        beat = m.CommandHeartbeat(n=1, stamp=time.time(), peer=WATCHER)
        asked[name] = time.perf_counter()
        line.publish(topics.of(name, "command/heartbeat"), codec.encode(beat))
        await asyncio.sleep(0.05)
    await asyncio.sleep(2.0)
    line.leave()
    return [took.get(name, float("inf")) for name in names]


def online(fleets: list[Hands]) -> int:
    return sum(int(fleet.ask("online")) for fleet in fleets)


def leasable(place: RunningSite, since: float) -> int:
    """Return how many robots the database knows to be online since a moment (Unix seconds)."""
    return int(place.site.django(ONLINE.format(since=since)))


def come(place: RunningSite, fleets: list[Hands], robots: list[list[str]]) -> float:
    """Let all robots come; return after how many seconds the database knew all of them."""
    began, since = time.monotonic(), time.time()
    for number, fleet in enumerate(fleets):
        fleet.ask("add", place.site.mqtt_port, robots[number :: len(fleets)])
    wait_for(lambda: online(fleets) == len(robots), PATIENCE_S, f"{len(robots)} robots connected")
    wait_for(lambda: leasable(place, since) == len(robots), PATIENCE_S, "all of them known")
    return time.monotonic() - began


def restart(place: RunningSite, fleets: list[Hands], count: int) -> dict[str, float]:
    """Kill the broker and start it again; return seconds from then until all were back."""
    attempts = sum(int(fleet.ask("attempts")) for fleet in fleets)
    place.kill("broker")
    wait_for(lambda: online(fleets) == 0, 60, "the robots to notice")
    since, began = time.time(), time.monotonic()
    place.site.start_broker()
    found = {"broker_s": time.monotonic() - began}
    wait_for(lambda: online(fleets) == count, PATIENCE_S, "all robots connected again")
    found["connected_s"] = time.monotonic() - began
    wait_for(lambda: leasable(place, since) == count, PATIENCE_S, "all robots leasable again")
    found["leasable_s"] = time.monotonic() - began
    found["attempts"] = sum(int(fleet.ask("attempts")) for fleet in fleets) - attempts
    return found


def measure(place: RunningSite, fleets: list[Hands]) -> tuple[list[Figure], dict[str, Any]]:
    empty = shares.memory(place.processes)
    made = json.loads(place.site.django(MAKE.format(robots=ROBOTS)))
    robots = made["robots"]
    files = json.loads(place.site.django(FILES))
    print(f"{len(robots)} robots made; they come", flush=True)
    came = come(place, fleets, robots)
    credentials = json.loads(place.site.django(SERVER))
    time.sleep(SETTLE_SECONDS)
    before = shares.read(place.processes)
    bus = asyncio.run(count_bus(place, credentials))
    taken = shares.between(before, shares.read(place.processes))
    full = shares.memory(place.processes)
    names = random.Random(1).sample([name for name, _ in robots], min(WOKEN, len(robots)))
    woken = asyncio.run(wake(place, credentials, names))
    print("quiet time counted; the broker restarts", flush=True)
    back = restart(place, fleets, len(robots))
    each = {name: 1024 * (full[name] - empty[name]) / len(robots) for name in full}
    share = BUS_BOUND * len(robots) / 10_000
    figures = [
        Figure("robots", len(robots), ""),
        Figure("hashes of all tokens", made["hash_s"], "s"),
        Figure("users read from the database", files["read_s"], "s"),
        Figure("the broker's two files made", files["write_s"], "s"),
        Figure("all robots connected and known, from nothing", came, "s"),
        Figure("messages a second on the bus", sum(bus.values()), "", share),
        Figure("memory a connection, broker", each["broker"], "kB"),
        Figure("memory a robot, session manager", each["session-manager"], "kB"),
        Figure("processor, broker", 100 * taken["broker"], "%"),
        Figure("processor, session manager", 100 * taken["session-manager"], "%"),
        Figure("state of a woken robot, p50", float(np.percentile(woken, 50)), "s"),
        Figure("state of a woken robot, max", max(woken), "s", WAKE_BOUND_S),
        Figure("after a restart: broker answers", back["broker_s"], "s"),
        Figure("after a restart: all connected", back["connected_s"], "s"),
        Figure("after a restart: all leasable", back["leasable_s"], "s", BACK_BOUND_S),
        Figure("attempts to connect for each robot", back["attempts"] / len(robots), ""),
    ]
    return figures, {"bus": bus, "shares": taken, "memory": {"empty": empty, "full": full}}


def main() -> int:
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))  # the broker inherits it
    print(f"{ROBOTS} robots; at most {hard} open files a process", flush=True)
    with tempfile.TemporaryDirectory(prefix="telepresence-idle-") as name:
        module = "benchmarks.traffic.idle_robots"
        with running_place("server-1", Path(name)) as place, Hands(module) as a, Hands(module) as b:
            figures, more = measure(place, [a, b])
    return keep("idle", figures, **more)


if __name__ == "__main__":
    sys.exit(main())
