"""The number of drives that a server carries on one computer: control and state traffic only, all
of it through the server, without video.

Robots and visitors are light ones (benchmarks/traffic): real MQTT connections and WebSockets, with
the messages and rates of real ones, in two processes that stamp every message by the computer's
clock. Their number grows until one message in a hundred exceeds the end-to-end bound, or data is
missing. The resource that is then exhausted is printed below the table.

Processor shares are those of one core; `others` is other work on the computer, `stolen` the time
that a host gave to other virtual machines. A delay includes the generators' own delay, which is
printed beside it: a step in which that is large says little about the server.

`LOAD_PLACES` (demo, server-W[-managers-M][-nats]) and `LOAD_STEPS` select the runs.
"""

import json
import os
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.traffic import shares
from benchmarks.traffic.places import RunningSite, running_place
from benchmarks.traffic.worker import Hands
from tests.support.sessions.site import wait_for

RESULTS = Path(__file__).parent / "results" / "load.json"
PLACES = tuple(os.environ.get("LOAD_PLACES", "demo,server-1,server-2").split(","))
STEPS = tuple(
    int(step) for step in os.environ.get("LOAD_STEPS", "10,20,40,60,80,120,160").split(",")
)
SETTLE_SECONDS, MEASURE_SECONDS = 4.0, float(os.environ.get("LOAD_SECONDS", "12"))
DEMANDED = 40  # sessions that must be carried
BOUND_MS = 50.0
RECORD_SECONDS = 15.0
FULL = 0.85  # of a core, that of a process which can use but one


@dataclass
class LoadStep:
    """The measurements with a number of sessions. Delays in ms, shares of a core, memory in MB."""

    sessions: int
    driving: int
    to_robot: dict[str, float]
    to_page: dict[str, float]
    late: dict[str, float]
    messages_per_second: float
    missing: int
    record_behind: float
    shares: dict[str, float]
    memory: dict[str, float] = field(default_factory=dict)

    @property
    def breaks(self) -> str:
        if self.driving < self.sessions:
            return f"only {self.driving} drive"
        if self.record_behind > RECORD_SECONDS:
            return "record behind"
        if max(self.to_robot["p99"], self.to_page["p99"]) > BOUND_MS:
            return "late"
        return f"{self.missing} missing" if self.missing else ""

    @property
    def full(self) -> str:
        name, share = max(
            (
                (name, share)
                for name, share in self.shares.items()
                if name not in {"others", "stolen"}
            ),
            key=lambda pair: pair[1],
        )
        whole = sum(self.shares.values())
        if share >= FULL:
            return f"{name} ({100 * share:.0f} % of its core)"
        return (
            f"the computer ({100 * whole:.0f} % of {100 * (os.cpu_count() or 1)} %, most of it"
            f" {name}, {100 * share:.0f} %)"
        )


def quantiles(seconds: list[float]) -> dict[str, float]:
    """Return p50, p99 and max in milliseconds; of no sample infinity, for then
    nothing has arrived.
    """
    if not seconds:
        return dict.fromkeys(("p50", "p99", "max"), float("inf"))
    values = np.asarray(seconds) * 1000.0
    return {
        "p50": float(np.percentile(values, 50)),
        "p99": float(np.percentile(values, 99)),
        "max": float(values.max()),
    }


def adapter(place: RunningSite, robots: Hands, visitors: Hands) -> list[LoadStep]:
    """Add sessions step by step, until a step breaks; return what was seen."""
    steps: list[LoadStep] = []
    for sessions in STEPS:
        grow(place, robots, visitors, steps[-1].sessions if steps else 0, sessions)
        steps.append(measure(place, robots, visitors, sessions))
        print(line(steps[-1]), flush=True)
        if steps[-1].breaks:
            break
    return steps


def grow(place: RunningSite, robots: Hands, visitors: Hands, have: int, wanted: int) -> None:
    """Let robots come, and then their visitors; wait until all drive, or as long
    as patience lasts.
    """
    names = [f"light-{number}" for number in range(have, wanted)]
    robots.ask("add", place.brokers, place.make_robots(names))
    wait_for(lambda: robots.ask("online") == wanted, 60, f"{wanted} robots online")
    visitors.ask("add", place.make_visitors([f"visitor-{name}" for name in names], names), 1e9)
    until = time.monotonic() + 60.0
    while visitors.ask("driving") < wanted and time.monotonic() < until:
        time.sleep(0.2)
    time.sleep(SETTLE_SECONDS)


