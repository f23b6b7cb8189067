"""A hidden operator's socket when something fails."""

import asyncio
import time

import pytest
from asgiref.sync import sync_to_async
from channels.layers import get_channel_layer
from django.contrib.auth import get_user_model
from django.db import OperationalError

from robots.api import messages as m
from sessions import page_channel, protocol as pages
from sessions.consumers import robot_page
from sessions.leases.terms import Terms
from sessions.models import Lease, SessionEvent
from sessions.wizard import leases, operators, protocol
from sessions.wizard.script import Script, ScriptStage, ScriptStep
from tests.support import words
from tests.support.browsers.pages import SECONDS, Page
from tests.support.browsers.wizard_console import Console, Operators
from tests.support.patience import patient, until
from tests.support.studies.fixed_terms import provided

pytestmark = pytest.mark.django_db(transaction=True)
AT_ONCE = 5.0  # s; without an order, a page checks once a minute
STEPS = (
    ScriptStep(key="hello", title="Greet", text="Hello"),
    ScriptStep(key="home", title="Dock", action="dock"),
)
STAGES = (ScriptStage(key="all", title="All", steps=STEPS),)


@pytest.fixture(autouse=True)
def provider(monkeypatch):
    script = Script(language="en", stages=STAGES, participant_view=True)
    provider = Operators(script, users=set())
    monkeypatch.setattr(operators, "_providers", [provider])
    with provided() as terms:
        terms.terms = Terms(driver="wizard", controllers=())
        yield provider


@pytest.fixture
def operator(provider):
    user = get_user_model().objects.create_user("operator", password="x")
    provider.users.add(user.pk)
    return user


@pytest.fixture
async def console(driver, operator):
    """The operator's console, which operates the session of Ada's page."""
    async with Console("giraff", operator) as console:
        await console.operate()
        yield console


def begin(key, action_id="a1"):
    return protocol.BeginStep(step=key, action_id=action_id, stamp=1.0)


def velocity(seq, linear=0.2):
    return m.VelocityCommand(
        session="x", epoch=0, seq=seq, stamp=1.0, linear=linear, angular=0.0, method="keyboard"
    )


@sync_to_async
def events(kind):
    return list(SessionEvent.objects.filter(type=kind).values_list("data", flat=True))


async def recorded(kind, count=1):
    async with asyncio.timeout(patient(SECONDS)):
        while len(found := await events(kind)) < count:
            await asyncio.sleep(0.01)
    return found


async def test_console_without_login_is_refused(bridge):
    console = Console("giraff")
    await console.open()
    assert await console.closed() == pages.SIGNED_OUT
    assert console.seen == []


async def test_operator_who_stops_operating_cannot_drive_and_may_stop_twice(bridge, console):
    for _ in range(2):
        await console.say("wizard/release", protocol.StopOperating())
    await console.expect("wizard/session", lambda scene: not scene.operator)
    assert bridge.leases[-1][1].driver is None
    await console.say("wizard/step", begin("hello"))
    assert (await console.expect("wizard/begun")).reason == "not_driver"
    line = protocol.FreeLine(text="Mm", action_id="a2", stamp=1.0)
    await console.say("wizard/line", line)
    assert (await console.expect("wizard/begun")).reason == "observer"
    await console.say("wizard/reached", protocol.Reached(action_id="a1", latency=0.1))
    await console.settle(bridge)
    assert bridge.commands("command/action") == []
    assert len(await events("wizard_left")) == 1
    for kind in ("wizard_step", "wizard_line", "wizard_reached", "wizard_lost"):
        assert await events(kind) == []


async def test_console_closes_at_once_when_its_user_may_no_longer_operate(
    bridge, console, operator, provider
):
    group = page_channel.visitor_group(operator.pk)
    await until(lambda: get_channel_layer().groups.get(group))
    await sync_to_async(page_channel.check_pages)(group)
    await console.settle(bridge)
    provider.users.remove(operator.pk)
    await sync_to_async(page_channel.check_pages)(group)
    async with asyncio.timeout(patient(AT_ONCE)):
        assert await console.closed() == pages.NOT_ALLOWED


async def test_step_that_the_script_does_not_have_is_refused(bridge, console):
    await console.say("wizard/step", begin("nonsense"))
    assert (await console.expect("wizard/begun")).reason == "unknown"


async def test_ended_session_cannot_be_taken_over(bridge, robot, ada, operator):
    async with Console("giraff", operator) as console:
        await console.expect("wizard/session", lambda scene: scene.session is None)
        await console.say("wizard/take", protocol.TakeOver(session="gone"))
        assert (await console.expect("wizard/lost")).reason == "ended"


async def test_reloaded_console_shows_the_steps_that_were_begun(console, operator):
    await console.say("wizard/step", begin("hello"))
    await recorded("wizard_step")
    await console.close()
    async with Console("giraff", operator) as again:
        scene, _ = await again.operate()
        assert scene.done == ("hello",)
        await again.say("wizard/step", begin("hello", "a2"))
        assert (await again.expect("wizard/begun")).deviation == "repeated"


