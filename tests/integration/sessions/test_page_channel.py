"""What Django code tells open pages through the channel layer."""

import asyncio
import contextlib
import subprocess
from types import SimpleNamespace

import pytest
from asgiref.sync import sync_to_async
from channels.layers import get_channel_layer
from django.conf import settings
from django.contrib.auth.models import Group, Permission
from django.db import transaction
from django.test import AsyncClient
from django.urls import reverse
from django.utils import timezone

from accounts.models import User
from experiments.research import interventions
from robots.models import Robot, RobotPermit
from sessions import page_channel, protocol
from sessions.consumers import queries
from sessions.models import Session
from tests.support.browsers.pages import Page, until
from tests.support.patience import patient
from tests.support.robots import create_robot
from tests.support.sessions.site import free_port

pytestmark = pytest.mark.django_db(transaction=True)
AT_ONCE = 5.0  # s; a page asks by itself once a minute


async def drive(page):
    """Take the robot, and wait until the page listens to the layer."""
    granted = await page.take()
    group = page_channel.visitor_group(page.user.pk)
    await until(lambda: get_channel_layer().groups.get(group))
    return granted.session


async def test_a_message_reaches_the_page_of_its_session_and_no_other(bridge, robot, ada, bob):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as other:
        session = await drive(driver)
        message = protocol.OperatorMessage(session=session, text="Mind the cat.")
        assert await sync_to_async(page_channel.send_notice)("giraff", message)
        assert await driver.expect("session/operator_message") == message
        await other.observe()
        assert other.told("session/operator_message") == []


async def test_a_page_hears_at_once_that_staff_have_ended_its_session(bridge, robot, ada, bob):
    async with Page("giraff", ada) as page:
        session = await Session.objects.select_related("robot").aget(pk=await drive(page))
        await sync_to_async(interventions.end_session)(session, "smoke", bob, timezone.now())
        ended = await page.expect("session/ended")
    assert (ended.outcome, ended.reason) == ("stopped_by_operator", "smoke")


