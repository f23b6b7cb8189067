"""A private drive through the whole ASGI application: only permitted pages see it."""

import threading

import pytest
from asgiref.sync import sync_to_async
from django.contrib.auth import get_user_model

from robots.api import messages as m
from robots.models import RobotPermit
from sessions import protocol
from sessions.consumers import page_session, queries
from sessions.leases.terms import Terms
from tests.support import words
from tests.support.browsers.pages import Page
from tests.support.patience import patient, until
from tests.support.studies.fixed_terms import provided

pytestmark = pytest.mark.django_db(transaction=True)
JPEG = b"\xff\xd8\xff\xe0 a picture \xff\xd9"
OFFER = m.SdpOffer(sdp="v=0", role="observer")
OF_THE_ROBOT = {"state", "pose", "path", "scan", "heartbeat", "event", "action", "picture"}


@pytest.fixture(autouse=True)
def terms():
    with provided() as double:
        double.terms = Terms(private=True)
        double.watchers = frozenset({"rosa"})
        yield double


def person(name, robot=None):
    user = get_user_model().objects.create_user(name, display_name=name.title(), password="x")
    if robot is not None:
        kind = RobotPermit.Privilege.OPERATOR
        RobotPermit.objects.create(robot=robot, user=user, kind=kind)
    return user


def say_all(bridge):
    bridge.say("giraff", "state", words.state(seq=5))
    bridge.say("giraff", "pose", words.pose())
    bridge.say("giraff", "event", m.Event(stamp=1.0, boot="b1", seq=6, type="docked"))
    bridge.say("giraff", "action", m.ActionStatus(action_id="a", status="FINISHED", stamp=1.0))
    bridge.say("giraff", "heartbeat", m.Heartbeat(n=1, stamp=1.0))
    bridge.say_picture("giraff", 5.0, JPEG)


async def test_observers_receive_nothing_of_a_private_drive(bridge, driver, other):
    assert bridge.leases[-1][1].private
    room = await other.expect("room", lambda room: room.private)
    assert (room.driver, "Ada" in str(other.seen)) == ("", False)
    await other.say("session/observe", protocol.Observe())
    assert (await other.expect("session/refused")).reason == "private"
    await other.say("signal", OFFER)
    assert (await other.expect("denied")).suffix == "signal"
    await other.say("command/picture", m.PictureRequest(stamp=1.0))
    await other.expect("denied", lambda denied: denied.suffix == "command/picture")
    say_all(bridge)
    await driver.expect("event")
    await other.settle(bridge)
    assert not OF_THE_ROBOT & {suffix for suffix, _ in other.seen}
    assert not [suffix for _, suffix, _ in bridge.sent if suffix.startswith("signal/")]


async def test_watching_ends_when_a_private_drive_begins(bridge, other, page):
    await other.observe()
    await other.say("command/picture", m.PictureRequest(stamp=1.0))
    await until(lambda: bridge.commands("command/picture"))
    own = (await page.take()).peer
    assert (await other.expect("session/refused")).reason == "private"
    ((suffix, bye),) = [one[1:] for one in bridge.sent if one[1].startswith("signal/")]
    assert bye == m.Bye(reason="left")
    assert own not in suffix
    say_all(bridge)
    await other.settle(bridge)
    assert not OF_THE_ROBOT & {suffix for suffix, _ in other.seen}


async def test_waiting_visitor_watches_again_after_a_private_drive(bridge, driver, other):
    await other.queue()
    await other.say("session/observe", protocol.Observe())
    assert (await other.expect("session/refused")).reason == "private"
    await driver.say("session/leave", protocol.Leave())
    await other.expect("room", lambda room: not room.private)
    await other.expect("session/observing")
    bridge.say("giraff", "state", words.state(seq=7))
    assert (await other.expect("state")).seq == 7


@pytest.mark.parametrize("who", ["operator", "rosa"])
async def test_operators_and_watchers_named_by_the_terms_see_a_private_drive(
    bridge, robot, ada, who
):
    user = await sync_to_async(person)(who, robot if who == "operator" else None)
    async with Page("giraff", user) as before, Page("giraff", ada) as driver:
        await before.observe()
        await driver.take()
        async with Page("giraff", user) as later:
            await later.observe()
            for page in (before, later):
                await page.expect("room", lambda room: room.driver == "Ada" and not room.private)
                await page.settle(bridge)
            say_all(bridge)
            for page in (before, later):
                assert (await page.expect("event")).type == "docked"
                assert page.told("session/refused") == []


async def test_page_that_opens_before_the_lease_arrives_reads_the_database(bridge, driver, bob):
    bridge.delivery.known["giraff"].lease = None
    async with Page("giraff", bob) as other:
        assert (await other.expect("room")).private
        await other.say("session/observe", protocol.Observe())
        assert (await other.expect("session/refused")).reason == "private"


async def test_watching_is_refused_while_the_database_does_not_answer(
    bridge, robot, ada, monkeypatch
):
    rosa, called = await sync_to_async(person)("rosa"), threading.Event()
    right, may_answer = queries.may_watch_private, threading.Event()

    def never(*arguments):
        called.set()
        may_answer.wait(patient(20))
        return right(*arguments)

    async with Page("giraff", rosa) as watcher, Page("giraff", ada) as driver:
        await watcher.observe()
        monkeypatch.setattr(page_session, "VERDICT_SECONDS", 0.05)
        monkeypatch.setattr(queries, "may_watch_private", never)
        await driver.take()
        assert (await watcher.expect("session/refused")).reason == "private"
        assert called.is_set()
        may_answer.set()


async def test_drive_that_is_not_private_is_visible(bridge, page, watcher, terms):
    terms.terms = Terms()
    await page.take()
    await watcher.expect("room", lambda room: room.driver == "Ada" and not room.private)
    say_all(bridge)
    await watcher.expect("event")
