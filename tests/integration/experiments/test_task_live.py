"""A whole task with a real broker, a session manager that is killed in the middle of it, and a
robot that follows a script.
"""

import asyncio
import math
from typing import Any

import aiomqtt
import msgspec
import pytest
from asgiref.sync import sync_to_async
from django.utils import timezone

from experiments.models import Drive, Participant, TaskEvent
from robots.api import codec, messages
from robots.models import Robot, RobotPresence
from sessions import protocol
from sessions.leases import store
from sessions.models import Session
from tests.support.people import person
from tests.support.sessions.recorder_rig import (
    HOST,
    ManagerProcess,
    ScriptedRobot,
    running_mosquitto,
    wait_for,
)
from tests.support.studies import participants as p
from tests.support.studies.studies import small_study
from tests.support.studies.task_drives import BACK, HOME, THERE
from tests.support.studies.task_session import cabin_robot, small_conditions

pytestmark = [pytest.mark.django_db(transaction=True), pytest.mark.broker, pytest.mark.nightly]
STRIDE = 0.25  # metres from state to state


class Touring(ScriptedRobot):
    """A robot that is where the test puts it."""

    place = (*HOME, math.pi)
    docked = True

    async def state(self, **changes: Any) -> messages.State:
        x, y, theta = self.place
        return await super().state(
            **{"pose": messages.Pose(x=x, y=y, theta=theta), "docked": self.docked, **changes}
        )

    async def go(self, *points: tuple[float, float]) -> None:
        """Go from point to point, one stride a state."""
        self.docked, self.drives = False, True
        for x, y in points:
            from_x, from_y, _ = self.place
            count = math.ceil(math.dist((from_x, from_y), (x, y)) / STRIDE)
            for n in range(1, count + 1):
                share, before = n / count, self.seq
                self.place = (
                    from_x + share * (x - from_x),
                    from_y + share * (y - from_y),
                    math.atan2(y - from_y, x - from_x),
                )
                while self.seq == before:
                    await asyncio.sleep(0.01)


@pytest.fixture
def broker():
    with running_mosquitto() as broker:
        yield broker


@pytest.fixture
def participant():
    cabin_robot()
    return p.comer(p.published(small_study(conditions=[small_conditions()[0]])), person("ada"))


@sync_to_async
def take(participant: Participant) -> str:
    granted = store.take(Robot.objects.get(), participant.user, "peer-ada", now=timezone.now())
    assert isinstance(granted, store.TakeGranted)
    return granted.session


async def say_first_frame(port: int, session: str) -> None:
    """As a web process passes on what a page said."""
    event = protocol.PageEvent(stamp=timezone.now().timestamp(), type="first_frame")
    report = protocol.PageReport(
        suffix="page/event", session=session, message=msgspec.Raw(codec.encode(event))
    )
    async with aiomqtt.Client(HOST, port) as client:
        await client.publish(protocol.page_reports(session), codec.encode(report), 1)


async def listen(
    port: int, session: str, frames: list[protocol.Task], ready: asyncio.Event
) -> None:
    """Keep what the page is shown."""
    async with aiomqtt.Client(HOST, port) as client:
        await client.subscribe(f"telepresence/v1/server/session/{session}", 1)
        ready.set()
        async for message in client.messages:
            notice = protocol.decode_notice(message.payload.decode())
            if isinstance(notice, protocol.Task):
                frames.append(notice)


def stored(session: str) -> list[str]:
    return list(
        TaskEvent.objects.filter(drive__session=session)
        .exclude(type="cue")
        .order_by("number")
        .values_list("type", flat=True)
    )


async def test_a_task_goes_on_over_the_death_of_the_session_manager_and_nothing_is_lost(
    broker, participant
):
    frames: list[protocol.Task] = []
    async with Touring("giraff", broker.url) as robot:
        with ManagerProcess(broker.url) as first:
            await first.connected()
            await wait_for(
                lambda: (
                    (found := RobotPresence.objects.get()).boot
                    and found.report["boot"] == found.boot
                ),
                30,
                "what the robot says of itself",
            )
            session = await take(participant)
            ready = asyncio.Event()
            listening = asyncio.create_task(listen(broker.port, session, frames, ready))
            await ready.wait()
            await wait_for(
                lambda: Session.objects.get(pk=session).state == "driving", 30, "the drive"
            )
            assert [lease.methods for lease in robot.leases if lease][-1] == ("keyboard",)
            await say_first_frame(broker.port, session)
            await wait_for(lambda: "task_started" in stored(session), 30, "the start")
            await robot.go(*THERE[:3])
            await wait_for(lambda: "door_passed" in stored(session), 30, "the door")
            first.kill()
        await robot.go(*THERE[3:])
        with ManagerProcess(broker.url) as second:
            await second.connected()
            await robot.go(*BACK)
            robot.docked, robot.drives = True, False
            ended = await wait_for(
                lambda: Session.objects.filter(pk=session, state="ended").first(), 60, "the end"
            )
            assert (ended.outcome, ended.outcome_reason) == ("completed", "task")
            await wait_for(lambda: robot.leases[-1] is None, 30, "the empty lease")
            drive = await wait_for(
                lambda: (
                    Drive.objects.filter(settled_at__isnull=False)
                    .select_related("participant")
                    .first()
                ),
                60,
                "the settled drive",
            )
        listening.cancel()
    types = await sync_to_async(stored)(session)
    assert types == [
        "task_started",
        "left_station",
        "checkpoint",
        "door_passed",
        "checkpoint",
        "photo_prompt",
        "dock_contact",
        "docked",
        "task_ended",
    ]
    assert (drive.outcome, drive.moved, drive.participant.stage, drive.mismatches) == (
        "completed",
        True,
        "filled",
        [],
    )
    assert (frames[-1].outcome, frames[-1].passed) == ("completed", (1, 2))
    assert {frame.session for frame in frames} == {session}
