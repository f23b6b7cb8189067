"""A session manager that loses its slot, recorder or database, with a real broker."""

import asyncio
import random
import threading

import pytest
from asgiref.sync import sync_to_async
from django.db import OperationalError
from django.utils import timezone

from accounts.models import User
from robots.models import Robot
from robots.process.cancellation import cancel
from sessions.leases import store
from sessions.manager.active import RecorderDied
from sessions.manager.scheduler import Scheduler
from sessions.manager.service import SessionManager
from sessions.models import ManagerBeat
from sessions.recording.builder import RecordBuilder
from sessions.shards import rows
from tests.support.patience import patient
from tests.support.sessions.recorder_rig import (
    ScriptedRobot,
    running_manager,
    running_mosquitto,
    wait_for,
)

pytestmark = [pytest.mark.django_db(transaction=True), pytest.mark.broker]


@pytest.fixture
def broker():
    with running_mosquitto() as broker:
        yield broker


@pytest.fixture(autouse=True)
def giraff():
    return Robot.objects.create(name="giraff", title="Giraff")


@sync_to_async
def take() -> str:
    robot, ana = Robot.objects.get(), User.objects.create(username="ana")
    return store.take(robot, ana, "peer", now=timezone.now()).session


@pytest.mark.nightly
async def test_session_manager_whose_slot_was_taken_joins_again(broker, caplog):
    async with running_manager(broker.url) as manager, ScriptedRobot("giraff", broker.url) as robot:
        await wait_for(
            lambda: Robot.objects.get().is_online(timezone.now()), what="the robot's presence"
        )
        session = await take()
        await wait_for(lambda: robot.session == session, what="the lease")
        before = manager.active
        await sync_to_async(lambda: rows.dismiss(rows.members()[0]))()
        await wait_for(lambda: manager.active not in {None, before}, 20, "a new run")
        assert "session_manager_replaced" in caplog.text
        count = len(robot.leases)
        await wait_for(lambda: len(robot.leases) > count + 1, 20, "renewals")
        assert {lease.session for lease in robot.leases if lease} == {session}
        assert None not in robot.leases[1:]
    assert (await ManagerBeat.objects.aget()).holder == ""


async def test_session_manager_ends_with_an_error_when_its_recorder_dies(broker, monkeypatch):
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    manager = SessionManager(broker.url, ("session-manager", "unused"), random.Random(1))
    running = asyncio.create_task(manager.run())
    try:
        await asyncio.wait_for(manager.connected.wait(), patient(15))
        monkeypatch.setattr(RecordBuilder, "take", lambda *_: 1 / 0)
        async with ScriptedRobot("giraff", broker.url):
            with pytest.raises(RecorderDied):
                await asyncio.wait_for(running, patient(30))
    finally:
        await cancel(running)
    assert (await ManagerBeat.objects.aget()).holder == "", "others may take the slot"


async def test_session_manager_waits_for_the_database(broker, monkeypatch, caplog):
    begin, refusals = Scheduler.begin, iter([True])

    def away_at_first(scheduler):
        if next(refusals, False):
            raise OperationalError("the database is unavailable")
        begin(scheduler)

    monkeypatch.setattr(Scheduler, "begin", away_at_first)
    async with running_manager(broker.url), ScriptedRobot("giraff", broker.url):
        assert "session_manager_without_database" in caplog.text
        await wait_for(lambda: Robot.objects.get().presence.connection == "ONLINE", what="presence")
