"""A bridge in memory, in which one robot has said that it is there."""

import msgspec
import pytest

from robots.bridge import bridge as mqtt_bridge
from tests.support import words
from tests.support.sessions.memory_bridge import MemoryBridge


@pytest.fixture
def bridge():
    double = MemoryBridge()
    double.stored["giraff", "connection"] = msgspec.json.encode(words.online())
    double.stored["giraff", "factsheet"] = msgspec.json.encode(words.factsheet())
    mqtt_bridge.use(double)
    yield double
    mqtt_bridge.use(None)
