"""A robot's own display: its key, its page and its WebSocket, with a bridge in memory."""

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
from tests.support.browsers.pages import Display, Page
from tests.support.patience import until

pytestmark = pytest.mark.django_db(transaction=True)


def action(kind, **fields):
    return kind(**{"action_id": "a1", "stamp": 1.0, **fields})


# --- the key --------------------------------------------------------------------------------------


def test_key_opens_its_robots_screen_until_it_is_replaced_or_revoked(robot, key):
    Robot.objects.create(name="rhodon", title="Rhodon")
    assert screen_of("giraff", key) == robot
    assert screen_of("rhodon", key) is None
    assert screen_of("giraff", "") is None
    again = make_screen_key(robot, timezone.now())
    assert (screen_of("giraff", key), screen_of("giraff", again)) == (None, robot)
    revoke_screen_key(robot)
    assert screen_of("giraff", again) is None
    assert key not in str(Robot.objects.values().first())


def test_key_is_posted_once_and_stored_in_a_http_only_cookie(client, robot, key):
    page = client.get("/robots/giraff/screen/")
    assert page.status_code == 200
    assert key not in page.content.decode()
    refused = client.post("/robots/giraff/screen/key/", {"key": "guess"})
    assert (refused.status_code, cookie_of("giraff") in client.cookies) == (403, False)
    assert client.post("/robots/giraff/screen/key/", {"key": key}).status_code == 204
    cookie = client.cookies[cookie_of("giraff")]
    assert (cookie.value, cookie["httponly"], cookie["samesite"]) == (key, True, "Strict")


def test_page_without_the_key_does_not_reveal_a_robot(client, robot, key):
    Robot.objects.filter(pk=robot.pk).update(title="The board room", access=Robot.Access.INVITATION)
    there, nowhere = client.get("/robots/giraff/screen/"), client.get("/robots/nowhere/screen/")
    assert (there.status_code, nowhere.status_code) == (200, 200)
    assert "The board room" not in there.content.decode()
    client.cookies[cookie_of("giraff")] = key
    assert "The board room" in client.get("/robots/giraff/screen/").content.decode()


def test_guesses_are_limited_and_need_a_csrf_token(client, robot, key, monkeypatch):
    monkeypatch.setattr("sessions.screen_views.time.time", lambda: 1e9)  # all within one minute
    codes = [
        client.post("/robots/giraff/screen/key/", {"key": f"guess {n}"}).status_code
        for n in range(25)
    ]
    assert codes[0] == 403
    assert codes[-1] == 429
    foreign = Client(enforce_csrf_checks=True)
    assert foreign.post("/robots/giraff/screen/key/", {"key": key}).status_code == 403


def test_address_is_created_and_revoked_in_the_administration(client, robot):
    client.force_login(get_user_model().objects.create_superuser("researcher"))
    address = f"/admin/robots/robot/{robot.pk}/screen/"
    made = client.post(address).content.decode()
    shown = made.partition('<pre id="screen-address">')[2].partition("</pre>")[0]
    assert shown.startswith("http://testserver/robots/giraff/screen/#")
    assert screen_of("giraff", shown.partition("#")[2]) is not None
    assert shown not in client.get(address).content.decode()
    client.post(address, {"revoke": "1"})
    assert screen_of("giraff", shown.partition("#")[2]) is None
    change = client.get(f"/admin/robots/robot/{robot.pk}/change/").content.decode()
    assert "Create an address" in change


def test_command_prints_a_valid_address(robot):
    out = io.StringIO()
    call_command("screen_link", "giraff", server="https://example.org/", stdout=out)
    address, _, key = out.getvalue().strip().partition("#")
    assert address == "https://example.org/robots/giraff/screen/"
    assert screen_of("giraff", key) == robot
    with pytest.raises(CommandError, match="unknown"):
        call_command("screen_link", "unknown", server="https://example.org")
    with pytest.raises(CommandError, match="--server"):
        call_command("screen_link", "giraff")
    assert AuditEntry.objects.get(act="screen_key_made").robot == "giraff"


# --- the WebSocket --------------------------------------------------------------------------------


async def test_display_without_the_key_is_refused(bridge, robot, key):
    for wrong in ("", "guess"):
        display = Display(wrong)
        await display.open()
        assert await display.closed() == protocol.NOT_ALLOWED


async def test_screen_shows_the_visitor_and_their_messages(bridge, display, page, ada):
    async with Page("giraff", ada) as watching:
        assert (await display.expect("screen")).visitor is None
        granted = await page.take()
        shown = await display.expect("screen")
        assert (shown.visitor, shown.session, shown.study) == ("Ada", granted.session, False)
        await watching.observe()
        hello = {"by": "driver", "who": "Ada", "text": "Hello"}
        sent = m.Words(stamp=1.0, action_id="a1", session=granted.session, **hello)
        bridge.say("giraff", "words", sent)
        assert await display.expect("words") == sent
        assert await page.expect("words") == sent
        receipt = m.Receipt(stamp=1.0, action_id="a1", session=granted.session, state="shown")
        bridge.say("giraff", "receipt", receipt)
        assert await page.expect("receipt") == receipt
        for one in (display, watching):
            await one.settle(bridge)
            assert one.told("receipt") == [], "only the driver gets receipts"
        assert watching.told("words") == []


STOP = m.Safety(estop=True, estop_source="screen:Giraff")


@pytest.fixture
def stopped(robot):
    report = msgspec.to_builtins(words.state(safety=STOP))
    later = timezone.now() + datetime.timedelta(hours=1)  # for longer than the test
    RobotPresence.objects.update(report=report, last_seen_at=later)


