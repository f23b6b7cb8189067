"""A client that reads in large pieces."""

import asyncio

import aiomqtt
import pytest

from robots.bridge.quick_reading import read_quickly
from tests.support.patience import patient
from tests.support.recorder_rig import HOST, running_mosquitto

pytestmark = pytest.mark.broker


async def test_everything_arrives_in_order_whatever_its_size():
    """Fails when paho or aiomqtt are not any more what robots/bridge/quick_reading.py takes them for."""
    sizes = [1, 20, 70_000, 3, 200_000, *([500] * 2000), 65_535, 65_536, 2]
    with running_mosquitto() as broker:
        async with aiomqtt.Client(HOST, broker.port) as reader, aiomqtt.Client(HOST, broker.port, max_inflight_messages=100) as writer:
            assert read_quickly(reader)
            await reader.subscribe("t", 1)
            writer.pending_calls_threshold = 10_000
            publishing = asyncio.gather(*(writer.publish("t", bytes([number % 251]) * size, 1) for number, size in enumerate(sizes)))
            got = []
            async with asyncio.timeout(patient(30)):
                async for message in reader.messages:
                    got.append((len(message.payload), message.payload[0]))
                    if len(got) == len(sizes):
                        break
            await publishing
            await reader.publish("elsewhere", b"x" * 100_000, 1)
    assert got == [(size, number % 251) for number, size in enumerate(sizes)]
