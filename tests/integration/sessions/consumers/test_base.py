"""Frames of a page do not wait for the database."""

import asyncio
import threading

import pytest
from asgiref.sync import sync_to_async
from channels.testing import WebsocketCommunicator

from sessions.consumers.base import DirectConsumer
from sessions.consumers.connection_check import CheckConsumer
from sessions.consumers.drive import RobotConsumer
from sessions.consumers.robot_screen import ScreenConsumer
from tests.support.patience import patient


@pytest.fixture
async def busy_database():
    """Block the thread in which all queries of a process run."""
    begun, over = threading.Event(), threading.Event()

    def wait():
        begun.set()
        over.wait(patient(60))

    waiting = asyncio.create_task(sync_to_async(wait)())
    await asyncio.to_thread(begun.wait, patient(10))
    yield over
    over.set()
    await waiting


# the consumer closes all connections of its thread, also those of the test
@pytest.mark.django_db
async def test_frame_is_received_during_a_slow_query_of_another_page(busy_database):
    page = WebsocketCommunicator(CheckConsumer.as_asgi(), "/")
    assert await page.connect(patient(10)) == (True, None)
    for word in ("one", "two"):
        await page.send_to(text_data=word)
    assert [await page.receive_from(patient(10)) for _ in range(2)] == ["one", "two"]
    busy_database.set()  # when it closes, Channels closes the database connections
    await page.disconnect(timeout=patient(10))


@pytest.mark.parametrize("consumer", [RobotConsumer, ScreenConsumer, CheckConsumer])
def test_consumers_receive_their_frames_directly(consumer):
    assert issubclass(consumer, DirectConsumer)
    assert consumer.dispatch is DirectConsumer.dispatch


async def test_waiting_frames_are_received_in_one_iteration_of_the_loop():
    turns, taken = 0, []

    class Counting(DirectConsumer):
        async def receive(self, text_data=None, bytes_data=None):
            taken.append((text_data, turns))

    frames = asyncio.Queue()
    for frame in ({"type": "websocket.receive", "text": str(number)} for number in range(100)):
        frames.put_nowait(frame)
    serving = asyncio.create_task(Counting()({"type": "websocket"}, frames.get, None))
    while len(taken) < 100:
        turns += 1
        await asyncio.sleep(0)
    serving.cancel()
    assert [text for text, _ in taken] == [str(number) for number in range(100)]
    assert len({turn for _, turn in taken}) == 1