def measure(place: RunningSite, robots: Hands, visitors: Hands, sessions: int) -> LoadStep:
    processes = {**place.processes, "robots": robots.pid, "visitors": visitors.pid}
    robots.ask("measured"), visitors.ask("measured")
    before = shares.read(processes)
    time.sleep(MEASURE_SECONDS)
    taken = shares.between(before, shares.read(processes))
    of_robots, of_visitors = robots.ask("measured"), visitors.ask("measured")
    delays = of_robots["delays"] + of_visitors["delays"]
    missing = of_robots["counts"].get("commands_missing", 0) + of_visitors["counts"].get(
        "states_missing", 0
    )
    return LoadStep(
        sessions=sessions,
        driving=visitors.ask("driving"),
        to_robot=quantiles(of_robots["delays"]),
        to_page=quantiles(of_visitors["delays"]),
        late=quantiles(of_robots["late"] + of_visitors["late"]),
        messages_per_second=len(delays) / MEASURE_SECONDS,
        missing=missing,
        record_behind=record_behind(place, robots),
        shares=taken,
        memory=shares.memory(processes),
    )


def record_behind(place: RunningSite, robots: Hands) -> float:
    """Return the seconds until the record has every state that robots have numbered by now."""
    wanted, began = robots.ask("record")["states"], time.monotonic()
    while time.monotonic() - began < 2 * RECORD_SECONDS:
        stored = place.stored()
        if all(stored.get(session, 0) >= count for session, count in wanted.items()):
            break
        time.sleep(0.2)
    return time.monotonic() - began


def lost_at_the_end(place: RunningSite, robots: Hands, visitors: Hands) -> tuple[int, int]:
    """Have everybody leave; return how many states robots numbered in all, and how many of them the
    record does not have.
    """
    visitors.ask("leave")
    wait_for(lambda: robots.ask("leased") == 0, 60, "the end of every drive")
    wanted = None
    # a lease that was renewed while its visitor left may be published once more
    while wanted != (wanted := robots.ask("record")["states"]):
        record_behind(place, robots)
    stored = place.stored()
    wrong = {
        session: (stored.get(session, 0), count)
        for session, count in wanted.items()
        if stored.get(session, 0) != count
    }
    for session, (have, count) in wrong.items():
        print(f"session {session}: {have} stored of {count} numbered")
    return sum(wanted.values()), sum(abs(count - have) for have, count in wrong.values())


HEAD = (
    f"{'sessions':>8} {'msg/s':>6} {'to robot p50':>13} {'p99':>6} {'to page p50':>12} {'p99':>6}"
    f" {'generators late p99':>20} {'missing':>8} {'record s':>9}  processor shares in % of a core;"
    " memory in MB"
)


def line(step: LoadStep) -> str:
    """Return a step as a line of the table."""
    parts = [
        f"{name} {100 * share:.0f}"
        + (f" ({step.memory[name]:.0f} MB)" if name in step.memory else "")
        for name, share in step.shares.items()
    ]
    return (
        f"{step.sessions:8} {step.messages_per_second:6.0f} {step.to_robot['p50']:13.1f}"
        f" {step.to_robot['p99']:6.1f} {step.to_page['p50']:12.1f} {step.to_page['p99']:6.1f}"
        f" {step.late['p99']:20.1f} {step.missing:8} {step.record_behind:9.1f}  {', '.join(parts)}"
    )


def run(kind: str) -> dict[str, Any]:
    """Load one place until it breaks; print, and return what there is to keep."""
    print(f"\n{kind}\n{HEAD}", flush=True)
    with (
        tempfile.TemporaryDirectory(prefix="telepresence-load-") as folder,
        running_place(kind, Path(folder)) as place,
        Hands("benchmarks.traffic.robots") as robots,
        Hands("benchmarks.traffic.visitors") as visitors,
    ):
        steps = adapter(place, robots, visitors)
        sent, lost = lost_at_the_end(place, robots, visitors)
    carried = max((step.sessions for step in steps if not step.breaks), default=0)
    last = steps[-1]
    verdict = (
        f"{last.sessions} do not: {last.breaks}; full is {last.full}"
        if last.breaks
        else f"and there was room for more; fullest: {last.full}"
    )
    print(
        f"{carried} sessions are carried, {verdict}. States numbered by robots: {sent}, of which"
        f" the record lacks {lost}.",
        flush=True,
    )
    return {
        "carried": carried,
        "states": sent,
        "lost": lost,
        "steps": [{**asdict(step), "breaks": step.breaks, "full": step.full} for step in steps],
    }


def main() -> int:
    found = {kind: run(kind) for kind in PLACES}
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(
        json.dumps({"bound_ms": BOUND_MS, "demanded": DEMANDED, **found}, indent=1) + "\n"
    )
    return sum(
        place["lost"] > 0 or place["carried"] < min(DEMANDED, max(STEPS))
        for place in found.values()
    )


if __name__ == "__main__":
    sys.exit(main())
