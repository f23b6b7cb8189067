"""A robot's own display: its key, its page and its WebSocket, with a bridge in memory and a real
database.
"""

import datetime
import io

import msgspec
import pytest
from asgiref.sync import sync_to_async
from django.contrib.auth import get_user_model
from django.core.management import CommandError, call_command
from django.test import Client
from django.utils import timezone

from accounts.models import AuditEntry
from robots.api import messages as m
from robots.models import Robot, RobotPresence
from robots.screens import cookie_of, make_screen_key, revoke_screen_key, screen_of
from sessions import protocol
from tests.support import words
from tests.support.browsers.pages import Display, Page, until
from tests.support.robots import create_robot

pytestmark = pytest.mark.django_db(transaction=True)


@pytest.fixture
def key(robot):
    return make_screen_key(robot, timezone.now())


def action(kind, **fields):
    return kind(**{"action_id": "a1", "stamp": 1.0, **fields})


# --- the key --------------------------------------------------------------------------------------


def test_a_key_opens_its_own_robots_screen_until_another_is_made_or_it_is_taken_away(robot, key):
    Robot.objects.create(name="rhodon", title="Rhodon")
    assert screen_of("giraff", key) == robot
    assert screen_of("rhodon", key) is None
    assert screen_of("giraff", "") is None
    again = make_screen_key(robot, timezone.now())
    assert (screen_of("giraff", key), screen_of("giraff", again)) == (None, robot)
    revoke_screen_key(robot)
    assert screen_of("giraff", again) is None
    assert key not in str(Robot.objects.values().first())


def test_the_page_takes_the_key_once_and_keeps_it_where_no_script_reads_it(client, robot, key):
    page = client.get("/robots/giraff/screen/")
    assert page.status_code == 200
    assert key not in page.content.decode()
    refused = client.post("/robots/giraff/screen/key/", {"key": "guess"})
    assert (refused.status_code, cookie_of("giraff") in client.cookies) == (403, False)
    assert client.post("/robots/giraff/screen/key/", {"key": key}).status_code == 204
    cookie = client.cookies[cookie_of("giraff")]
    assert (cookie.value, cookie["httponly"], cookie["samesite"]) == (key, True, "Strict")


def test_without_the_key_the_page_tells_neither_what_a_robot_is_called_nor_whether_there_is_one(
    client, robot, key
):
    Robot.objects.filter(pk=robot.pk).update(title="The board room", access=Robot.Access.INVITATION)
    there, nowhere = client.get("/robots/giraff/screen/"), client.get("/robots/nowhere/screen/")
    assert (there.status_code, nowhere.status_code) == (200, 200)
    assert "The board room" not in there.content.decode()
    client.cookies[cookie_of("giraff")] = key
    assert "The board room" in client.get("/robots/giraff/screen/").content.decode()


def test_guessing_ends_soon_and_a_foreign_page_cannot_guess_at_all(client, robot, key, monkeypatch):
    monkeypatch.setattr("sessions.screen_views.time.time", lambda: 1e9)  # all within one minute
    codes = [
        client.post("/robots/giraff/screen/key/", {"key": f"guess {n}"}).status_code
        for n in range(25)
    ]
    assert codes[0] == 403
    assert codes[-1] == 429
    assert (
        Client(enforce_csrf_checks=True)
        .post("/robots/giraff/screen/key/", {"key": key})
        .status_code
        == 403
    )


def test_the_owner_makes_the_address_in_the_administration_and_takes_it_away(client, robot):
    client.force_login(
        get_user_model().objects.create(username="researcher", is_staff=True, is_superuser=True)
    )
    address = f"/admin/robots/robot/{robot.pk}/screen/"
    made = client.post(address).content.decode()
    shown = made.partition('<pre id="screen-address">')[2].partition("</pre>")[0]
    assert shown.startswith("http://testserver/robots/giraff/screen/#")
    assert screen_of("giraff", shown.partition("#")[2]) is not None
    assert shown not in client.get(address).content.decode()
    client.post(address, {"revoke": "1"})
    assert screen_of("giraff", shown.partition("#")[2]) is None
    assert (
        "Create an address"
        in client.get(f"/admin/robots/robot/{robot.pk}/change/").content.decode()
    )


