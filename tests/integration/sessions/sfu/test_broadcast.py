"""A robot's stream through the real Janus to pages made with aiortc."""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Iterator

import pytest

from robots.api import codec, topics
from sessions.sfu import broadcast as module
from tests.support import words
from tests.support.media.sfu_rig import ROBOT, SfuRig
from tests.support.patience import patient, until
from tests.support.programs.janus import Janus

pytestmark = pytest.mark.timeout(180)


@pytest.fixture
def janus(tmp_path) -> Iterator[Janus]:
    with Janus(tmp_path / "janus") as running:
        yield running


@pytest.fixture
async def rig(janus, monkeypatch) -> AsyncIterator[SfuRig]:
    monkeypatch.setattr(module, "STEP_SECONDS", 0.2)
    monkeypatch.setattr(module, "LINGER_SECONDS", 0.5)
    async with SfuRig(janus) as made:
        yield made


@pytest.mark.nightly
async def test_robot_sends_one_stream_for_any_number_of_watchers(rig):
    broadcast = rig.broadcast()
    pages = [rig.page(broadcast) for _ in range(30)]
    for number in (1, 8, 30):
        for page in pages[:number]:
            if not page.frames:
                await page.watch()
        assert rig.connections() == 1
        await until(lambda n=number: rig.told_viewers()[-1:] == [n], 10.0, "the count")
        await until(lambda n=number: rig.media.connected == n, 10.0, "the robot's count")
    await until(lambda: all(page.sounds for page in pages), 10.0, "sound on each page")
    assert not any(page.byes for page in pages)


async def test_stream_ends_without_watchers_and_starts_again(rig):
    for round_ in (1, 2):
        page = rig.page(rig.broadcast())
        await page.watch()
        await page.close()
        await until(lambda n=round_: rig.over == n, 10.0, "the end")
        await until(lambda: rig.connections() == 0, 10.0, "the robot's rest")


async def test_page_that_requests_again_gets_another_connection(rig):
    page = rig.page(rig.broadcast())
    await page.watch()
    await page.watch()
    assert len(page.offers) == 2
    await until(lambda: rig.told_viewers()[-1:] == [1], 10.0, "one viewer")


async def test_pages_get_the_reason_when_janus_dies_and_reconnect_to_it(rig, janus):
    page = rig.page(rig.broadcast())
    await page.watch()
    janus.kill()
    await until(lambda: page.byes == ["sfu_lost"], 10.0, "why")
    page.want()
    assert page.byes == ["sfu_lost"] * 2
    await until(lambda: rig.connections() == 0, 10.0, "the robot's rest")
    janus.start()
    await until(lambda: not rig.broadcasts[0].fault, 10.0, "Janus")
    await page.watch()
    assert rig.connections() == 1


async def test_pages_keep_their_connections_when_the_robot_reconnects(rig):
    page = rig.page(rig.broadcast())
    await page.watch()
    (peer,) = rig.media.statistics()
    await asyncio.to_thread(rig.media.close)
    rig.renew_media()
    before = await page.packets()
    async with asyncio.timeout(patient(20.0)):
        while await page.packets() < before + 20:
            await asyncio.sleep(0.1)
    assert not page.byes
    assert len(page.offers) == 1
    assert peer not in rig.media.statistics()


async def test_robot_whose_agent_was_killed_is_connected_again_after_its_restart(rig):
    page = rig.page(rig.broadcast())
    await page.watch()
    killed, released = rig.media, threading.Event()
    killed._calls.post(released.wait)  # sends no more messages
    rig.renew_media()
    for word in (words.broken(), words.online("b2")):
        rig.delivery.arrive(topics.of(ROBOT, "connection"), codec.encode(word), time.monotonic())
    try:
        before = await page.packets()
        async with asyncio.timeout(patient(20.0)):
            while await page.packets() < before + 50:
                await asyncio.sleep(0.1)
        assert not page.byes
    finally:
        released.set()
        await asyncio.to_thread(killed.close)


async def test_two_web_processes_share_one_stream_and_the_second_takes_over(rig, monkeypatch):
    monkeypatch.setattr(module, "HEARTBEAT_TIMEOUT_S", 2.0)
    first = rig.broadcast()
    one = rig.page(first)
    await one.watch()
    other = rig.page(rig.broadcast())
    await other.watch()
    assert rig.connections() == 1
    await until(lambda: rig.told_viewers()[-1:] == [2], 10.0, "both")
    await first.close()  # like a killed process, without a message
    await until(lambda: other.byes, 20.0, "the end of its stream")
    await other.watch()
    assert rig.over == 1


async def test_internal_error_is_reported_to_pages_which_may_request_again(rig, monkeypatch):
    page = rig.page(rig.broadcast())
    await page.watch()
    monkeypatch.setattr(rig, "send", None)
    page.broadcast._next_leg_at, page.broadcast._leg.ended = 0.0, "tried"
    await until(lambda: page.byes == ["sfu_lost"], 10.0, "why")
    assert rig.over == 1
    monkeypatch.undo()
