"""A bridge in memory in which one robot is online, the robot's row, visitors, and their pages."""

import msgspec
import pytest
from django.utils import timezone

from accounts.models import User
from robots.bridge import bridge as mqtt_bridge
from robots.screens import make_screen_key
from tests.support import words
from tests.support.browsers.pages import Display, Page
from tests.support.robots import online_robot
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
    return online_robot(boot="b1")


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
    return User.objects.create_user("ada", display_name="Ada", password="x")


@pytest.fixture
def bob(db):
    return User.objects.create_user("bob", display_name="Bob", password="x")


@pytest.fixture
async def page(bridge, robot, ada):
    """Ada's page of the robot."""
    async with Page("giraff", ada) as page:
        yield page


@pytest.fixture
async def driver(page):
    """Ada's page, which drives: `granted` is the answer to its request."""
    await page.take()
    return page


@pytest.fixture
async def other(bridge, robot, bob):
    """Bob's page of the robot."""
    async with Page("giraff", bob) as page:
        yield page


@pytest.fixture
async def watcher(other):
    """Bob's page, which watches."""
    await other.observe()
    return other


@pytest.fixture
def key(robot):
    return make_screen_key(robot, timezone.now())


@pytest.fixture
async def display(bridge, key):
    """The page of the robot's screen."""
    async with Display(key) as display:
        yield display
