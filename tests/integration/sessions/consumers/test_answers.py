"""Each request is answered although something fails, other frames pass, and other pages do not
wait: pages of visitors, operators and displays, with a bridge in memory and a real database.
"""

import asyncio
import threading

import msgspec
import pytest
from asgiref.sync import sync_to_async
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
from sessions.wizard import leases, operators, protocol as wizard_protocol
from tests.support import words
from tests.support.browsers.pages import Display, Page
from tests.support.browsers.wizard_console import Console, Operators
from tests.support.patience import patient, until
from tests.support.robots import online_robot
from tests.support.studies.fixed_terms import provided

pytestmark = pytest.mark.django_db(transaction=True)
AWAY, OURS = OperationalError("database is locked"), msgspec.ValidationError("terms")
ESTOP = m.Safety(estop=True, estop_source="screen:Giraff")


@pytest.fixture(autouse=True)
def robot(db, ada):
    return online_robot(owner=ada, boot="b1")


def raising(error):
    def broken(*_arguments, **_named):
        raise error

    return broken


def held(function):
    """Return the function with a wait before it, and two events: it was called, and it may go
    on.
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
async def test_request_that_fails_is_denied_and_the_next_is_granted(
    page, monkeypatch, suffix, verb, error
):
    await page.expect("hello")
    monkeypatch.setattr(queries, "welcome", raising(error))
    await page.say(suffix, verb)
    assert await page.denied() == (suffix, "unavailable")
    monkeypatch.undo()
    await page.take()


async def test_completed_request_is_not_denied_if_the_queue_cannot_be_read(page, monkeypatch):
    await page.expect("hello")
    monkeypatch.setattr(queries, "queue_at", raising(AWAY))
    granted = await page.take()
    await page.say("session/leave", protocol.Leave(session=granted.session))
    await page.expect("session/ended")
    await page.say("session/observe", protocol.Observe())  # done after the two
    await page.expect("session/observing")
    assert page.told("denied") == []


@pytest.mark.parametrize("error", [AWAY, OURS])
async def test_operators_request_that_fails_is_denied(bridge, page, monkeypatch, error):
    clear = m.ClearEStop(action_id="c", stamp=1.0)
    await page.observe()
    monkeypatch.setattr(queries, "welcome", raising(error))
    await page.say("command/action", clear)
    assert await page.denied() == ("command/action", "unavailable")
    await page.say("audience/lower", protocol.LowerHands())
    assert await page.denied() == ("audience/lower", "unavailable")
    monkeypatch.undo()
    await page.say("command/action", clear)
    await until(lambda: [one.action_id for one in bridge.commands("command/action")] == ["c"])


async def test_message_to_a_stopped_robot_that_fails_is_denied(bridge, robot, bob, monkeypatch):
    await stop(robot)
    async with Page("giraff", bob) as page:
        bridge.say("giraff", "state", words.state(safety=ESTOP))
        await page.queue()
        monkeypatch.setattr(waiting_chat, "first_waiting", raising(OperationalError("away")))
        await page.say("command/action", m.Say(action_id="a1", stamp=1.0, text="Hello?"))
        assert await page.denied() == ("command/action", "unavailable")


async def test_message_of_a_display_that_fails_is_denied(bridge, robot, bob, monkeypatch):
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
        assert await display.denied() == ("command/action", "unavailable")


async def test_hidden_operators_request_that_fails_is_denied(bridge, ada, bob, monkeypatch):
    monkeypatch.setattr(operators, "_providers", [Operators()])
    with provided() as terms:
        terms.terms = Terms(driver="wizard", controllers=())
        async with Page("giraff", ada) as page, Console("giraff", bob) as console:
            await page.take()
            scene = await console.expect("wizard/session", lambda scene: scene.session)
            right = leases.take
            monkeypatch.setattr(leases, "take", raising(OURS))
            await console.say("wizard/take", wizard_protocol.TakeOver(session=scene.session))
            assert await console.denied() == ("wizard/take", "unavailable")
            monkeypatch.setattr(leases, "take", right)
            await console.say("wizard/take", wizard_protocol.TakeOver(session=scene.session))
            await console.expect("wizard/granted")


async def test_frame_that_fails_is_denied_and_the_stop_after_it_passes(bridge, driver, monkeypatch):
    monkeypatch.setattr(Authorization, "_velocity", raising(LookupError()))
    await driver.say("command/velocity", words.velocity(seq=1))
    assert await driver.denied() == ("command/velocity", "unavailable")
    await driver.settle(bridge)


async def test_notice_that_fails_does_not_block_the_next(bridge, driver, monkeypatch):
    right = protocol.decode_notice
    monkeypatch.setattr(protocol, "decode_notice", raising(LookupError()))
    warning = protocol.TurnWarning(session=driver.granted.session, remaining=9.0)
    send = sync_to_async(page_channel.send_notice)
    await send("giraff", warning)
    await driver.settle(bridge)
    monkeypatch.setattr(protocol, "decode_notice", right)
    await send("giraff", warning)
    await driver.expect("session/turn_warning")


# --- a query of one page does not delay the others ------------------------------------------------


async def test_slow_query_of_one_page_does_not_delay_the_others(page, bob, monkeypatch):
    slow, called, may_go_on = held(store.take)
    await page.expect("hello")
    monkeypatch.setattr(store, "take", slow)
    await page.say("session/take", protocol.Take())
    assert await asyncio.to_thread(called.wait, patient(10))
    async with Page("giraff", bob) as other:
        await other.expect("hello")
        await other.observe()
    may_go_on.set()
    await page.expect("session/granted")


async def page_of(kind, robot, user):
    if kind == "display":
        return Display(await sync_to_async(make_screen_key)(robot, timezone.now()))
    return (Page if kind == "page" else Console)("giraff", user)


@pytest.mark.parametrize("kind", ["page", "display", "console"])
async def test_socket_is_accepted_when_the_database_has_answered(
    bridge, robot, ada, monkeypatch, kind
):
    monkeypatch.setattr(operators, "_providers", [Operators()])
    where, name = {
        "page": (queries, "enter"),
        "display": (Robot.objects, "filter"),
        "console": (Operators, "may_operate"),
    }[kind]
    page = await page_of(kind, robot, ada)
    slow, called, may_go_on = held(getattr(where, name))
    monkeypatch.setattr(where, name, slow)
    opening = asyncio.create_task(page.open())
    assert await asyncio.to_thread(called.wait, patient(10))
    await asyncio.wait({opening}, timeout=0.2)
    assert not opening.done()
    may_go_on.set()
    assert await opening
    await page.close()


async def test_page_is_refused_while_the_database_is_unavailable(bridge, ada, monkeypatch):
    monkeypatch.setattr(queries, "enter", raising(OperationalError("away")))
    assert not await Page("giraff", ada).open()
    monkeypatch.undo()
    async with Page("giraff", ada) as page:
        await page.expect("hello")


# --- servers for video ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["page", "display", "console"])
async def test_offer_of_an_old_page_carries_valid_credentials(
    bridge, robot, ada, monkeypatch, settings, kind
):
    settings.TURN_URLS, settings.TURN_SECRET = ["turn:turn.example.org"], "secret"
    monkeypatch.setattr(operators, "_providers", [Operators()])
    page = await page_of(kind, robot, ada)
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


async def test_more_offers_than_a_page_needs_are_refused(bridge, page):
    await page.observe()
    for _ in range(40):
        await page.say("signal", m.SdpOffer(sdp="v=0"))
    assert await page.denied() == ("signal", "rate")
    await page.say("signal", m.Candidate(candidate="candidate:1", sdp_mid="0"))
    await page.settle(bridge)
    sent = [message for _, _, message in bridge.sent]
    assert 5 <= sum(isinstance(message, m.SdpOffer) for message in sent) <= 12
    assert sum(isinstance(message, m.Candidate) for message in sent) == 1
