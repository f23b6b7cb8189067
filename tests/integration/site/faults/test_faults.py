"""A part of a server fails during a drive: the driver learns which and what follows, and drives on
when it works again.

Each part is killed, and suspended with its connections open. tests/timing measures how soon pages
show it.
"""

import asyncio
import contextlib
import signal
import sqlite3
import time

import psutil
import pytest

from tests.support.browsers.document_client import DocumentClient
from tests.support.patience import patient
from tests.support.programs.postgres import running_postgres
from tests.support.sessions.site import DATABASE, Site, running_site, wait_for

pytestmark = [pytest.mark.long, pytest.mark.nightly]

KILLED, STOPPED = signal.SIGKILL, signal.SIGSTOP
WORDS = {"broker": "broker", "session-manager": "session_manager", "giraff": "robot"}
RECOVERS = 40.0


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    with running_site(tmp_path_factory.mktemp("site")) as site:
        site.start_robot("giraff", "--start", "corridor-centre")
        yield site


@contextlib.asynccontextmanager
async def driving(site, name="anna"):
    """A client that drives, and leaves at the end."""
    cookie = await asyncio.to_thread(site.sign_in, name)
    # the previous test may have cost the robot its connection
    await asyncio.to_thread(wait_for, lambda: site.robot_is_online("giraff"), 30, "the robot")
    async with DocumentClient(site.url, cookie) as client:
        await client.turns(patient(30))
        yield client
    await asyncio.to_thread(all_ended, site)


def all_ended(site):
    ended = lambda: all(state == "ended" for _, _, state, _ in site.sessions())
    wait_for(ended, 60, "the end of the session")


def fail(site, part, number):
    if number == KILLED:
        site.send(part, number)
        site.processes.pop(part).wait()
    else:
        for process in processes(site, part):
            process.suspend()


def mend(site, part, number):
    if number == KILLED:
        site.start(part)
    else:
        for process in processes(site, part):
            process.resume()


def processes(site, part):
    """A part and what it runs: the broker is a child of `run_broker`."""
    parent = psutil.Process(site.processes[part].pid)
    return [parent, *parent.children(recursive=True)]


@pytest.mark.parametrize("number", [KILLED, STOPPED], ids=["killed", "stopped"])
@pytest.mark.parametrize("part", ["session-manager", "broker"])
async def test_driver_sees_which_part_fails_and_how_long_the_robot_goes_on(site, part, number):
    async with driving(site) as client:
        fail(site, part, number)
        try:
            fault = await client.names(WORDS[part], patient(2))
            assert fault["then"] == "stops"
            assert 0.0 < fault["seconds"] <= 10.0
            stopped = lambda: [one["then"] for one in client.faults] == ["stopped"]
            await client.until(stopped, patient(15), "the fault of a stopped robot")
        finally:
            mend(site, part, number)
        await recovers(client)


async def recovers(client):
    at = time.time()
    await client.until(lambda: not client.faults, patient(RECOVERS), "the end of the fault")
    await client.turns(patient(RECOVERS), at)


@pytest.mark.parametrize("number", [KILLED, STOPPED], ids=["killed", "stopped"])
async def test_driver_sees_that_the_robots_computer_is_silent(site, number):
    async with driving(site) as client:
        fail(site, "giraff", number)
        try:
            if number == STOPPED:
                assert (await client.names("robot", patient(2)))["then"] == "stopped"
            else:  # the broker publishes the robot's last will
                await client.until(lambda: not client.online, patient(4), "an offline robot")
        finally:
            mend(site, "giraff", number)
        await recovers(client)


@pytest.mark.parametrize("number", [KILLED, STOPPED], ids=["killed", "stopped"])
async def test_session_goes_on_after_a_web_process_failed(site, number):
    async with driving(site) as client:
        session = client.session
        fail(site, "web", number)
        try:
            silent = lambda: time.time() - client.last_received_at > 1.5
            await client.until(lambda: client.socket is None or silent(), patient(4), "silence")
        finally:
            mend(site, "web", number)
        await client.turns(patient(RECOVERS), time.time())
        assert client.session == session


async def test_locked_database_is_named_and_the_drive_goes_on_after_it(site):
    async with driving(site) as client:
        with contextlib.closing(
            sqlite3.connect(site.var / DATABASE, timeout=patient(20), isolation_level=None)
        ) as other:
            other.execute("BEGIN IMMEDIATE")
            fault = await client.names("database", patient(2))
            assert fault["then"] == "stops"
            other.execute("ROLLBACK")
        await client.until(lambda: not client.faults, patient(RECOVERS), "the end of the fault")
        await client.turns(patient(RECOVERS), time.time())


MAKE = """
from robots.models import Robot
Robot.objects.create(name="giraff", title="Giraff")
"""


@pytest.mark.parametrize(
    ("fails", "comes_back"), [("stop", "start"), ("hold", "go_on")], ids=["killed", "stopped"]
)
async def test_queued_visitor_sees_that_the_database_is_unavailable(tmp_path, fails, comes_back):
    with running_postgres() as postgres:
        site = Site(tmp_path / "var", settings={"DATABASE_URL": postgres.url})
        try:
            await asyncio.to_thread(begin, site)
            cookie = await asyncio.to_thread(site.sign_in, "anna")
            async with DocumentClient(site.url, cookie) as client:
                well = lambda: client.received["server/status"] > 2 and not client.faults
                await client.until(well, patient(20), "a server without faults")
                await asyncio.to_thread(getattr(postgres, fails))
                try:
                    assert (await client.names("database", patient(2)))["then"] == "waits"
                finally:
                    await asyncio.to_thread(getattr(postgres, comes_back))
                over = lambda: not client.faults
                await client.until(over, patient(RECOVERS), "the end of the fault")
        finally:
            await asyncio.to_thread(site.stop_all)


def begin(site):
    site.var.mkdir()
    site.django(MAKE)
    site.start_servers()
