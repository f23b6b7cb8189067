"""Kills every part of a server in turn, and restarts it a second later, while robots are driven.

Some robots are real agents, with the real safety kernel and a base in another process
(benchmarks/traffic); one of them is killed too. The others are light ones, which count exactly what
they have sent. Two visitors take turns at each robot, every few seconds, also during an outage.
Afterwards the records of robots, bases and database are compared: no state of a robot may be lost,
no two sessions may have had a robot at the same time, and no base may have moved without a lease.

The first of the real agents also has viewers, all through Janus, which is killed too. For each
crash the table shows the longest time for which a continued drive took no commands, and for which a
viewer saw no new frame.

`CRASH_PLACE` (demo, server-W[-managers-M][-nats], machines), `CRASH_PARTS`, `CRASH_ROBOTS` and
`CRASH_AGENTS` select the runs. On `machines`, the first of three is also cut off from the other two
for half a minute, while robots and visitors reach all of them.
"""

import contextlib
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.traffic import verdicts
from benchmarks.traffic.bases import Bases
from benchmarks.traffic.places import RunningSite, running_place
from benchmarks.traffic.worker import Hands
from sessions.recording.sequence_tracker import ASKING_SECONDS
from tests.support.host_jitter import watched
from tests.support.patience import patient
from tests.support.programs.janus import SECRET, Janus
from tests.support.programs.networks import LAN_SERVER
from tests.support.sessions.site import LOOPBACK, wait_for

RESULTS = Path(__file__).parent / "results" / "crashes.json"
PLACE = os.environ.get("CRASH_PLACE", "server-2")
ROBOTS, AGENTS = int(os.environ.get("CRASH_ROBOTS", "8")), int(os.environ.get("CRASH_AGENTS", "3"))
VISITORS = 2  # at each robot
STAYS = 12.0  # s that a visitor drives before making room
RESTART = 1.0  # s, as RestartSec of the units in deploy/systemd
PARTITION = 30.0  # s for which a cable between machines is cut
RECOVERY = 60.0
NOTHING = "nothing"
VIEWERS = 3  # of the first agent
RECORD = ASKING_SECONDS + 60.0  # s, after which nothing of the record is still asked for
CALM = 5.0


@dataclass(frozen=True)
class Crash:
    """One part that was killed, when by Unix time, and after how many seconds every robot took
    commands and every viewer saw pictures again; `NOTHING` is a calm span to compare with.
    """

    part: str
    at: float
    seconds: float

    def longest(self, moments: list[list[float]]) -> float:
        """Return the longest pause beside it."""
        return verdicts.longest_pause(moments, self.at, self.at + self.seconds)


@dataclass(frozen=True)
class Crowd:
    """The processes that play robots, visitors and viewers."""

    robots: Hands
    visitors: Hands
    viewers: Hands


def populate(place: RunningSite, crowd: Crowd, bases: Bases) -> list[str]:
    names = [
        *(f"agent-{number}" for number in range(AGENTS)),
        *(f"light-{number}" for number in range(ROBOTS - AGENTS)),
    ]
    made = place.make_robots(names)
    for name, token in made[:AGENTS]:
        words = [
            "--mqtt",
            place.site.mqtt_url,
            "--token",
            token,
            "--var",
            str(place.site.var / name),
            "--base",
            str(bases.port),
        ]
        place.site.start(name, ["-m", "benchmarks.traffic.based_robot", name, *words])
    crowd.robots.ask("add", place.brokers, made[AGENTS:])
    each = [name for name in names for _ in range(VISITORS)]
    crowd.visitors.ask(
        "add",
        place.make_visitors([f"visitor-{number}" for number in range(len(each))], each),
        STAYS,
    )
    watched_robots = names[: min(1, AGENTS)] * VIEWERS
    crowd.viewers.ask(
        "add",
        place.make_visitors([f"viewer-{n}" for n in range(len(watched_robots))], watched_robots),
    )
    recovered(place, crowd, names, 0.0)
    return names


def recovered(place: RunningSite, crowd: Crowd, names: list[str], since: float) -> None:
    """Wait until every robot has taken a command, and every viewer has seen a picture, after a
    moment.

    Raises:
        RuntimeError: some take none; a real agent refuses commands that are older than 250 ms, as
            those of a computer that is too busy are.
    """
    deadline = time.monotonic() + patient(RECOVERY)
    while not (
        place.is_ready()
        and set(names) <= set(place.took_commands(since))
        and crowd.viewers.ask("all_saw", since)
    ):
        if time.monotonic() > deadline:
            without = sorted(set(names) - set(place.took_commands(since)))
            raise RuntimeError(
                f"ready: {place.is_ready()}; viewers see: {crowd.viewers.ask('all_saw', since)};"
                f" robots that take no commands: {without}"
            )
        time.sleep(0.1)


def crash(place: RunningSite, crowd: Crowd, part: str, names: list[str]) -> Crash:
    """Kill a part, start it again, and wait until everybody drives and sees as before."""
    began, at = time.monotonic(), time.time()
    place.kill(part)
    away = PARTITION if part in place.cables else RESTART
    time.sleep(away)
    place.start(part)
    recovered(place, crowd, names, at + away)
    done = Crash(part, at, time.monotonic() - began)
    print(f"{part:18} killed; all is well again after {done.seconds:5.1f} s", flush=True)
    time.sleep(CALM)
    return done


