"""The database's primary is killed or frozen during a drive that records four states a second; its
standby is promoted, and the drive goes on without losing a state.
"""

import asyncio
import contextlib
import functools
import time

import pytest

from tests.support import words
from tests.support.browsers.document_client import DocumentClient
from tests.support.patience import patient
from tests.support.programs.patroni import running_patroni
from tests.support.programs.postgres import running_pair
from tests.support.sessions.recorder_rig import ScriptedRobot, running_mosquitto
from tests.support.sessions.site import Site, wait_for

pytestmark = [pytest.mark.postgres, pytest.mark.broker, pytest.mark.long, pytest.mark.nightly]

MAKE = """
from robots.models import Robot
Robot.objects.create(name="giraff", title="Giraff", returns_home=False)
"""
STATES = (
    "SELECT states FROM telepresence_sessions_statechunk WHERE session_id = %s ORDER BY first_seq"
)
MISSING = "SELECT data FROM telepresence_sessions_sessionevent WHERE type = 'states_missing'"
PERIOD_S = 0.25
TAKEOVER_S = 15.0


def seqs(server, session):
    """Return the numbers of the states that a server has of a session, with repetitions."""
    return [state["seq"] for (states,) in server.ask(STATES, session) for state in states]


@contextlib.contextmanager
def site_on(folder, broker, servers):
    """A session manager and a web process on a database of several servers."""
    user = servers[0].url.partition("@")[0]
    hosts = ",".join(f"127.0.0.1:{server.port}" for server in servers)
    settings = {"DATABASE_URL": f"{user}@{hosts}/postgres", "MQTT_URL": broker.url}
    site = Site(folder, settings=settings)
    site.var.mkdir()
    try:
        site.django(MAKE)
        site.start("session-manager", ["manage.py", "run_session_manager"])
        site.start_web()
        yield site
    finally:
        site.stop_all()


async def reached(condition, within, what, state=str):
    return await asyncio.to_thread(wait_for, condition, within, what, state)


@contextlib.asynccontextmanager
async def drive(site, broker, servers):
    """Drive a robot until states are recorded; at the end the standby has each state once."""
    primary, standby = servers
    cookie = await asyncio.to_thread(site.sign_in, "anna")
    async with ScriptedRobot("giraff", broker.url, period=PERIOD_S) as robot:
        await robot.publish("factsheet", words.factsheet())
        await reached(lambda: site.web_answers("readyz"), 30, "a server with all its parts")
        async with DocumentClient(site.url, cookie) as client:
            await reached(lambda: robot.session is not None, 30, "a drive")
            session = robot.session
            await reached(lambda: len(seqs(primary, session)) >= 8, 20, "a record")
            yield client, robot
        await reached(lambda: robot.session is None, 30, "the end of the drive")
        sent = sorted(robot.sent[session])
        await reached(lambda: len(seqs(standby, session)) >= len(sent), 30, "every state")
    assert seqs(standby, session) == sent
    assert standby.ask(MISSING) == []


@pytest.mark.parametrize("fails", ["kill", "hold"], ids=["killed", "frozen"])
async def test_drive_goes_on_with_the_standby_and_keeps_every_state(tmp_path, fails):
    with (
        running_mosquitto() as broker,
        running_pair() as (primary, standby),
        site_on(tmp_path / "var", broker, (primary, standby)) as site,
    ):
        try:
            async with drive(site, broker, (primary, standby)) as (client, robot):
                async with lost(primary, standby, fails, robot):
                    await asyncio.to_thread(standby.promote)
                await goes_on(site, client, robot)
        finally:
            if fails == "hold":
                primary.go_on()


@pytest.mark.soak
@pytest.mark.timeout(900)
@pytest.mark.parametrize("fails", ["kill", "hold"], ids=["killed", "frozen"])
async def test_patroni_promotes_the_standby_and_the_old_primary_follows_it(tmp_path, fails):
    with (
        running_mosquitto() as broker,
        running_patroni() as (primary, standby),
        site_on(tmp_path / "var", broker, (primary, standby)) as site,
    ):
        async with drive(site, broker, (standby, primary)) as (client, robot):
            for old, new in ((primary, standby), (standby, primary)):
                async with lost(old, new, fails, robot):
                    pass
                await goes_on(site, client, robot)
                await asyncio.to_thread(old.go_on if fails == "hold" else old.restart)
                follows = functools.partial(old.has_role, "sync_standby")
                await reached(follows, 60, "a standby", old.log)


@contextlib.asynccontextmanager
async def lost(primary, standby, fails, robot):
    """Lose the primary, and wait until the standby records states."""
    session = robot.session
    acknowledged = await asyncio.to_thread(seqs, primary, session)
    await asyncio.to_thread(getattr(primary, fails))
    lost_at, last = time.monotonic(), robot.seq
    yield
    newest = lambda: max(seqs(standby, session), default=0)
    await reached(lambda: newest() > last, TAKEOVER_S, "a state in the new primary")
    assert set(acknowledged) <= set(await asyncio.to_thread(seqs, standby, session))
    print(f"recorded again after {time.monotonic() - lost_at:.1f} s, leases {len(robot.leases)}")


async def goes_on(site, client, robot):
    """Check that the same drive goes on, and that pages and commands know the new primary."""
    session, count = robot.session, len(robot.driven)
    assert client.session == session
    await client.until(lambda: len(robot.driven) > count, patient(15), "a command")
    await client.until(lambda: not client.faults, patient(15), "the end of the fault")
    await reached(lambda: site.web_answers("readyz"), 15, "a web process that is ready")
    cookie = await asyncio.to_thread(site.sign_in, "ben")
    async with DocumentClient(site.url, cookie) as next_one:
        queued = lambda: next_one.received["session/queued"]
        await next_one.until(queued, patient(15), "a place in the queue")
    assert robot.session == session, "the drive goes on"
