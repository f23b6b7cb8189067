"""Notices and checks of open pages through the channel layer."""

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
from robots.models import RobotPermit
from sessions import page_channel, protocol
from sessions.consumers import queries
from sessions.models import Session
from tests.support.browsers.pages import Page
from tests.support.patience import patient, until
from tests.support.sessions.site import free_port

pytestmark = pytest.mark.django_db(transaction=True)
AT_ONCE = 5.0  # s; by itself, a page checks once a minute


async def drive(page):
    """Take the robot, wait until the page is in its group, and return the session."""
    granted = await page.take()
    group = page_channel.visitor_group(page.user.pk)
    await until(lambda: get_channel_layer().groups.get(group))
    return granted.session


async def closes(page, code=protocol.NOT_ALLOWED):
    """Assert that the server closes a page at once."""
    async with asyncio.timeout(patient(AT_ONCE)):
        assert await page.closed() == code


@pytest.fixture
async def technician(robot, ada):
    """Staff who need a right for a robot that is open only by invitation; the right."""
    robot.access = robot.Access.INVITATION
    await robot.asave()
    ada.is_staff = True
    await ada.asave()
    return await Permission.objects.aget(codename="change_robot")


async def test_notice_reaches_only_the_page_of_its_session(page, other):
    session = await drive(page)
    message = protocol.OperatorMessage(session=session, text="Mind the cat.")
    assert await sync_to_async(page_channel.send_notice)("giraff", message)
    assert await page.expect("session/operator_message") == message
    await other.observe()
    assert other.told("session/operator_message") == []


async def test_page_gets_the_end_of_its_session_by_staff_at_once(page, bob):
    session = await Session.objects.select_related("robot").aget(pk=await drive(page))
    await sync_to_async(interventions.end_session)(session, "smoke", bob, timezone.now())
    ended = await page.expect("session/ended")
    assert (ended.outcome, ended.reason) == ("stopped_by_operator", "smoke")


async def test_pages_of_a_deactivated_user_close_at_once(page, ada):
    await drive(page)
    ada.is_active = False
    await ada.asave()
    await closes(page, protocol.SIGNED_OUT)


async def test_logging_out_closes_only_the_pages_of_this_browser(bridge, robot, ada):
    async with Page("giraff", ada) as here, Page("giraff", ada) as elsewhere:
        await drive(here)
        client = AsyncClient()
        client.cookies[settings.SESSION_COOKIE_NAME] = here.cookie
        await client.post(reverse("account_logout"))
        await closes(here, protocol.SIGNED_OUT)
        await elsewhere.settle(bridge)


async def test_pages_are_checked_also_from_a_thread_with_an_event_loop(ada, monkeypatch):
    monkeypatch.setenv("DJANGO_ALLOW_ASYNC_UNSAFE", "1")
    layer = get_channel_layer()
    channel = await layer.new_channel()
    await layer.group_add(page_channel.visitor_group(ada.pk), channel)
    ada.groups.add(Group.objects.create(name="owners"))
    async with asyncio.timeout(patient(AT_ONCE)):
        assert (await layer.receive(channel))["type"] == page_channel.CHECK


async def test_login_has_ended_before_pages_are_checked(ada, monkeypatch):
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


async def test_session_ends_at_once_with_the_permit(bridge, robot, ada):
    robot.access = robot.Access.INVITATION
    await robot.asave()
    permit = await RobotPermit.objects.acreate(
        robot=robot, user=ada, kind=RobotPermit.Privilege.INVITED
    )
    async with Page("giraff", ada) as page:
        await drive(page)
        await permit.adelete()
        await closes(page)


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
async def test_session_ends_at_once_with_the_right_of_a_group(bridge, technician, ada, loss):
    group = await Group.objects.acreate(name="technicians")
    await group.permissions.aadd(technician)
    await ada.groups.aadd(group)
    async with Page("giraff", ada) as page:
        await drive(page)
        await sync_to_async(LOSSES[loss])(ada, group, technician)
        await closes(page)


async def test_session_ends_at_once_with_the_users_own_right(bridge, technician, ada):
    right = technician
    for remove in (ada.user_permissions.aremove, right.user_set.aremove):
        await ada.user_permissions.aadd(right)
        async with Page("giraff", ada) as page:
            await drive(page)
            await remove(right if remove.__self__.instance == ada else ada)
            await closes(page)


async def test_session_ends_at_once_when_the_robot_is_closed(robot, page):
    await drive(page)
    robot.access = robot.Access.INVITATION
    await robot.asave()
    await closes(page)


@pytest.fixture
def layer(monkeypatch):
    """A channel layer that never answers: the groups `sent`, and how many waited at once."""
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


def test_change_of_a_group_sends_one_message_per_member_concurrently(db, layer):
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


def test_checks_of_a_transaction_are_sent_once_after_its_commit(db, layer):
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


async def test_group_that_cannot_be_reached_does_not_delay_the_others(monkeypatch, caplog):
    reached = []

    async def group_send(_self, group, _message):
        if group == "a":
            raise OSError
        await asyncio.sleep(0)
        reached.append(group)

    monkeypatch.setattr(type(get_channel_layer()), "group_send", group_send)

    def check():
        with transaction.atomic():
            for group in ("a", "b", "c"):
                page_channel.check_pages(group)

    await sync_to_async(check)()
    assert sorted(reached) == ["b", "c"]
    assert "channel_layer_away" in caplog.text


async def test_channel_layer_that_starts_late_is_used(monkeypatch):
    monkeypatch.setattr(page_channel, "RETRY_SECONDS", 0.01)
    refusals = iter([OSError("away"), OSError("away")])
    new_channel = type(get_channel_layer()).new_channel

    async def late(self, *args):
        for refusal in refusals:
            raise refusal
        return await new_channel(self, *args)

    monkeypatch.setattr(type(get_channel_layer()), "new_channel", late)
    assert await page_channel.is_well()


async def test_channel_layer_recovers_from_a_restart_of_redis(tmp_path, caplog, settings):
    port = free_port()

    def start():
        words = ["redis-server", "--port", str(port), "--bind", "127.0.0.1", "--save", ""]
        return subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.DEVNULL)

    async def until(wanted):
        async with asyncio.timeout(patient(20)):
            while await page_channel.is_well() is not wanted:
                await asyncio.sleep(0.05)

    backend = "channels_redis.pubsub.RedisPubSubChannelLayer"
    hosts = {"hosts": [f"redis://127.0.0.1:{port}"]}
    settings.CHANNEL_LAYERS = {"default": {"BACKEND": backend, "CONFIG": hosts}}
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
