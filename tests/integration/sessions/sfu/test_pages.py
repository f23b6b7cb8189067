"""Which pages watch through the SFU, as the server decides; Janus does not run."""

import pytest
from django.contrib.auth import get_user_model

from robots.api import messages as m
from sessions import protocol
from sessions.sfu import broadcast
from tests.support.browsers.pages import Page
from tests.support.patience import until

pytestmark = pytest.mark.django_db(transaction=True)


@pytest.fixture
def people(db):
    create = get_user_model().objects.create_user
    return create("ada", password="x"), create("bob", password="x")


@pytest.fixture(autouse=True)
def sfu(settings):
    settings.JANUS_URL, settings.DIRECT_WATCHERS = "ws://127.0.0.1:1", 1


def signals(bridge, peer):
    return [message for _, suffix, message in bridge.sent if suffix == f"signal/{peer}"]


async def test_page_watches_through_the_sfu_when_all_places_are_taken(bridge, robot, people):
    async with Page("giraff", people[0]) as one, Page("giraff", people[1]) as two:
        peer = (await two.expect("hello")).peer
        assert not (await one.observe()).sfu
        assert (await two.observe()).sfu
        await two.say("signal", protocol.WantOffer())
        reply = await two.expect("signal/reply")
        assert (type(reply), reply.reason) == (m.Bye, "sfu_lost")
        await two.say("session/leave", protocol.Leave())
        await one.say("session/leave", protocol.Leave())
        assert not (await two.observe()).sfu
        assert signals(bridge, peer) == [], "the robot gets no signals of such a page"
    await until(lambda: not broadcast._broadcasts)


async def test_page_that_the_robot_refuses_as_full_changes_to_the_sfu(bridge, robot, people):
    async with Page("giraff", people[0]) as page:
        peer = (await page.expect("hello")).peer
        assert not (await page.observe()).sfu
        bridge.say("giraff", f"signal/{peer}/reply", m.Bye(reason="full"))
        assert (await page.expect("session/observing")).sfu
    await until(lambda: not broadcast._broadcasts)