async def test_a_visitor_who_is_shut_out_leaves_at_once(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        await drive(page)
        ada.is_active = False
        await ada.asave()
        async with asyncio.timeout(patient(AT_ONCE)):
            assert await page.closed() == protocol.SIGNED_OUT


async def test_logging_out_ends_the_pages_of_this_browser_and_no_others(bridge, robot, ada):
    async with Page("giraff", ada) as here, Page("giraff", ada) as elsewhere:
        await drive(here)
        client = AsyncClient()
        client.cookies[settings.SESSION_COOKIE_NAME] = here.cookie
        await client.post(reverse("account_logout"))
        async with asyncio.timeout(patient(AT_ONCE)):
            assert await here.closed() == protocol.SIGNED_OUT
        await elsewhere.settle(bridge)


async def test_pages_are_told_also_by_a_thread_that_runs_an_event_loop(ada, monkeypatch):
    monkeypatch.setenv("DJANGO_ALLOW_ASYNC_UNSAFE", "1")
    layer = get_channel_layer()
    channel = await layer.new_channel()
    await layer.group_add(page_channel.visitor_group(ada.pk), channel)
    ada.groups.add(Group.objects.create(name="owners"))
    async with asyncio.timeout(patient(AT_ONCE)):
        assert (await layer.receive(channel))["type"] == page_channel.CHECK


async def test_a_session_is_over_when_logging_out_has_its_pages_check(ada, monkeypatch):
    client = AsyncClient()
    await client.aforce_login(ada)
    key = client.session.session_key
    seen = []
    monkeypatch.setattr(
        "sessions.page_channel.check_pages",
        lambda _group: seen.append(queries.signed_in(key, ada)),
    )
    assert await sync_to_async(queries.signed_in)(key, ada) == ada
    await client.post(reverse("account_logout"))
    assert seen == [None]


async def test_a_permit_that_is_taken_away_ends_the_visit_at_once(bridge, robot, ada):
    robot.access = robot.Access.INVITATION
    await robot.asave()
    permit = await RobotPermit.objects.acreate(
        robot=robot, user=ada, kind=RobotPermit.Privilege.INVITED
    )
    async with Page("giraff", ada) as page:
        await drive(page)
        await permit.adelete()
        async with asyncio.timeout(patient(AT_ONCE)):
            assert await page.closed() == protocol.NOT_ALLOWED


LOSSES = {
    "user.groups.remove": lambda user, group, _right: user.groups.remove(group),
    "user.groups.clear": lambda user, _group, _right: user.groups.clear(),
    "group.user_set.remove": lambda user, group, _right: group.user_set.remove(user),
    "group.user_set.clear": lambda _user, group, _right: group.user_set.clear(),
    "group.permissions.remove": lambda _user, group, right: group.permissions.remove(right),
    "group.permissions.clear": lambda _user, group, _right: group.permissions.clear(),
    "permission.group_set.remove": lambda _user, group, right: right.group_set.remove(group),
    "permission.group_set.clear": lambda _user, _group, right: right.group_set.clear(),
    "group.delete": lambda _user, group, _right: group.delete(),
}


@pytest.mark.parametrize("loss", LOSSES)
async def test_a_right_that_a_group_gave_ends_with_it_at_once(bridge, robot, ada, loss):
    robot.access = robot.Access.INVITATION
    await robot.asave()
    ada.is_staff = True
    await ada.asave()
    right = await Permission.objects.aget(codename="change_robot")
    group = await Group.objects.acreate(name="technicians")
    await group.permissions.aadd(right)
    await ada.groups.aadd(group)
    async with Page("giraff", ada) as page:
        await drive(page)
        await sync_to_async(LOSSES[loss])(ada, group, right)
        async with asyncio.timeout(patient(AT_ONCE)):
            assert await page.closed() == protocol.NOT_ALLOWED


async def test_a_right_of_ones_own_that_is_taken_away_ends_the_visit_at_once(bridge, robot, ada):
    robot.access = robot.Access.INVITATION
    await robot.asave()
    ada.is_staff = True
    await ada.asave()
    right = await Permission.objects.aget(codename="change_robot")
    for remove in (ada.user_permissions.aremove, right.user_set.aremove):
        await ada.user_permissions.aadd(right)
        async with Page("giraff", ada) as page:
            await drive(page)
            await remove(right if remove.__self__.instance == ada else ada)
            async with asyncio.timeout(patient(AT_ONCE)):
                assert await page.closed() == protocol.NOT_ALLOWED


async def test_a_robot_that_is_withdrawn_is_nobodys_at_once(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        await drive(page)
        robot.access = robot.Access.INVITATION
        await robot.asave()
        async with asyncio.timeout(patient(AT_ONCE)):
            assert await page.closed() == protocol.NOT_ALLOWED


@pytest.fixture
def layer(monkeypatch):
    """A channel layer that never answers: what was sent to it, and how many messages waited
    together at most.
    """
    waiting, layer = 0, SimpleNamespace(sent=[], most_waiting=0)

    async def group_send(self, group, message):
        nonlocal waiting
        layer.sent.append(group)
        waiting += 1
        layer.most_waiting = max(layer.most_waiting, waiting)
        try:
            await asyncio.Event().wait()
        finally:
            waiting -= 1

    monkeypatch.setattr(page_channel, "PATIENCE_SECONDS", 0.05)
    monkeypatch.setattr(type(get_channel_layer()), "group_send", group_send)
    return layer


def test_a_change_of_a_group_sends_each_member_one_message_all_of_them_together(db, layer):
    old, new = Permission.objects.filter(codename__in=["change_robot", "delete_robot"])
    group = Group.objects.create(name="technicians")
    group.permissions.add(old)
    members = [User.objects.create_user(f"member{number}") for number in range(50)]
    group.user_set.add(*members)
    layer.sent.clear()
    layer.most_waiting = 0
    group.permissions.set([new])
    assert sorted(layer.sent) == sorted(page_channel.visitor_group(each.pk) for each in members)
    assert layer.most_waiting == 50


def test_checks_of_a_transaction_are_sent_once_and_what_was_rolled_back_is_not(db, layer):
    def roll_back(*groups):
        with contextlib.suppress(LookupError), transaction.atomic():
            for group in groups:
                page_channel.check_pages(group)
            raise LookupError

    roll_back("a")
    with transaction.atomic():
        roll_back("b")
        with transaction.atomic():
            page_channel.check_pages("c")
        page_channel.check_pages("d")
        page_channel.check_pages("c")
        page_channel.check_pages("c", session="s1")
        assert layer.sent == []
    assert sorted(layer.sent) == ["c", "c", "d"]


async def test_a_group_that_cannot_be_told_does_not_keep_the_others_back(monkeypatch, caplog):
    told = []

    async def group_send(_self, group, _message):
        if group == "a":
            raise OSError
        await asyncio.sleep(0)
        told.append(group)

    monkeypatch.setattr(type(get_channel_layer()), "group_send", group_send)

    def check():
        with transaction.atomic():
            for group in ("a", "b", "c"):
                page_channel.check_pages(group)

    await sync_to_async(check)()
    assert sorted(told) == ["b", "c"]
    assert "channel_layer_away" in caplog.text


async def test_a_layer_that_comes_late_is_listened_to_then(monkeypatch):
    monkeypatch.setattr(page_channel, "RETRY_SECONDS", 0.01)
    refusals = iter([OSError("away"), OSError("away")])
    new_channel = type(get_channel_layer()).new_channel

    async def late(self, *args):
        for refusal in refusals:
            raise refusal
        return await new_channel(self, *args)

    monkeypatch.setattr(type(get_channel_layer()), "new_channel", late)
    assert await page_channel.is_well()


async def test_through_redis_and_when_redis_is_killed_and_comes_back(tmp_path, caplog, settings):
    port = free_port()

    def start():
        words = ["redis-server", "--port", str(port), "--bind", "127.0.0.1", "--save", ""]
        return subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.DEVNULL)

    async def until(wanted):
        async with asyncio.timeout(patient(20)):
            while await page_channel.is_well() is not wanted:
                await asyncio.sleep(0.05)

    settings.CHANNEL_LAYERS = {
        "default": {
            "BACKEND": "channels_redis.pubsub.RedisPubSubChannelLayer",
            "CONFIG": {"hosts": [f"redis://127.0.0.1:{port}"]},
        }
    }
    server = start()
    try:
        await until(wanted=True)
        server.kill()
        server.wait()
        await until(wanted=False)
        assert "channel_layer_away" in caplog.text
        server = start()
        await until(wanted=True)
    finally:
        server.kill()
        server.wait()
        await get_channel_layer().flush()
