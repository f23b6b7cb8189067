"""Whatever goes wrong, a page's request is answered, its other frames pass, and other pages do not
wait for it: pages of visitors, operators and displays, with a bridge in memory and a real database.
"""

import asyncio
import threading

import msgspec
import pytest
from asgiref.sync import sync_to_async
from django.contrib.auth import get_user_model
from django.db import OperationalError
from django.utils import timezone

from robots import ice
from robots.api import messages as m
from robots.models import Robot, RobotPresence
from robots.screens import make_screen_key
from sessions import page_channel, protocol
from sessions.consumers import queries, waiting_chat
from sessions.consumers.authorization import Authorization
from sessions.leases import store
from sessions.leases.terms import Terms
from sessions.wizard import leases, operators
from sessions.wizard import protocol as wizard_protocol
from sessions.wizard.script import Script
from tests.support import words
from tests.support.browsers.pages import Display, Page, until
from tests.support.browsers.wizard_console import Console
from tests.support.patience import patient
from tests.support.robots import create_robot
from tests.support.studies.fixed_terms import provided

pytestmark = pytest.mark.django_db(transaction=True)
AWAY, OURS = OperationalError("database is locked"), msgspec.ValidationError("terms")
ESTOP = m.Safety(estop=True, estop_source="screen:Giraff")


@pytest.fixture(autouse=True)
def robot(db, ada):
    return create_robot(
        name="giraff",
        title="Giraff",
        owner=ada,
        connection="ONLINE",
        boot="b1",
        last_seen_at=timezone.now(),
    )


def raising(error):
    def broken(*_arguments, **_named):
        raise error

    return broken


def held(function):
    """Return a function that waits before it does what the given one does, and two events: it was
    called, and it may go on.
    """
    called, may_go_on = threading.Event(), threading.Event()

    def slow(*arguments, **named):
        called.set()
        assert may_go_on.wait(patient(20))
        return function(*arguments, **named)

    return slow, called, may_go_on


async def stop(robot):
    """Press the robot's emergency stop, for its row and its pages."""
    report = msgspec.to_builtins(words.state(safety=ESTOP))
    await RobotPresence.objects.filter(robot=robot).aupdate(report=report)


# --- every request is answered --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("suffix", "verb", "error"),
    [
        ("session/take", protocol.Take(), AWAY),
        ("session/take", protocol.Take(), OURS),
        ("session/observe", protocol.Observe(), OURS),
        ("session/leave", protocol.Leave(), OURS),
        ("session/assist", protocol.Assist(level="slow"), OURS),
    ],
)
async def test_a_request_that_fails_is_denied_and_the_next_is_done(
    bridge, ada, monkeypatch, suffix, verb, error
):
    async with Page("giraff", ada) as page:
        await page.expect("hello")
        monkeypatch.setattr(queries, "welcome", raising(error))
        await page.say(suffix, verb)
        denied = await page.expect("denied")
        assert (denied.suffix, denied.reason) == (suffix, "unavailable")
        monkeypatch.undo()
        await page.take()


async def test_a_request_that_was_done_is_not_denied_when_the_queue_cannot_be_read(
    bridge, ada, monkeypatch
):
    async with Page("giraff", ada) as page:
        await page.expect("hello")
        monkeypatch.setattr(queries, "queue_at", raising(AWAY))
        granted = await page.take()
        await page.say("session/leave", protocol.Leave(session=granted.session))
        await page.expect("session/ended")
        await page.say("session/observe", protocol.Observe())  # done after the two
        await page.expect("session/observing")
        assert page.told("denied") == []


