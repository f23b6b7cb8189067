"""The session manager's messages on their way to a broker in memory."""

import asyncio
import random

import aiomqtt
import pytest

from robots.bridge.broker_address import MAX_INFLIGHT
from sessions.manager.scheduler import ManagerMessage, Scheduler
from sessions.manager.service import TOGETHER, SessionManager


class Broker:
    """A client that confirms what it is asked to, and loses the connection at one message."""

    def __init__(self, lost: str) -> None:
        self.lost, self.told, self.waiting, self.most = lost, [], 0, 0

    async def publish(self, topic, payload, qos, retain):
        self.told.append(topic)
        self.waiting += 1
        self.most = max(self.most, self.waiting)
        await asyncio.sleep(0)
        self.waiting -= 1
        if topic == self.lost:
            raise aiomqtt.MqttError("gone")


def with_messages(count, broker):
    """A session manager that has so many messages for a broker."""
    manager = SessionManager("mqtt://nowhere", ("session-manager", "unused"), random.Random(1))
    manager._scheduler, manager._client = Scheduler(), broker
    manager._scheduler.outbox.extend(ManagerMessage(f"t/{number}", b"x") for number in range(count))
    return manager


async def test_what_the_broker_did_not_confirm_is_told_again_in_order_and_nothing_else():
    broker = Broker(lost="t/2")
    manager = with_messages(5, broker)
    with pytest.raises(aiomqtt.MqttError, match="gone"):
        await manager._deliver()
    assert broker.told == [f"t/{number}" for number in range(5)]
    assert [outbound.topic for outbound in manager._scheduler.outbox] == ["t/2"]
    broker.lost = ""
    await manager._deliver()
    assert not manager._scheduler.outbox


async def test_no_more_letters_are_on_their_way_than_a_client_keeps():
    broker = Broker(lost="")
    manager = with_messages(3 * TOGETHER, broker)
    await manager._deliver()
    assert broker.told == [f"t/{number}" for number in range(3 * TOGETHER)]
    assert broker.most == TOGETHER <= MAX_INFLIGHT / 2
