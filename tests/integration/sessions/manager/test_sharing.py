"""Two real session managers share two robots, a database and a broker; drives go on while processes
join, are killed, are stopped, and leave.
"""

import contextlib
import signal
import time

import pytest
from asgiref.sync import sync_to_async
from django.utils import timezone

from accounts.models import User
from robots.models import Robot
from sessions.leases import store
from sessions.models import ManagerBeat, Session, SessionEvent, Shard, StateChunk
from sessions.shards.hashing import preferred_slot, shard_of
from sessions.shards.rows import name_of
from tests.support.sessions.recorder_rig import (
    ManagerProcess,
    ScriptedRobot,
    running_mosquitto,
    wait_for,
)

pytestmark = [pytest.mark.django_db(transaction=True), pytest.mark.broker, pytest.mark.nightly]

# two robots, of which each of two session managers serves one
NAMES = tuple(
    next(
        name
        for name in (f"robot-{number}" for number in range(100))
        if preferred_slot(shard_of(name), (0, 1)) == slot
    )
    for slot in (0, 1)
)


def slot_of(robot: str) -> int | None:
    """Return the slot whose process serves a robot now."""
    owner = Shard.objects.get(number=shard_of(robot)).owner
    held = ManagerBeat.objects.filter(holder=owner or "-").values_list("name", flat=True)
    return next((slot for slot in range(3) if name_of(slot) in held), None)


async def served_by(*slots: int, within: float = 20.0) -> None:
    """Wait until each robot is served by the process in its slot."""
    await wait_for(
        lambda: tuple(slot_of(name) for name in NAMES) == slots, within, f"the owners {slots}"
    )


class Drives:
    """Both robots, which are driven all the time, and the conditions that must hold."""

    def __init__(self, robots: list[ScriptedRobot]) -> None:
        self.robots = robots
        self.sessions: dict[str, str] = {}

    async def begin(self) -> None:
        for robot in self.robots:
            visitor = await User.objects.acreate(username=f"visitor-of-{robot.name}")
            await wait_for(
                lambda name=robot.name: Robot.objects.get(name=name).is_online(timezone.now()),
                what="the robot's presence",
            )
            robot.drives = True
            row = await Robot.objects.aget(name=robot.name)
            taken = await sync_to_async(store.take)(row, visitor, robot.name, now=timezone.now())
            self.sessions[robot.name] = taken.session
            await wait_for(lambda robot=robot: robot.session == self.sessions[robot.name], 20)

    async def go_on(self, what: str) -> None:
        """Wait until each robot's lease was renewed twice; it is the lease of the beginning."""
        before = {robot.name: len(robot.leases) for robot in self.robots}
        for robot in self.robots:
            await wait_for(
                lambda robot=robot: len(robot.leases) >= before[robot.name] + 2,
                20,
                f"renewals after {what}",
            )
            assert robot.session == self.sessions[robot.name], f"{robot.name} after {what}"
            assert {lease.epoch for lease in robot.leases if lease} == {1}
            assert None not in robot.leases[1:]

    async def end(self) -> None:
        """Leave, and check the record: each state once."""
        for robot in self.robots:
            session = self.sessions[robot.name]
            assert await sync_to_async(store.leave)(session, peer=robot.name, now=timezone.now())
            await wait_for(lambda robot=robot: robot.session is None, 20, "the end of the lease")
            await recorded_once(session, robot)


async def recorded_once(session: str, robot: ScriptedRobot) -> None:
    """Wait until exactly the states that a robot sent are recorded, and the record is closed."""
    sent = sorted(robot.sent[session])
    await wait_for(lambda: sorted(seqs_of(session)) == sent, 30, "every state, once")
    row = Session.objects.filter(pk=session, closed_at__isnull=False)
    closed = await wait_for(row.first, 30, "the closed record")
    assert (closed.outcome, closed.summary["missing"]) == ("completed", 0)
    ends = SessionEvent.objects.filter(session=session, source="server", type="ended")
    assert await ends.acount() == 1


def seqs_of(session: str) -> list[int]:
    chunks = StateChunk.objects.filter(session=session)
    return [state["seq"] for chunk in chunks for state in chunk.states]


@contextlib.asynccontextmanager
async def robots_in_use(url: str):
    async with contextlib.AsyncExitStack() as robots:
        yield Drives([await robots.enter_async_context(ScriptedRobot(name, url)) for name in NAMES])


async def test_drives_go_on_while_session_managers_join_are_killed_stopped_and_leave():
    for name in NAMES:
        await Robot.objects.acreate(name=name, title=name)
    with running_mosquitto() as broker, ManagerProcess(broker.url) as first:
        async with robots_in_use(broker.url) as drives:
            await first.connected()
            await drives.begin()
            assert [await sync_to_async(slot_of)(name) for name in NAMES] == [0, 0]
            with ManagerProcess(broker.url) as second:
                await served_by(0, 1)
                await drives.go_on("one has joined")
                await stopped_and_replaced(second, drives)
                await served_by(0, 1)
                await drives.go_on("it was stopped, and has joined again")
                first.kill()
                killed_at = time.monotonic()
                await served_by(1, 1)
                assert time.monotonic() - killed_at < 10.0
                await drives.go_on("the first was killed")
                with ManagerProcess(broker.url) as third:
                    await served_by(0, 1)
                    await drives.go_on("another has come")
                    second.stop()
                    await served_by(0, 0)
                    await drives.go_on("one has left")
                    await drives.end()
                    assert "Traceback" not in third.output + second.output + first.output


async def stopped_and_replaced(process: ManagerProcess, drives: Drives) -> None:
    """Stop a process until another one has taken its robots and renewed their leases twice."""
    process.process.send_signal(signal.SIGSTOP)
    try:
        await served_by(0, 0)
        await drives.go_on("one was stopped")
    finally:
        process.process.send_signal(signal.SIGCONT)
    await wait_for(lambda: "session_manager_replaced" in process.output, 20)
