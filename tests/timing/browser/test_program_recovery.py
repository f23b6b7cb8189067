"""How soon a program that follows docs/reference/robot-api.md turns the robot again after a part
was restarted.
"""

import asyncio
import time

import pytest

from tests.support.browsers.document_client import DocumentClient
from tests.support.sessions.site import wait_for

# No browser, but it measures what browsers' tests measure, and so runs beside no other lane.
pytestmark = pytest.mark.nightly
RESTART = 1.0  # s, as RestartSec of the units in deploy/systemd
SOON = 4.0  # s from when the part is there again; our own page needs as long


@pytest.fixture(scope="module")
def giraff(site):
    return site.start_robot("giraff", "--start", "corridor-centre")


THERE = {
    "web": lambda site: site.web_answers(),
    "broker": lambda site: site.listening(site.mqtt_port),
    "giraff": lambda site: "broker_connected" in site.log("giraff").rpartition(MARK)[2],
}
MARK = "--- started again ---"


@pytest.mark.parametrize("part", THERE)
async def test_a_program_turns_the_robot_again_as_soon_as_the_page_would(site, giraff, part):
    async with DocumentClient(site.url, await asyncio.to_thread(site.sign_in, "anna")) as client:
        for _ in range(2):
            await client.turns(60)
            session = client.session
            site.processes[part].kill()
            site.processes.pop(part).wait()
            await asyncio.sleep(RESTART)
            with (site.var / "log" / f"{part}.log").open("a") as log:
                log.write(f"{MARK}\n")
            site.start(part)
            began = time.time()
            await asyncio.to_thread(wait_for, lambda: THERE[part](site), 60, part)
            there = time.time()
            await client.turns(60, began)
            assert client.moved - there <= SOON
            assert client.session == session
    over = lambda: all(state == "ended" for _, _, state, _ in site.sessions())
    await asyncio.to_thread(wait_for, over, 60, "the end of the visit")