async def test_waiting_visitor_and_people_at_a_stopped_robot_chat(
    bridge, stopped, display, page, other
):
    bridge.say("giraff", "state", words.state(safety=STOP))
    for one in (page, other):
        queued = await one.queue()
        assert queued.reason == "paused: estop"
    shown = await display.expect("screen", lambda screen: screen.waiting is not None)
    assert (shown.waiting, shown.visitor, shown.session) == ("Ada", None, None)
    await other.say("command/action", action(m.Say, text="Me too"))
    assert (await other.expect("denied")).reason == "not_driver"
    await page.say("command/action", action(m.Say, text="Is anybody there?"))
    for one in (page, display):
        shown = await one.expect("words")
        assert (shown.by, shown.who, shown.text) == ("driver", "Ada", "Is anybody there?")
    done = page.told("action") or [await page.expect("action")]  # in either order
    assert [status.status for status in done] == ["FINISHED"]
    await display.say("command/action", action(m.Say, action_id="a2", text="One moment"))
    for one in (page, display):
        shown = await one.expect("words")
        assert (shown.by, shown.who, shown.text) == ("screen", "Giraff", "One moment")
    await other.settle(bridge)
    assert other.told("words") == []
    assert bridge.commands("command/action") == [], "the robot received the chat"


async def test_action_of_a_screen_has_its_role_and_the_servers_stamp(bridge, display):
    await display.expect("screen")
    forged = action(m.AnswerCall, accept=True, role="owner", user="Mallory")
    await display.say("command/action", forged)
    await until(lambda: bridge.sent)
    name, suffix, answer = bridge.sent[-1]
    assert (name, suffix) == ("giraff", "command/action")
    assert (answer.role, answer.user) == ("screen", "Giraff")
    assert answer.stamp > 1.6e9
    await display.say("command/action", action(m.EStop))
    await until(lambda: bridge.stops)
    assert bridge.stops[-1][1].role == "screen"
    await display.say("command/velocity", words.velocity())
    assert (await display.expect("denied")).reason == "not_allowed"


async def test_pointers_reach_only_the_other_side(bridge, display, page, ada):
    async with Page("giraff", ada) as watching:
        granted = await page.take()
        await display.expect("screen", lambda shown: shown.visitor == "Ada")
        await watching.observe()
        here, own = (0.5, 0.25), {"session": granted.session, "epoch": granted.epoch}
        forged = m.PointCommand(stamp=1.0, at=here, role="screen", peer="x")
        await page.say("command/point", forged)
        await watching.say("command/point", m.PointCommand(stamp=1.0, at=here, **own))
        assert (await watching.expect("denied")).reason == "observer"
        await display.say("command/point", m.PointCommand(stamp=2.0, at=(0.1, 0.2)))
        await until(lambda: len(bridge.commands("command/point")) == 2)
        sent = {command.role: command for command in bridge.commands("command/point")}
        driver = sent["driver"]
        assert (driver.peer, driver.session, driver.epoch) == (granted.peer, *own.values())
        assert (sent["screen"].session, sent["screen"].stamp) == (None, 2.0)
        dots = {by: m.Pointer(stamp=3.0, by=by, at=here) for by in ("driver", "screen")}
        for dot in dots.values():
            bridge.say("giraff", "pointer", dot)
        assert await display.expect("pointer") == dots["driver"]
        assert await page.expect("pointer") == dots["screen"]
        for one in (display, page, watching):
            await one.settle(bridge)
            bridge.say("giraff", "state", words.state(seq=7))
            await one.expect("state")
        assert [len(one.told("pointer")) for one in (display, page, watching)] == [1, 1, 0]
        # A page with a direct connection gets pointers over that.
        await page.say("page/direct", protocol.Direct(direct=True))
        await page.settle(bridge)
        bridge.say("giraff", "pointer", dots["screen"])
        spoken = {"session": granted.session, "by": "screen", "text": "Here"}
        bridge.say("giraff", "words", m.Words(stamp=1.0, action_id="a", **spoken))
        await page.expect("words")
        assert len(page.told("pointer")) == 1


async def test_pointer_that_cannot_reach_the_robot_is_dropped_without_a_denial(bridge, display):
    await display.expect("screen")
    bridge.connected = False
    await display.say("command/point", m.PointCommand(stamp=2.0, at=(0.1, 0.2)))
    await display.say("command/action", action(m.Say, text="hello"))
    assert (await display.expect("denied")).suffix == "command/action"
    assert len(display.told("denied")) == 1


@pytest.fixture
def frequent_checks(monkeypatch):
    monkeypatch.setattr("sessions.consumers.robot_page.WELCOME_EVERY", 0.0)
    monkeypatch.setattr("sessions.consumers.robot_page.POLL_INTERVAL_S", 0.05)


async def test_display_with_a_revoked_key_is_disconnected(robot, frequent_checks, display):
    await display.expect("screen")
    await sync_to_async(revoke_screen_key)(robot)
    assert await display.closed() == protocol.NOT_ALLOWED


async def test_server_vouches_for_a_display_while_its_socket_is_open(
    bridge, frequent_checks, display
):
    peer = (await display.expect("hello")).peer
    await until(lambda: bridge.commands(f"signal/{peer}").count(m.Stay()) >= 3)
    await display.close()
    await until(lambda: bridge.commands(f"signal/{peer}")[-1:] == [m.Bye(reason="left")])