@pytest.mark.parametrize("error", [AWAY, OURS])
async def test_an_operators_request_that_fails_is_denied(bridge, ada, monkeypatch, error):
    clear = m.ClearEStop(action_id="c", stamp=1.0)
    async with Page("giraff", ada) as page:
        await page.observe()
        monkeypatch.setattr(queries, "welcome", raising(error))
        await page.say("command/action", clear)
        denied = await page.expect("denied")
        assert (denied.suffix, denied.reason) == ("command/action", "unavailable")
        await page.say("audience/lower", protocol.LowerHands())
        denied = await page.expect("denied")
        assert (denied.suffix, denied.reason) == ("audience/lower", "unavailable")
        monkeypatch.undo()
        await page.say("command/action", clear)
        await until(lambda: [one.action_id for one in bridge.commands("command/action")] == ["c"])


async def test_words_to_a_stopped_robot_that_fail_are_denied(bridge, robot, bob, monkeypatch):
    await stop(robot)
    async with Page("giraff", bob) as page:
        bridge.say("giraff", "state", words.state(safety=ESTOP))
        await page.queue()
        monkeypatch.setattr(waiting_chat, "first_waiting", raising(OperationalError("away")))
        await page.say("command/action", m.Say(action_id="a1", stamp=1.0, text="Hello?"))
        denied = await page.expect("denied")
        assert (denied.suffix, denied.reason) == ("command/action", "unavailable")


async def test_words_of_a_display_that_fail_are_denied(bridge, robot, bob, monkeypatch):
    key = await sync_to_async(make_screen_key)(robot, timezone.now())
    await stop(robot)
    async with Display(key) as display, Page("giraff", bob) as page:
        bridge.say("giraff", "state", words.state(safety=ESTOP))
        await page.say("session/take", protocol.Take())
        await display.expect("screen", lambda screen: screen.waiting is not None)

        async def broken(*_arguments):
            raise LookupError

        monkeypatch.setattr(page_channel, "send_words", broken)
        await display.say("command/action", m.Say(action_id="a1", stamp=1.0, text="Hello?"))
        denied = await display.expect("denied")
        assert (denied.suffix, denied.reason) == ("command/action", "unavailable")


class Operators:
    """An app above in which everybody operates every session."""

    def may_operate(self, _user, _robot):
        return True

    def operated(self, _user, _session):
        script = Script(language="en", stages=())
        return operators.OperatedSession("P1", "", is_blind=True, script=script)


async def test_a_hidden_operators_request_that_fails_is_denied(bridge, ada, bob, monkeypatch):
    monkeypatch.setattr(operators, "_providers", [Operators()])
    with provided() as terms:
        terms.terms = Terms(driver="wizard", controllers=())
        async with Page("giraff", ada) as page, Console("giraff", bob) as console:
            await page.take()
            scene = await console.expect("wizard/session", lambda scene: scene.session)
            right = leases.take
            monkeypatch.setattr(leases, "take", raising(OURS))
            await console.say("wizard/take", wizard_protocol.TakeOver(session=scene.session))
            denied = await console.expect("denied")
            assert (denied.suffix, denied.reason) == ("wizard/take", "unavailable")
            monkeypatch.setattr(leases, "take", right)
            await console.say("wizard/take", wizard_protocol.TakeOver(session=scene.session))
            await console.expect("wizard/granted")


async def test_a_frame_that_fails_is_denied_and_the_stop_after_it_passes(bridge, ada, monkeypatch):
    async with Page("giraff", ada) as page:
        await page.take()
        monkeypatch.setattr(Authorization, "_velocity", raising(LookupError()))
        await page.say("command/velocity", words.velocity(seq=1))
        denied = await page.expect("denied")
        assert (denied.suffix, denied.reason) == ("command/velocity", "unavailable")
        await page.settle(bridge)


async def test_an_error_ends_neither_events_nor_looks_of_a_page(bridge, robot, ada, monkeypatch):
    async with Page("giraff", ada) as page:
        granted = await page.take()
        right = protocol.decode_notice
        monkeypatch.setattr(protocol, "decode_notice", raising(LookupError()))
        warning = protocol.TurnWarning(session=granted.session, remaining=9.0)
        send = sync_to_async(page_channel.send_notice)
        await send("giraff", warning)
        await page.settle(bridge)
        monkeypatch.setattr(protocol, "decode_notice", right)

        async def warned():
            await send("giraff", warning)
            return page.told("session/turn_warning") or await page.next()

        async with asyncio.timeout(patient(10)):
            while not page.told("session/turn_warning"):
                await warned()


