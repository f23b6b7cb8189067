"""A cancellation that `asyncio.wait_for` forgets, as it may until Python 3.12, does not keep an
adapter from letting go of its robot.
"""

import asyncio

import pytest

from robots.agent.adapters import registry
from tests.support.virtual_time import on_virtual_time


@pytest.fixture
def adapter():
    return registry.create("openmora_mqtt", "giraff", {"broker": "mqtt://127.0.0.1:1"})


class Forgetful:
    """A client whose `publish` returns when it is cancelled, as if it had just been done."""

    def __init__(self):
        self.publishing = asyncio.Event()

    async def publish(self, *_arguments, **_options):
        self.publishing.set()
        try:
            await asyncio.Future()
        except asyncio.CancelledError:
            return


@on_virtual_time
async def test_a_task_that_forgot_its_end_is_ended_again(adapter):
    forgetful = Forgetful()

    async def work():
        await forgetful.publish()
        await asyncio.Future()

    adapter._run(work())
    await forgetful.publishing.wait()
    async with asyncio.timeout(5.0):
        await adapter._disconnect("closed")
    assert not adapter._tasks


@on_virtual_time
async def test_sender_to_the_broker_ends_after_a_forgotten_cancellation(adapter):
    forgetful = Forgetful()
    adapter._failure = ""
    sending = asyncio.ensure_future(adapter._send(forgetful))
    adapter._command("StopGiraff")
    adapter._command("StopGiraff")
    await forgetful.publishing.wait()
    adapter._failure = "closed"
    sending.cancel()
    async with asyncio.timeout(5.0):
        await sending
