"""States end to end: published on MQTT by robots with their own users, until their rows are
committed beside two million others.

Everything is real and in processes of its own: the broker (Mosquitto, then NATS), the
session manager, and one process that plays all robots over plain sockets, because a client library
would be the bottleneck. The database is SQLite, the default. Each state carries five applied
commands, as one of a visitor who drives at 20 Hz. The count at the end must be exact.
"""

import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.traffic.mqtt_line import hello
from benchmarks.traffic.packets import PublishPacket, publish
from robots.api import topics

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).parent / "results" / "states.json"
ROBOTS = 20
STORED = int(os.environ.get("STATES_STORED", "2000000"))
STATES_A_SESSION = 1200
PUBLISHED = {
    "mosquitto": int(os.environ.get("STATES_PUBLISHED", "40000")),
    "nats": int(os.environ.get("STATES_PUBLISHED", "40000")) // 2,
}
BOUNDS = {"mosquitto": 4000.0, "nats": 2000.0}
WINDOW = 50  # messages a robot has on their way before it waits for the broker
LIMIT_SECONDS = 180.0


def main() -> int:
    with tempfile.TemporaryDirectory(prefix="telepresence-states-") as folder:
        os.environ |= {
            "VAR_DIR": folder,
            "HTTP_ONLY": "1",
            "LOG_LEVEL": "WARNING",
            "DJANGO_SETTINGS_MODULE": "telepresence_site.settings",
        }
        os.environ.pop("DATABASE_URL", None)
        import django

        django.setup()
        from django.core.management import call_command

        call_command("migrate", verbosity=0)
        began = time.perf_counter()
        filled = fill()
        os.sync()  # so that writing these is not measured
        print(
            f"{filled} states stored beforehand in {time.perf_counter() - began:.0f} s", flush=True
        )
        lines = {kind: measure(kind) for kind in BOUNDS}
    return report(filled, lines)


# --- rows stored beforehand -----------------------------------------------------------------------