def test_the_command_prints_an_address_that_opens(robot):
    out = io.StringIO()
    call_command("screen_link", "giraff", server="https://example.org/", stdout=out)
    address, _, key = out.getvalue().strip().partition("#")
    assert address == "https://example.org/robots/giraff/screen/"
    assert screen_of("giraff", key) == robot
    with pytest.raises(CommandError, match="nobody"):
        call_command("screen_link", "nobody", server="https://example.org")
    with pytest.raises(CommandError, match="--server"):
        call_command("screen_link", "giraff")
    assert AuditEntry.objects.get(act="screen_key_made").robot == "giraff"


# --- the WebSocket --------------------------------------------------------------------------------


async def test_without_its_key_nobody_is_a_robots_screen(bridge, robot, key):
    for wrong in ("", "guess"):
        display = Display(wrong)
        await display.open()
        assert await display.closed() == protocol.NOT_ALLOWED


async def test_a_screen_is_told_who_visits_and_what_they_say(bridge, robot, key):
    ada = await sync_to_async(get_user_model().objects.create_user)(
        "ada", display_name="Ada", password="x"
    )
    async with (
        Display(key) as display,
        Page("giraff", ada) as page,
        Page("giraff", ada) as watching,
    ):
        assert (await display.expect("screen")).visitor is None
        granted = await page.take()
        shown = await display.expect("screen")
        assert (shown.visitor, shown.session, shown.study) == ("Ada", granted.session, False)
        await watching.observe()
        said = m.Words(
            stamp=1.0, action_id="a1", session=granted.session, by="driver", who="Ada", text="Hello"
        )
        bridge.say("giraff", "words", said)
        assert await display.expect("words") == said
        assert await page.expect("words") == said
        receipt = m.Receipt(stamp=1.0, action_id="a1", session=granted.session, state="shown")
        bridge.say("giraff", "receipt", receipt)
        assert await page.expect("receipt") == receipt
        for one in (display, watching):
            await one.settle(bridge)
            assert one.told("receipt") == [], "it is for the driver alone"
        assert watching.told("words") == []


async def test_waiting_visitor_and_people_at_a_stopped_robot_chat(bridge, robot, key):
    create = sync_to_async(get_user_model().objects.create_user)
    ada, bob = await create("ada", display_name="Ada"), await create("bob", display_name="Bob")
    stop = m.Safety(estop=True, estop_source="screen:Giraff")
    await sync_to_async(RobotPresence.objects.update)(
        report=msgspec.to_builtins(words.state(safety=stop)),
        last_seen_at=timezone.now() + datetime.timedelta(hours=1),  # for longer than the test
    )
    async with (
        Display(key) as display,
        Page("giraff", ada) as page,
        Page("giraff", bob) as second,
    ):
        bridge.say("giraff", "state", words.state(safety=stop))
        for one in (page, second):
            queued = await one.queue()
            assert queued.reason == "paused: estop"
        shown = await display.expect("screen", lambda screen: screen.waiting is not None)
        assert (shown.waiting, shown.visitor, shown.session) == ("Ada", None, None)
        await second.say("command/action", action(m.Say, text="Me too"))
        assert (await second.expect("denied")).reason == "not_driver"
        await page.say("command/action", action(m.Say, text="Is anybody there?"))
        for one in (page, display):
            told = await one.expect("words")
            assert (told.by, told.who, told.text) == ("driver", "Ada", "Is anybody there?")
        done = page.told("action") or [await page.expect("action")]  # in whatever order
        assert [status.status for status in done] == ["FINISHED"]
        await display.say("command/action", action(m.Say, action_id="a2", text="One moment"))
        for one in (page, display):
            told = await one.expect("words")
            assert (told.by, told.who, told.text) == ("screen", "Giraff", "One moment")
        await second.settle(bridge)
        assert second.told("words") == []
        assert bridge.commands("command/action") == [], "the robot has no part in it"


async def test_a_screens_action_has_its_role_and_the_servers_timestamp(bridge, robot, key):
    async with Display(key) as display:
        await display.expect("screen")
        await display.say(
            "command/action", action(m.AnswerCall, accept=True, role="owner", user="Mallory")
        )
        await until(lambda: bridge.sent)
        name, suffix, answer = bridge.sent[-1]
        assert (name, suffix, answer.role, answer.user) == (
            "giraff",
            "command/action",
            "screen",
            "Giraff",
        )
        assert answer.stamp > 1.6e9
        await display.say("command/action", action(m.EStop))
        await until(lambda: bridge.stops)
        assert bridge.stops[-1][1].role == "screen"
        await display.say("command/velocity", words.velocity())
        assert (await display.expect("denied")).reason == "not_allowed"