def calm() -> Crash:
    """Wait for a period without a crash, to compare with."""
    at = time.time()
    time.sleep(CALM)
    return Crash(NOTHING, at, CALM)


def everybody_leaves(place: RunningSite, crowd: Crowd) -> None:
    robots = crowd.robots
    crowd.visitors.ask("leave")
    wait_for(
        lambda: all(drive.until for drive in place.sessions()), RECOVERY, "the end of every visit"
    )
    wait_for(lambda: robots.ask("leased") == 0, RECOVERY, "the end of all leases")
    wait_for(
        lambda: not _awaited(place, robots),
        RECORD,
        "a whole record",
        lambda: _awaited(place, robots),
    )


def _awaited(place: RunningSite, robots: Hands) -> dict[str, str]:
    """Return what of the record is still awaited, by session."""
    stored, numbered = place.stored(), robots.ask("record")["states"]
    few = {
        session: f"{stored.get(session, 0)} of {count} states"
        for session, count in numbered.items()
        if stored.get(session, 0) < count
    }
    return {**dict.fromkeys(place.unclosed(), "not closed"), **few}


def main() -> int:
    with (
        tempfile.TemporaryDirectory(prefix="telepresence-crashes-") as folder,
        watched() as jitter,
        # first, since it may have a network
        place_with_sfu(Path(folder)) as place,
        Bases() as bases,
        Hands("benchmarks.traffic.robots") as robots,
        Hands("benchmarks.traffic.visitors") as visitors,
        Hands("benchmarks.traffic.viewers") as viewers,
    ):
        began, crowd = time.time(), Crowd(robots, visitors, viewers)
        names = populate(place, crowd, bases)
        parts = (
            os.environ.get("CRASH_PARTS", "").split(",")
            if os.environ.get("CRASH_PARTS")
            else parts_of(place)
        )
        crashes = [calm(), *(crash(place, crowd, part, names) for part in parts)]
        seen = viewers.ask("seen")
        everybody_leaves(place, crowd)
        applied = place.applied()
        drives, record, known = place.sessions(), place.record(), robots.ask("record")
        grants = [(grant["robot"], grant["epoch"], grant["session"]) for grant in known["grants"]]
        late, moves = (
            jitter.excuse(began, time.time()),
            {name: spans for name, spans in bases.moves().items() if spans},
        )
        wrong = {
            "states lost": verdicts.lost(known["states"], record.states, record.missing),
            "two drivers at once": [
                *verdicts.two_at_once(drives),
                *verdicts.shared_epochs(record.states, grants),
            ],
            "motion without a lease": verdicts.moved_alone(moves, drives, late),
            "agents that never moved": [name for name in names[:AGENTS] if name not in moves],
        }
    figures = [
        {
            "part": each.part,
            "seconds": each.seconds,
            "no_commands": each.longest(applied),
            "no_picture": each.longest(seen),
        }
        for each in crashes
    ]
    return report(figures, drives, len(record.states), wrong)


@contextlib.contextmanager
def place_with_sfu(folder: Path) -> Iterator[RunningSite]:
    """Run the place that was chosen, beside a Janus through which everybody watches."""
    janus = Janus(folder / "janus", LAN_SERVER if PLACE == "machines" else LOOPBACK)
    more = {"JANUS_URL": janus.url, "JANUS_SECRET": SECRET, "DIRECT_WATCHERS": "0"}
    with running_place(PLACE, folder, **more) as place, janus:
        place.outside["sfu"] = janus
        yield place


def parts_of(place: RunningSite) -> list[str]:
    server = [name for name in place.processes if not name.startswith("agent-")]
    return [*server, *place.cables, *(["agent-0"] if AGENTS else [])]


def report(
    crashes: list[dict[str, Any]],
    drives: list[verdicts.DrivePeriod],
    states: int,
    wrong: dict[str, list[str]],
) -> int:
    print(f"{'':18}{'all well after':>16}{'no commands for':>17}{'no picture for':>16}")
    for figures in crashes:
        print(
            f"{figures['part']:18}{figures['seconds']:14.1f} s{figures['no_commands']:15.1f} s"
            f"{figures['no_picture']:14.1f} s"
        )
    outcomes = Counter(drive.outcome for drive in drives)
    counts = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
    print(
        f"{len(drives)} drives ({counts}) with {states} states, {ROBOTS} robots, {AGENTS} of them"
        " real agents"
    )
    for what, found in wrong.items():
        print(f"{what:24} {len(found) or 'none'}", *found[:10], sep="\n    " if found else " ")
    RESULTS.parent.mkdir(exist_ok=True)
    kept = {
        "place": PLACE,
        "crashes": crashes,
        "drives": dict(outcomes),
        "states": states,
        "wrong": wrong,
    }
    RESULTS.write_text(json.dumps(kept, indent=1) + "\n")
    return sum(len(found) for found in wrong.values())


if __name__ == "__main__":
    sys.exit(min(main(), 100))