def fill() -> int:
    """Store two million states of sessions that are over; return how many there are."""
    from django.db.models import Sum
    from django.utils import timezone

    from accounts.models import User
    from robots.models import Robot
    from sessions.models import Session, StateChunk

    robot = Robot.objects.create(name="past", title="past", enabled=False)
    visitors = User.objects.bulk_create(
        [User(username=f"past{n}") for n in range(STORED // STATES_A_SESSION + 1)]
    )
    now = timezone.now()
    chunks: list[StateChunk] = []
    for visitor in visitors:
        session = Session.objects.create(
            robot=robot,
            visitor=visitor,
            state="ended",
            live_key=visitor.username,
            queued_at=now,
            ended_at=now,
            closed_at=now,
        )
        chunks += [past_chunk(session, first) for first in range(0, STATES_A_SESSION, 4)]
        if len(chunks) > 6000:
            StateChunk.objects.bulk_create(chunks, batch_size=500)
            chunks = []
    StateChunk.objects.bulk_create(chunks, batch_size=500)
    return int(StateChunk.objects.aggregate(total=Sum("count"))["total"])


def past_chunk(session: Any, first: int) -> Any:
    """Return a row of four states, without applied commands."""
    from sessions.models import StateChunk
    from sessions.recording.store import new_key

    states = [
        json.loads(state(seq, "past", None, 0, commands=0)) for seq in range(first, first + 4)
    ]
    stamps = {"first_stamp": first / 4, "last_stamp": first / 4 + 0.75, "received_at": 0.0}
    key = new_key(time.time())  # as the recorder makes them
    return StateChunk(
        pk=key,
        session=session,
        boot="past",
        first_seq=first,
        last_seq=first + 3,
        count=4,
        states=states,
        **stamps,
    )


def state(seq: int, boot: str, session: str | None, epoch: int, *, commands: int = 5) -> bytes:
    from robots.api import codec, messages as m

    stamp = 1.7e9 + seq * 0.25
    applied = tuple(
        m.AppliedCommand(
            seq=seq * 5 + n,
            stamp=stamp + n * 0.05,
            method="keyboard",
            way="datachannel",
            age=0.012345,
            linear=0.34567,
            angular=-0.123456,
        )
        for n in range(commands)
    )
    return codec.encode(
        m.State(
            stamp=stamp,
            boot=boot,
            seq=seq,
            session=session,
            epoch=epoch,
            pose=m.Pose(x=3.14159, y=2.71828, theta=1.41421, covariance=(1e-3,) * 6),
            velocity=m.Velocity(linear=0.34567, angular=-0.123456),
            battery=m.Battery(charge=0.87, voltage=26.3),
            tilt=0.1,
            clearance=0.456,
            distance=seq * 0.01,
            visitor_silence=0.1,
            viewers=1,
            applied=applied,
        )
    )


# --- one broker -----------------------------------------------------------------------------------


def measure(kind: str) -> dict[str, float]:
    """Return what one broker, the session manager and the database do with all states at once."""
    from sessions.models import StateChunk

    robots = make_robots(kind)
    broker, port = start_broker(kind)
    manager = start(
        "run_session_manager", {"MQTT_URL": f"mqtt://127.0.0.1:{port}", "LOG_LEVEL": "INFO"}
    )
    try:
        wait_for_line(manager, "session_manager_connected")
        each = PUBLISHED[kind] // ROBOTS
        packets = [
            (
                name,
                token,
                [
                    packet(name, seq, state(seq, f"{kind}-boot", session, 1))
                    for seq in range(1, each + 1)
                ],
            )
            for name, token, session in robots
        ]
        used, began = cpu_seconds(manager.pid), time.perf_counter()
        acknowledged = asyncio.run(play(packets, port)) - began
        wanted, keys = each * ROBOTS, [session for _, _, session in robots]
        committed = wait_for_rows(keys, wanted, began)
        cpu = cpu_seconds(manager.pid) - used
        exact = sum(count == each for count in counts(keys).values()) == ROBOTS
        rows = StateChunk.objects.filter(session__in=keys).count()
    finally:
        for process in (manager, broker):
            process.terminate()
            process.wait(30)
    return {
        "states": wanted,
        "seconds": committed,
        "per_second": wanted / committed,
        "publish_per_second": wanted / acknowledged,
        "manager_cpu_seconds": cpu,
        "rows": rows,
        "exact": exact,
        "bound": BOUNDS[kind],
    }


def make_robots(kind: str) -> list[tuple[str, str, str]]:
    """Make robots with a visitor who drives each; return (name, token, session)."""
    from django.utils import timezone

    from accounts.models import User
    from robots.enrol.credentials import make_credentials
    from sessions.leases import store
    from tests.support.robots import create_robot

    made = []
    for number in range(ROBOTS):
        robot = create_robot(
            name=f"{kind}{number}", title="driven", connection="ONLINE", last_seen_at=timezone.now()
        )
        taken = store.take(
            robot, User.objects.create(username=robot.name), "page", now=timezone.now()
        )
        assert isinstance(taken, store.TakeGranted)
        made.append((robot.name, make_credentials(robot, timezone.now()).token, taken.session))
    return made


def start(command: str, more: dict[str, str], *arguments: str) -> "subprocess.Popen[str]":
    """Start a management command whose words can be read."""
    environment = {**os.environ, **more, "PYTHONUNBUFFERED": "1"}
    words = [sys.executable, "manage.py", command, *arguments]
    return subprocess.Popen(
        words,
        cwd=ROOT,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )


def start_broker(kind: str) -> tuple["subprocess.Popen[str]", int]:
    broker = start("run_broker", {}, "--port", "0", "--engine", kind)
    said = wait_for_line(broker, "broker listening")
    return broker, int(said.rpartition(" (")[0].rpartition(":")[2])


def wait_for_line(process: "subprocess.Popen[str]", words: str) -> str:
    assert process.stdout is not None
    for line in process.stdout:
        if words in line:
            return line
    raise RuntimeError(f"{words!r} was never said")


def counts(keys: list[str]) -> dict[str, int]:
    from django.db.models import Sum

    from sessions.models import StateChunk

    found = (
        StateChunk.objects.filter(session__in=keys).values("session").annotate(total=Sum("count"))
    )
    return {str(row["session"]): row["total"] for row in found}


def wait_for_rows(keys: list[str], wanted: int, began: float) -> float:
    """Return the seconds from `began` until every state is committed."""
    while sum(counts(keys).values()) < wanted:
        if time.perf_counter() - began > LIMIT_SECONDS:
            raise RuntimeError(
                f"{sum(counts(keys).values())} of {wanted} states after {LIMIT_SECONDS} s"
            )
        time.sleep(0.1)
    return time.perf_counter() - began


def cpu_seconds(pid: int) -> float:
    """Return the processor time that a process has taken (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


# --- robots over plain sockets (MQTT 3.1.1) -------------------------------------------------------


async def play(packets: list[tuple[str, str, list[bytes]]], port: int) -> float:
    """Publish everything as fast as the broker acknowledges it; return when the last
    acknowledgement came (perf_counter).
    """
    await asyncio.gather(*(robot(name, token, messages, port) for name, token, messages in packets))
    return time.perf_counter()


async def robot(name: str, token: str, messages: list[bytes], port: int) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(hello(f"robot-{name}", name, token))
    answer = await reader.readexactly(4)
    if answer[3] != 0:
        raise RuntimeError(f"the broker refuses {name}: {answer[3]}")
    sent = acknowledged = 0
    while acknowledged < len(messages):
        burst = messages[sent : acknowledged + WINDOW]
        writer.write(b"".join(burst))
        sent += len(burst)
        acknowledged += len(await read_acknowledgements(reader)) // 4
    writer.write(b"\xe0\x00")
    await writer.drain()
    writer.close()


async def read_acknowledgements(reader: asyncio.StreamReader) -> bytes:
    found = await reader.read(4 * WINDOW)
    if not found:
        raise RuntimeError("the broker hung up")
    return found + await reader.readexactly(-len(found) % 4)


def packet(name: str, seq: int, payload: bytes) -> bytes:
    """Return the PUBLISH of a robot's state at QoS 1."""
    return publish(PublishPacket(topics.of(name, "state"), payload, 1, packet_id=seq % 65535 + 1))


# --- the table ------------------------------------------------------------------------------------


def report(stored: int, lines: dict[str, dict[str, float]]) -> int:
    print(
        f"{'states/s end to end':22}{'committed':>11}{'published':>11}"
        f"{'bound':>8}{'states':>8}{'CPU µs/state':>14}"
    )
    for kind, line in lines.items():
        cpu = 1e6 * line["manager_cpu_seconds"] / line["states"]
        print(
            f"{kind:22}{line['per_second']:11.0f}{line['publish_per_second']:11.0f}"
            f"{line['bound']:8.0f}{line['states']:8.0f}{cpu:14.0f}"
        )
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(
        json.dumps({"stored_before": stored, "robots": ROBOTS, **lines}, indent=1) + "\n"
    )
    return sum(line["per_second"] < line["bound"] or not line["exact"] for line in lines.values())


if __name__ == "__main__":
    raise SystemExit(main())
