"""Waiting messages: velocities never late, the others in order."""

import asyncio

import pytest

from robots.agent.adapters.common import send_slots
from robots.agent.adapters.common.send_slots import SendSlots
from robots.agent.robot_interface import AdapterError


class Clock:
    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(send_slots.time, "monotonic", lambda: self.now)


async def taken(waiting):
    """Everything that can be taken without waiting."""
    found = []
    while True:
        try:
            async with asyncio.timeout(0):
                found.append(await waiting.take())
        except TimeoutError:
            return found


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


@pytest.fixture
def waiting():
    return SendSlots()


async def test_the_newest_velocity_is_sent_before_all_messages(clock, waiting):
    waiting.say("a")
    waiting.drive("slow")
    waiting.drive("fast")
    waiting.say("b")
    assert await taken(waiting) == ["fast", "a", "b"]


async def test_a_late_velocity_is_dropped_and_a_late_message_is_not(clock, waiting):
    waiting.say("a")
    waiting.drive("fast")
    clock.now += 0.3
    assert await taken(waiting) == ["a"]


async def test_velocities_that_are_not_sent_in_time_end_the_connection(clock, waiting):
    for _ in range(5):
        waiting.drive("fast")
        clock.now += 0.12
    with pytest.raises(AdapterError, match="does not accept commands"):
        waiting.drive("fast")


async def test_messages_are_bounded(clock, waiting):
    for number in range(200):
        waiting.say(number)
    with pytest.raises(AdapterError, match="does not accept messages"):
        waiting.say("one more")
    waiting.clear()
    assert len(waiting) == 0


async def test_new_message_wakes_the_waiting_sender(waiting):
    taking = asyncio.ensure_future(waiting.take())
    await asyncio.sleep(0)
    waiting.drive("fast")
    assert await taking == "fast"