async def test_each_side_is_told_where_the_other_points_and_nobody_else_is(bridge, robot, key):
    ada = await sync_to_async(get_user_model().objects.create_user)(
        "ada", display_name="Ada", password="x"
    )
    async with (
        Display(key) as display,
        Page("giraff", ada) as page,
        Page("giraff", ada) as watching,
    ):
        granted = await page.take()
        await display.expect("screen", lambda shown: shown.visitor == "Ada")
        await watching.observe()
        await page.say(
            "command/point", m.PointCommand(stamp=1.0, at=(0.5, 0.25), role="screen", peer="x")
        )
        await watching.say(
            "command/point",
            m.PointCommand(stamp=1.0, at=(0.5, 0.25), session=granted.session, epoch=granted.epoch),
        )
        assert (await watching.expect("denied")).reason == "observer"
        await display.say("command/point", m.PointCommand(stamp=2.0, at=(0.1, 0.2)))
        await until(lambda: len(bridge.commands("command/point")) == 2)
        sent = {command.role: command for command in bridge.commands("command/point")}
        assert (sent["driver"].peer, sent["driver"].session, sent["driver"].epoch) == (
            granted.peer,
            granted.session,
            granted.epoch,
        )
        assert (sent["screen"].session, sent["screen"].stamp) == (None, 2.0)
        dots = {by: m.Pointer(stamp=3.0, by=by, at=(0.5, 0.25)) for by in ("driver", "screen")}
        for dot in dots.values():
            bridge.say("giraff", "pointer", dot)
        assert await display.expect("pointer") == dots["driver"]
        assert await page.expect("pointer") == dots["screen"]
        for one in (display, page, watching):
            await one.settle(bridge)
            bridge.say("giraff", "state", words.state(seq=7))
            await one.expect("state")
        assert [len(one.told("pointer")) for one in (display, page, watching)] == [1, 1, 0]
        # A page that hears its robot directly has it from there.
        await page.say("page/direct", protocol.Direct(direct=True))
        await page.settle(bridge)
        bridge.say("giraff", "pointer", dots["screen"])
        bridge.say(
            "giraff",
            "words",
            m.Words(stamp=1.0, action_id="a", session=granted.session, by="screen", text="Here"),
        )
        await page.expect("words")
        assert len(page.told("pointer")) == 1


async def test_a_dot_that_cannot_reach_the_robot_is_dropped_without_a_word(bridge, robot, key):
    async with Display(key) as display:
        await display.expect("screen")
        bridge.connected = False
        await display.say("command/point", m.PointCommand(stamp=2.0, at=(0.1, 0.2)))
        await display.say("command/action", action(m.Say, text="hello"))
        assert (await display.expect("denied")).suffix == "command/action"
        assert len(display.told("denied")) == 1


async def test_a_replaced_key_sends_the_display_away(bridge, robot, key, monkeypatch):
    from sessions.consumers import robot_page

    monkeypatch.setattr(robot_page, "WELCOME_EVERY", 0.0)
    monkeypatch.setattr(robot_page, "POLL_INTERVAL_S", 0.05)
    async with Display(key) as display:
        await display.expect("screen")
        await sync_to_async(revoke_screen_key)(robot)
        assert await display.closed() == protocol.NOT_ALLOWED


async def test_the_server_speaks_for_a_display_while_its_socket_lives_and_no_longer(
    bridge, robot, key, monkeypatch
):
    from sessions.consumers import robot_page

    monkeypatch.setattr(robot_page, "WELCOME_EVERY", 0.0)
    monkeypatch.setattr(robot_page, "POLL_INTERVAL_S", 0.05)
    async with Display(key) as display:
        peer = (await display.expect("hello")).peer
        await until(lambda: bridge.commands(f"signal/{peer}").count(m.Stay()) >= 3)
    await until(lambda: bridge.commands(f"signal/{peer}")[-1:] == [m.Bye(reason="left")])