# --- one page's query keeps no other page waiting -------------------------------------------------


async def test_a_slow_query_of_one_page_does_not_hold_the_others(bridge, ada, bob, monkeypatch):
    slow, called, may_go_on = held(store.take)
    async with Page("giraff", ada) as page:
        await page.expect("hello")
        monkeypatch.setattr(store, "take", slow)
        await page.say("session/take", protocol.Take())
        assert await asyncio.to_thread(called.wait, patient(10))
        async with Page("giraff", bob) as other:
            await other.expect("hello")
            await other.observe()
        may_go_on.set()
        await page.expect("session/granted")


@pytest.mark.parametrize("kind", ["page", "display", "console"])
async def test_a_socket_is_accepted_when_the_database_has_answered(
    bridge, robot, ada, monkeypatch, kind
):
    monkeypatch.setattr(operators, "_providers", [Operators()])
    key = await sync_to_async(make_screen_key)(robot, timezone.now())
    where, page = {
        "page": (queries, Page("giraff", ada)),
        "display": (Robot.objects, Display(key)),
        "console": (Operators, Console("giraff", ada)),
    }[kind]
    name = {"page": "enter", "display": "filter", "console": "may_operate"}[kind]
    slow, called, may_go_on = held(getattr(where, name))
    monkeypatch.setattr(where, name, slow)
    opening = asyncio.create_task(page.open())
    assert await asyncio.to_thread(called.wait, patient(10))
    await asyncio.wait({opening}, timeout=0.2)
    assert not opening.done()
    may_go_on.set()
    assert await opening
    await page.close()


async def test_a_page_that_comes_while_the_database_is_away_is_turned_away(
    bridge, ada, monkeypatch
):
    monkeypatch.setattr(queries, "enter", raising(OperationalError("away")))
    assert not await Page("giraff", ada).open()
    monkeypatch.undo()
    async with Page("giraff", ada) as page:
        await page.expect("hello")


# --- servers for video ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["page", "display", "console"])
async def test_an_offer_of_an_old_page_has_credentials_that_are_valid(
    bridge, robot, ada, monkeypatch, settings, kind
):
    settings.TURN_URLS, settings.TURN_SECRET = ["turn:turn.example.org"], "secret"
    monkeypatch.setattr(operators, "_providers", [Operators()])
    key = await sync_to_async(make_screen_key)(robot, timezone.now())
    page = {
        "page": Page("giraff", ada),
        "display": Display(key),
        "console": Console("giraff", ada),
    }[kind]
    now = ice.time.time()
    async with page:
        await page.expect("wizard/hello" if kind == "console" else "hello")
        if kind == "page":
            await page.observe()
        monkeypatch.setattr(ice.time, "time", lambda: now + 7 * 3600)
        await page.say("signal", m.SdpOffer(sdp="v=0"))

        def offers():
            return [message for _, _, message in bridge.sent if isinstance(message, m.SdpOffer)]

        await until(offers)
        (server,) = offers()[0].ice_servers
    assert int(server.username.partition(":")[0]) > now + 8 * 3600


async def test_more_offers_than_a_page_needs_are_refused(bridge, ada):
    async with Page("giraff", ada) as page:
        await page.observe()
        for _ in range(40):
            await page.say("signal", m.SdpOffer(sdp="v=0"))
        denied = await page.expect("denied")
        assert (denied.suffix, denied.reason) == ("signal", "rate")
        await page.say("signal", m.Candidate(candidate="candidate:1", sdp_mid="0"))
        await page.settle(bridge)
    sent = [message for _, _, message in bridge.sent]
    assert 5 <= sum(isinstance(message, m.SdpOffer) for message in sent) <= 12
    assert sum(isinstance(message, m.Candidate) for message in sent) == 1
