"""A bridge in memory in which one robot is online, the robot's row, and visitors."""

import msgspec
import pytest
from django.utils import timezone

from accounts.models import User
from robots.bridge import bridge as mqtt_bridge
from tests.support import words
from tests.support.robots import create_robot
from tests.support.sessions.memory_bridge import MemoryBridge


@pytest.fixture
def bridge():
    double = MemoryBridge()
    double.stored["giraff", "connection"] = msgspec.json.encode(words.online())
    double.stored["giraff", "factsheet"] = msgspec.json.encode(words.factsheet())
    mqtt_bridge.use(double)
    yield double
    mqtt_bridge.use(None)


@pytest.fixture
def robot(db):
    return create_robot(
        name="giraff", title="Giraff", connection="ONLINE", boot="b1", last_seen_at=timezone.now()
    )


@pytest.fixture
def giraff(robot):
    return robot


@pytest.fixture
def ana(db):
    return User.objects.create(username="ana", display_name="Ana")


@pytest.fixture
def ben(db):
    return User.objects.create(username="ben")


@pytest.fixture
def ada(db):
    return User.objects.create_user("ada", password="x")


@pytest.fixture
def bob(db):
    return User.objects.create_user("bob", password="x")
