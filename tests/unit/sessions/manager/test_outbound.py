"""The session manager's messages on their way to a broker in memory."""

import asyncio
from collections import deque
from types import SimpleNamespace

import aiomqtt
import pytest

from robots.api import codec, topics
from robots.bridge.failover import MAX_INFLIGHT
from sessions.manager.broker_connection import TOGETHER, BrokerConnection, publish_all
from sessions.manager.scheduler import ManagerMessage
from sessions.shards.ownership import EVERYTHING


class Broker:
    """A client that confirms what it is asked to, and loses the connection at one message."""

    def __init__(self, lost: str) -> None:
        self.lost, self.published, self.waiting, self.most = lost, [], 0, 0

    async def publish(self, topic, payload, qos, retain=False):
        self.published.append(topic)
        self.last = payload
        self.waiting += 1
        self.most = max(self.most, self.waiting)
        await asyncio.sleep(0)
        self.waiting -= 1
        if topic == self.lost:
            raise aiomqtt.MqttError("gone")


def messages(count):
    return deque(ManagerMessage(f"t/{number}", b"x") for number in range(count))


async def test_only_unconfirmed_messages_are_published_again_in_order():
    broker, outbox = Broker(lost="t/2"), messages(5)
    with pytest.raises(aiomqtt.MqttError, match="gone"):
        await publish_all(outbox, broker, lambda: True)
    assert broker.published == [f"t/{number}" for number in range(5)]
    assert [message.topic for message in outbox] == ["t/2"]
    broker.lost = ""
    await publish_all(outbox, broker, lambda: True)
    assert not outbox


async def test_no_more_messages_are_on_their_way_than_a_client_keeps():
    broker, outbox = Broker(lost=""), messages(3 * TOGETHER)
    await publish_all(outbox, broker, lambda: True)
    assert broker.published == [f"t/{number}" for number in range(3 * TOGETHER)]
    assert broker.most == TOGETHER <= MAX_INFLIGHT / 2


async def test_a_process_without_its_slot_publishes_nothing():
    broker, outbox = Broker(lost=""), messages(5)
    await publish_all(outbox, broker, lambda: len(broker.published) < 2)
    assert broker.published == ["t/0", "t/1"]
    assert [message.topic for message in outbox] == ["t/2", "t/3", "t/4"]


async def test_states_that_cannot_be_requested_now_are_requested_later_by_others():
    topic = topics.of("giraff", "command/action")
    broker = Broker(lost=topic)
    work = SimpleNamespace(ownership=EVERYTHING)
    connection = BrokerConnection(broker, work, lambda: 5.0)
    connection.ask_again("giraff", "b1", 3, 9)
    (asking,) = connection._asking
    await asking
    asked = codec.decode("command/action", broker.last)
    assert (broker.published, asked.first, asked.last) == ([topic], 3, 9)
