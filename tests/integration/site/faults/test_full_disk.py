"""A disk that fills up during a drive: reported in time, the drive goes on, and the record is
completed when there is room again.

On a file system of a few megabytes that is really full, with the errors of SQLite.
"""

import asyncio
import contextlib
import functools
import json
import shutil
import subprocess
import time
import urllib.error
import urllib.request

import pytest

from tests.support.browsers.document_client import DocumentClient
from tests.support.patience import patient
from tests.support.sessions.site import Site, wait_for

pytestmark = pytest.mark.nightly

MB = 1024 * 1024
SIZE, LOW = 24, 8  # MB
LEASE = 10.0  # s


@contextlib.contextmanager
def small_disk(folder):
    """Mount a file system of SIZE megabytes."""
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={SIZE}m,mode=0755", "tmpfs", folder],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode:
        pytest.skip(f"not run: no file system can be mounted here ({mounted.stderr.strip()})")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    with small_disk(tmp_path_factory.mktemp("disk") / "var") as var:
        site = Site(var, settings={"DISK_LOW_MB": str(LOW)})
        try:
            site.prepare()
            site.start_servers()
            site.start_robot("giraff", "--start", "corridor-centre")
            yield site
        finally:
            make_room(site)
            site.stop_all()


def fill(site, left):
    """Fill the disk but for this number of bytes."""
    with (site.var / "ballast").open("ab") as ballast, contextlib.suppress(OSError):
        while (excess := shutil.disk_usage(site.var).free - left) > 0:
            ballast.write(b"\0" * min(excess, MB))
            ballast.flush()


def make_room(site):
    (site.var / "ballast").unlink(missing_ok=True)


def readyz(site):
    try:
        with urllib.request.urlopen(f"{site.url}/readyz", timeout=patient(5)) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


def whole_record(site, session, began, ended):
    """Tell whether the states of that time, four a second, are stored without a gap."""
    during = [state["seq"] for state in site.states(session) if began < state["stamp"] < ended]
    is_gapless = during and during == list(range(during[0], during[-1] + 1))
    return is_gapless and len(during) > 3.0 * (ended - began)


@contextlib.asynccontextmanager
async def driving(site):
    cookie = await asyncio.to_thread(site.sign_in, "anna")
    async with DocumentClient(site.url, cookie) as client:
        await client.turns(patient(30))
        yield client
        make_room(site)
    ended = lambda: all(state == "ended" for _, _, state, _ in site.sessions())
    await asyncio.to_thread(wait_for, ended, 60, "the end of the session")


async def test_nearly_full_disk_is_reported_and_sessions_go_on(site):
    async with driving(site) as client:
        assert readyz(site)[1]["disk"] == "ok"
        fill(site, 5 * MB)
        assert (await client.names("disk_low", patient(4)))["then"] == "goes_on"
        status, parts = readyz(site)
        assert (status, parts["ready"], parts["disk"]) == (200, True, "low")
        make_room(site)
        await client.until(lambda: not client.faults, patient(6), "the end of the fault")


async def test_full_disk_ends_no_drive_and_the_record_is_complete_afterwards(site):
    for _ in range(2):
        async with driving(site) as client:
            fill(site, 0)
            began = time.time()
            assert (await client.names("disk_full", patient(4)))["then"] == "goes_on"
            status, parts = readyz(site)
            assert (status, parts["ready"], parts["disk"]) == (503, False, "full")
            # longer than a lease lives without renewal
            while time.time() - began < 2.0 * LEASE:
                await client.turns(patient(2))
                assert client.ended is None
            ended, session = time.time(), client.session
            make_room(site)
            await client.until(lambda: not client.faults, patient(15), "the end of the fault")
            await client.turns(patient(5))
        is_whole = functools.partial(whole_record, site, session, began, ended)
        await asyncio.to_thread(wait_for, is_whole, 30, "the whole record")


async def test_full_disk_of_the_robots_computer_is_reported(site):
    async with driving(site) as client:
        fill(site, 0)
        full = lambda: any(one.startswith("disk_full: ") for one in client.state["errors"])
        await client.until(full, patient(4), "the robot's error")
        make_room(site)