async def test_repeating_a_step_that_did_not_reach_the_robot_is_no_deviation(
    bridge, console, operator
):
    bridge.say("giraff", "connection", words.broken(), stored=True)
    for key in ("hello", "home"):
        await console.say("wizard/step", begin(key))
        assert (await console.expect("wizard/begun")).reason == "robot_unreachable"
    bridge.say("giraff", "connection", words.online(), stored=True)
    await console.say("wizard/step", begin("hello", "a2"))
    begun = await console.expect("wizard/begun")
    assert (begun.reason, begun.deviation) == ("", "")
    await recorded("wizard_step", 3)
    await console.close()
    async with Console("giraff", operator) as again:
        scene, _ = await again.operate()
        assert scene.done == ("hello",)


async def test_console_shows_robot_server_and_the_participants_cue(bridge, driver, console):
    bridge.delivery.bring_notice(driver.granted.session, "no notice at all")
    bridge.notify(
        pages.OperatorMessage(session=driver.granted.session, text="for the participant alone")
    )
    bridge.notify(pages.Task(session=driver.granted.session, stamp=1.0, cue="dock_now"))
    assert (await console.expect("wizard/participant")).cue == "dock_now"
    bridge.say("giraff", "connection", words.broken())
    assert not (await console.expect("robot")).online
    bridge.delivery.bring_faults(time.monotonic())
    await console.expect("server/status")
    assert "for the participant" not in "".join(console.frames)


@pytest.fixture
def hiding(provider):
    provider.script = Script(language="en")


async def test_script_that_hides_the_participants_page_shows_no_cue(
    bridge, hiding, driver, console
):
    bridge.notify(pages.Task(session=driver.granted.session, stamp=1.0, cue="dock_now"))
    bridge.say("giraff", "connection", words.broken())
    await console.expect("robot", lambda robot: not robot.online)
    assert console.told("wizard/participant") == []


async def test_older_copy_of_the_lease_ends_no_operating_and_an_empty_lease_does(
    bridge, robot, ada, operator
):
    async with Page("giraff", ada) as page, Console("giraff", operator) as console:
        await page.take()
        older = bridge.leases[-1][1]
        await console.operate()
        newest = bridge.leases[-1][1]
        bridge.publish_lease("giraff", older)
        bridge.publish_lease("giraff", newest)
        await console.say("wizard/step", begin("hello"))
        assert (await console.expect("wizard/begun")).reason == ""
        assert console.told("wizard/lost") == []
        bridge.publish_lease("giraff", None)
        assert (await console.expect("wizard/lost")).reason == "ended"


async def test_step_is_performed_although_it_cannot_be_recorded(
    bridge, console, monkeypatch, caplog
):
    def fail(*_, **__):
        raise OperationalError("the database is unavailable")

    await recorded("wizard_took")
    with monkeypatch.context() as patched:
        patched.setattr(leases, "note", fail)
        await console.say("wizard/step", begin("hello"))
        assert (await console.expect("wizard/begun")).reason == ""
        await until(lambda: "wizard_not_recorded" in caplog.text)
    (spoken,) = bridge.commands("command/action")
    assert spoken.text == "Hello"
    await console.say("wizard/step", begin("home", "a2"))
    assert (await recorded("wizard_step"))[0]["step"] == "home"


async def test_driving_by_hand_is_recorded_once_and_zero_velocity_is_no_driving(bridge, console):
    await console.say("command/velocity", velocity(1, linear=0.0))
    await console.settle(bridge)
    assert await events("wizard_by_hand") == []
    for seq in (2, 3, 4):
        await console.say("command/velocity", velocity(seq))
    await until(lambda: len(bridge.commands()) == 4)
    await recorded("wizard_by_hand")
    assert len(await events("wizard_by_hand")) == 1


async def test_console_of_a_former_operator_closes_within_a_minute(
    bridge, robot, ada, operator, provider, monkeypatch
):
    monkeypatch.setattr(robot_page, "WELCOME_EVERY", 0.0)
    async with Page("giraff", ada) as page, Console("giraff", operator) as console:
        await page.take()
        await console.operate()
        signal = f"signal/{console.told('wizard/hello')[0].peer}"
        await until(lambda: m.Stay() in bridge.commands(signal))
        provider.users.clear()
        bridge.publish_lease("giraff", bridge.leases[-1][1])  # any message triggers a check
        assert await console.closed() == pages.NOT_ALLOWED


async def test_closing_a_console_leaves_the_lease_to_the_console_that_took_over(bridge, console):
    # of another web process, whose lease has not yet reached this one
    await Lease.objects.aupdate(wizard_peer="another-page")
    published = len(bridge.leases)
    await console.close()
    assert len(bridge.leases) == published
    assert (await Lease.objects.aget()).wizard_peer == "another-page"
    assert await events("wizard_lost") == []
