"""Every part of a server is killed in turn, and each time started again a second later, while
robots are being driven.

Some of the robots are real agents, with the real safety kernel and a base elsewhere
(benchmarks/traffic), one of which is killed too; the others are light ones, which know to a number
what they have said. Two visitors want each robot, so that it changes hands every few seconds, also
while things are down. Afterwards robots, bases and database are held against each other: no state
may be lost that a robot had, no two sessions may have had a robot at the same moment, and no base
may have moved while nobody had its robot.

`CRASH_PLACE` (demo, server-W[-managers-M][-nats], machines), `CRASH_PARTS`, `CRASH_ROBOTS` and
`CRASH_AGENTS` choose what is run. On `machines`, the first of three is also cut off from the other
two for half a minute, while robots and visitors reach all of them.
"""

import json
import os
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from benchmarks.traffic import verdicts
from benchmarks.traffic.bases import Bases
from benchmarks.traffic.places import RunningSite, running_place
from benchmarks.traffic.worker import Hands
from sessions.recording.sequence_tracker import ASKING_SECONDS
from tests.support.host_jitter import watched
from tests.support.patience import patient
from tests.support.sessions.site import wait_for

RESULTS = Path(__file__).parent / "results" / "crashes.json"
PLACE = os.environ.get("CRASH_PLACE", "server-2")
ROBOTS, AGENTS = int(os.environ.get("CRASH_ROBOTS", "8")), int(os.environ.get("CRASH_AGENTS", "3"))
VISITORS = 2  # at each robot
STAYS = 12.0  # s that a visitor drives before making room
RESTART = 1.0  # s, as RestartSec of the units in deploy/systemd
PARTITION = 30.0  # s for which a cable between machines is cut
RECOVERY = 60.0
RECORD = ASKING_SECONDS + 60.0  # s, after which nothing of the record is still asked for
CALM = 3.0


@dataclass(frozen=True)
class Crash:
    """One part that was killed, and after how many seconds every robot took commands again."""

    part: str
    seconds: float


def populate(place: RunningSite, robots: Hands, visitors: Hands, bases: Bases) -> list[str]:
    """Let robots and visitors come; return the robots' names when all are driven."""
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
    robots.ask("add", place.brokers, made[AGENTS:])
    each = [name for name in names for _ in range(VISITORS)]
    visitors.ask(
        "add",
        place.make_visitors([f"visitor-{number}" for number in range(len(each))], each),
        STAYS,
    )
    recovered(place, names, 0.0)
    return names


def recovered(place: RunningSite, names: list[str], since: float) -> None:
    """Wait until every robot has taken a command that was given after a moment.

    Raises:
        RuntimeError: some take none; a real agent refuses commands that are older than 250 ms, as
            those of a computer that is too busy are.
    """
    deadline = time.monotonic() + patient(RECOVERY)
    while not (place.is_ready() and set(names) <= set(place.driven(since))):
        if time.monotonic() > deadline:
            raise RuntimeError(
                f"ready: {place.is_ready()}; robots that take no commands:"
                f" {sorted(set(names) - set(place.driven(since)))}"
            )
        time.sleep(0.1)


def crash(place: RunningSite, part: str, names: list[str]) -> Crash:
    """Kill a part, start it again, and wait until everybody drives as before."""
    began, at = time.monotonic(), time.time()
    place.kill(part)
    away = PARTITION if part in place.cables else RESTART
    time.sleep(away)
    place.start(part)
    recovered(place, names, at + away)
    done = Crash(part, time.monotonic() - began)
    print(f"{part:16} killed; every robot drives again after {done.seconds:5.1f} s", flush=True)
    time.sleep(CALM)
    return done


def everybody_leaves(place: RunningSite, robots: Hands, visitors: Hands) -> None:
    """End every visit, and wait for the record."""
    visitors.ask("leave")
    wait_for(
        lambda: all(drive.until for drive in place.sessions()), RECOVERY, "the end of every visit"
    )
    wait_for(lambda: robots.ask("driven") == 0, RECOVERY, "the robots' word that nobody drives")
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
    """Crash everything, judge, print; return how much was wrong."""
    with (
        tempfile.TemporaryDirectory(prefix="telepresence-crashes-") as folder,
        watched() as jitter,
        running_place(PLACE, Path(folder)) as place,  # first, since it may have a network
        Bases() as bases,
        Hands("benchmarks.traffic.robots") as robots,
        Hands("benchmarks.traffic.visitors") as visitors,
    ):
        began = time.time()
        names = populate(place, robots, visitors, bases)
        parts = (
            os.environ.get("CRASH_PARTS", "").split(",")
            if os.environ.get("CRASH_PARTS")
            else parts_of(place)
        )
        crashes = [crash(place, part, names) for part in parts]
        everybody_leaves(place, robots, visitors)
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
    return report(crashes, drives, len(record.states), wrong)


def parts_of(place: RunningSite) -> list[str]:
    """Return what is killed or cut: everything of the server, and one agent."""
    server = [name for name in place.processes if not name.startswith("agent-")]
    return [*server, *place.cables, *(["agent-0"] if AGENTS else [])]


def report(
    crashes: list[Crash],
    drives: list[verdicts.DrivePeriod],
    states: int,
    wrong: dict[str, list[str]],
) -> int:
    """Print and keep what was found; return how much was wrong."""
    outcomes = Counter(drive.outcome for drive in drives)
    told = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
    print(
        f"{len(drives)} drives ({told}) with {states} states, {ROBOTS} robots, {AGENTS} of them"
        " real agents"
    )
    for what, found in wrong.items():
        print(f"{what:24} {len(found) or 'none'}", *found[:10], sep="\n    " if found else " ")
    RESULTS.parent.mkdir(exist_ok=True)
    kept = {
        "place": PLACE,
        "seconds": {crash.part: crash.seconds for crash in crashes},
        "drives": dict(outcomes),
        "states": states,
        "wrong": wrong,
    }
    RESULTS.write_text(json.dumps(kept, indent=1) + "\n")
    return sum(len(found) for found in wrong.values())


if __name__ == "__main__":
    sys.exit(min(main(), 100))
