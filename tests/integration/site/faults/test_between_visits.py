"""A robot that returns to its dock after a session, with real processes: any visitor can stop it,
and it stops when the server is silent.
"""

import asyncio
import contextlib
import json
import signal
import time

import pytest
from websockets.asyncio.client import connect

from tests.support.browsers.document_client import DocumentClient
from tests.support.patience import patient
from tests.support.sessions.site import running_site, wait_for

pytestmark = [pytest.mark.long, pytest.mark.nightly]
GOES_HOME = "from robots.models import Robot; Robot.objects.update(returns_home=True)"
PAUSE = (
    "from robots.models import Robot; robot = Robot.objects.get(name='giraff');"
    "print(robot.presence.turnaround, robot.presence.turnaround_reason)"
)
MOVES, STANDS = 0.05, 0.02  # m/s
ORDERED_AGAIN = 5.0  # s after which a cancelled order is repeated


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    with running_site(tmp_path_factory.mktemp("site")) as site:
        yield site


@pytest.fixture(scope="module")
def truth(site):
    site.django(GOES_HOME)
    return site.start_robot("giraff", "--start", "corridor-centre")


def speed(truth):
    """Return the greatest speed of the last 0.3 s, in m/s."""
    return max(abs(row.linear) for row in truth.history(0.3))


async def visit(site, name):
    """Drive, and leave the robot where it is."""
    cookie = await asyncio.to_thread(site.sign_in, name)
    await asyncio.to_thread(wait_for, lambda: site.robot_is_online("giraff"), 30, "the robot")
    async with DocumentClient(site.url, cookie) as client:
        await client.turns(patient(30))


async def begins_to_drive_home(truth):
    await asyncio.to_thread(wait_for, lambda: speed(truth) > MOVES, 40, "the drive home")


@contextlib.asynccontextmanager
async def page_of(site, name):
    """A page that neither drives nor watches."""
    cookie = await asyncio.to_thread(site.sign_in, name)
    address = f"{site.url.replace('http', 'ws', 1)}/ws/robots/giraff/"
    headers = {"Cookie": f"sessionid={cookie}"}
    async with connect(address, additional_headers=headers, origin=site.url) as socket:
        await socket.recv()
        yield socket


async def test_return_to_the_dock_ends_without_the_server_and_by_a_stop(site, truth):
    await visit(site, "anna")
    await begins_to_drive_home(truth)
    at = time.monotonic()
    site.send("session-manager", signal.SIGSTOP)
    try:
        await asyncio.to_thread(wait_for, lambda: speed(truth) < STANDS, 4, "standstill")
        print(f"stood {time.monotonic() - at:.1f} s after the session manager was stopped")
    finally:
        site.send("session-manager", signal.SIGCONT)
    await begins_to_drive_home(truth)
    async with page_of(site, "ben") as page:
        stop = {"type": "stop", "actionId": "s1", "stamp": time.time()}
        await page.send(f"command/action\n{json.dumps(stop)}")
        await asyncio.to_thread(
            wait_for, lambda: site.django(PAUSE).split() == ["paused", "stopped"], 10, "the pause"
        )
    await asyncio.to_thread(wait_for, lambda: speed(truth) < STANDS, 5, "standstill")
    await asyncio.sleep(ORDERED_AGAIN + 2.0)
    assert max(abs(row.linear) for row in truth.history(ORDERED_AGAIN + 1.0)) < STANDS
    await visit(site, "ben")
    await begins_to_drive_home(truth)
