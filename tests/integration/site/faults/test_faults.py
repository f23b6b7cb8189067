"""A part of a server fails under a drive: who drives is told which, and what follows, and drives on
when it is back.

Each part is killed, and stopped, which keeps its connections open. How quickly pages are told is
measured in tests/timing.
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
    # what the test before this one did to a server may just have cost the robot its connection
    await asyncio.to_thread(wait_for, lambda: site.robot_is_online("giraff"), 30, "the robot")
    async with DocumentClient(site.url, cookie) as client:
        await client.turns(patient(30))
        yield client
    await asyncio.to_thread(
        wait_for,
        lambda: all(state == "ended" for _, _, state, _ in site.sessions()),
        60,
        "the end of the visit",
    )


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
async def test_who_drives_is_told_which_part_fails_and_how_long_the_robot_goes_on(
    site, part, number
):
    async with driving(site) as client:
        fail(site, part, number)
        try:
            fault = await client.names(WORDS[part], patient(2))
            assert fault["then"] == "stops"
            assert 0.0 < fault["seconds"] <= 10.0
            await client.until(
                lambda: [one["then"] for one in client.faults] == ["stopped"],
                patient(15),
                "the word that the robot has stopped",
            )
        finally:
            mend(site, part, number)
        at = time.time()
        await client.until(lambda: not client.faults, patient(RECOVERS), "the end of the fault")
        await client.turns(patient(RECOVERS), at)


@pytest.mark.parametrize("number", [KILLED, STOPPED], ids=["killed", "stopped"])
async def test_who_drives_is_told_that_the_robots_computer_is_silent(site, number):
    async with driving(site) as client:
        fail(site, "giraff", number)
        try:
            if number == STOPPED:
                assert (await client.names("robot", patient(2)))["then"] == "stopped"
            else:  # its broker says so itself, by the robot's last will
                await client.until(
                    lambda: client.online is False, patient(4), "the word that the robot is away"
                )
        finally:
            mend(site, "giraff", number)
        at = time.time()
        await client.until(lambda: not client.faults, patient(RECOVERS), "the end of the fault")
        await client.turns(patient(RECOVERS), at)


@pytest.mark.parametrize("number", [KILLED, STOPPED], ids=["killed", "stopped"])
async def test_a_web_process_that_fails_is_silence_and_who_comes_back_drives_on_in_the_same_visit(
    site, number
):
    async with driving(site) as client:
        session = client.session
        fail(site, "web", number)
        try:
            await client.until(
                lambda: client.socket is None or time.time() - client.last_received_at > 1.5,
                patient(4),
                "silence",
            )
        finally:
            mend(site, "web", number)
        await client.turns(patient(RECOVERS), time.time())
        assert client.session == session


async def test_a_database_that_nobody_can_write_into_is_named_and_the_drive_goes_on_after_it(site):
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
async def test_who_waits_at_a_robot_is_told_of_a_database_that_is_away(tmp_path, fails, comes_back):
    with running_postgres() as postgres:
        site = Site(tmp_path / "var", settings={"DATABASE_URL": postgres.url})
        try:
            await asyncio.to_thread(begin, site)
            async with DocumentClient(
                site.url, await asyncio.to_thread(site.sign_in, "anna")
            ) as client:
                await client.until(
                    lambda: client.heard["server/status"] > 2 and not client.faults,
                    patient(20),
                    "a server that is well",
                )
                await asyncio.to_thread(getattr(postgres, fails))
                try:
                    assert (await client.names("database", patient(2)))["then"] == "waits"
                finally:
                    await asyncio.to_thread(getattr(postgres, comes_back))
                await client.until(
                    lambda: not client.faults, patient(RECOVERS), "the end of the fault"
                )
        finally:
            await asyncio.to_thread(site.stop_all)


def begin(site):
    site.var.mkdir()
    site.django(MAKE)
    site.start_servers()
