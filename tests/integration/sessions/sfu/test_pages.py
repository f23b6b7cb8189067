"""Which pages watch through the SFU, as the server decides; Janus does not run."""

import pytest

from robots.api import messages as m
from sessions import protocol
from sessions.sfu import broadcast
from tests.support.patience import until

pytestmark = pytest.mark.django_db(transaction=True)


@pytest.fixture(autouse=True)
def sfu(settings):
    settings.JANUS_URL, settings.DIRECT_WATCHERS = "ws://127.0.0.1:1", 1


def signals(bridge, peer):
    return [message for _, suffix, message in bridge.sent if suffix == f"signal/{peer}"]


async def test_page_watches_through_the_sfu_when_all_places_are_taken(bridge, page, other):
    peer = (await other.expect("hello")).peer
    assert not (await page.observe()).sfu
    assert (await other.observe()).sfu
    await other.say("signal", protocol.WantOffer())
    reply = await other.expect("signal/reply")
    assert (type(reply), reply.reason) == (m.Bye, "sfu_lost")
    await other.say("session/leave", protocol.Leave())
    await page.say("session/leave", protocol.Leave())
    assert not (await other.observe()).sfu
    assert signals(bridge, peer) == [], "the robot gets no signals of such a page"
    await other.close()
    await until(lambda: not broadcast._broadcasts)


async def test_page_that_the_robot_refuses_as_full_changes_to_the_sfu(bridge, page):
    peer = (await page.expect("hello")).peer
    assert not (await page.observe()).sfu
    bridge.say("giraff", f"signal/{peer}/reply", m.Bye(reason="full"))
    assert (await page.expect("session/observing")).sfu
    await page.close()
    await until(lambda: not broadcast._broadcasts)
