"""The scenes of drives: generators that lead a page from scene to scene, and yield their names."""

import time
from collections.abc import AsyncIterator
from typing import Any

from playwright.async_api import Page

from robots.agent.safety.permissions import CommandSender
from robots.api import messages as m
from sessions import protocol
from tests.support.agents.told_task import tell
from tests.support.browsers.drive_page import actions, driving
from tests.support.browsers.fake_robot_page import PRACTICE
from tests.support.browsers.present_robot_page import PresentRobotPage
from tests.support.paths import ROOT
from tests.support.patience import PRESSED, until

Scenes = AsyncIterator[str]
FREE = {"state": "available", "drives": True, "url": PRACTICE}  # as in the landing page's list


async def drives(page: Page, site: PresentRobotPage, address: str) -> Scenes:
    """Drive with an audience, send the robot to a goal and to its station, talk, and be stopped."""
    await page.goto(f"{address}?go=1")
    await driving(page)
    yield "driving"
    watched(site)
    await page.wait_for_selector("#audience-count:not([hidden])")
    yield "audience"
    await page.click("#audience-open")
    yield "audience panel"
    await page.click("#audience-open")
    await page.click("#map")
    await page.wait_for_selector("#aim-main:not([hidden])")
    yield "goal"
    await page.click("#aim-main")
    await under_way(site, m.Goto)
    await page.wait_for_selector("#offer-progress:not([hidden])")
    yield "on its way"
    await page.click("[data-action=map_large]")
    yield "on its way, large map"
    await page.click("#places-toggle")
    yield "places, large map"
    await page.click("#places-toggle")
    await page.click("[data-action=map_large]")
    await chats(page, site)
    yield "on its way, chat"
    answered(site, m.Goto, "FAILED", "no_path")
    # A low window has no room for it beside the chat.
    await page.wait_for_selector("#offer-other:not([hidden])", state="attached")
    yield "failed, chat"
    await page.click("#presence-talk")
    yield "failed"
    await page.click("#offer-other")
    await chats(page, site)
    yield "chat"
    await page.click("#presence-talk")
    await page.click("#places-toggle")
    yield "places"
    await page.click("[data-action=go_home]")
    await under_way(site, m.Dock)
    await page.wait_for_selector("#offer-progress:not([hidden])")
    yield "docking"
    stopped(site)
    await page.wait_for_selector(".alert[data-word='alert.estop_screen']")
    yield "stopped"
    await page.evaluate("document.getElementById('leave').click()")
    await page.wait_for_selector("#card[data-card=leaving]")
    yield "stopped, asked whether to leave"
    await page.click("#card-other")
    await chats(page, site)
    yield "stopped, chat"


async def leaves_the_station(page: Page, site: PresentRobotPage, address: str) -> Scenes:
    await page.goto(f"{address}?go=1")
    await driving(page)
    yield "docked"
    await chats(page, site)
    yield "docked, chat"
    site.tell("session/asked_there", protocol.PresenceAsked(session=site.session, seconds=500.0))
    await page.wait_for_selector("#card[data-card=idle]")
    yield "asked whether still there"


async def opens_panels(page: Page, site: PresentRobotPage, address: str) -> Scenes:
    """Open each panel while driving, and close it with Escape; then watch a robot that is free."""
    await page.goto(f"{address}?go=1")
    await driving(page)
    for button, panel in (("#help-open", "#help"), ("#presence-volumes", "#volumes")):
        await page.click(button)
        await page.wait_for_selector(f"{panel}:not([hidden])")
        yield panel.removeprefix("#")
        await escapes(page, panel)
    await page.click("#presence-photo")
    await until(lambda: actions(site, m.Photo))
    image = (ROOT / "static/img/screens/drive-wide.webp").read_bytes()
    site.photos[actions(site, m.Photo)[-1].action_id] = image
    await page.wait_for_selector("#kept-download:not([hidden])")
    yield "photo"
    await page.click("#presence-knock")
    await page.wait_for_selector("#knock-note:not([hidden])")
    yield "photo, knock"
    await page.click("#presence-volumes")
    await page.wait_for_selector("#kept", state="hidden")
    yield "photo, volumes"
    await escapes(page, "#volumes")
    await escapes(page, "#kept")
    await page.click("#presence-camera")
    await page.wait_for_selector("#self:not([hidden])")
    yield "camera"
    site.end("completed")
    await page.wait_for_selector("#card[data-card^=ended]")
    await page.goto(address)
    await page.click("#card-other")
    await page.wait_for_selector("#offer-main[data-action=drive]")
    yield "watching a free robot"
    await page.click("#offer-main")
    await driving(page)


async def escapes(page: Page, panel: str) -> None:
    await page.wait_for_selector(f"{panel}:not([hidden])")
    await page.keyboard.press("Escape")
    await page.wait_for_selector(panel, state="hidden")


async def does_a_task(page: Page, site: PresentRobotPage, address: str) -> Scenes:
    """Be led through a study's task, with a call to the people there."""
    checkpoint: dict[str, Any] = {"number": 2, "x": 8.4, "y": 1.0, "passed": (1,)}
    await page.goto(f"{address}?go=1")
    await driving(page)
    tell(site, "go_to_checkpoint", remaining=119.0, **checkpoint)
    await page.wait_for_selector(
        "#task:not([hidden]) .task__stop[data-status=next]", state="attached"
    )
    yield "task"
    await page.click("[data-action=map_large]")
    yield "task, large map"
    await page.click("[data-action=map_large]")
    await opens_the_task(page)
    yield "task, opened"
    await page.click("[data-action=map_large]")
    yield "task, opened, large map"
    await opens_the_task(page)
    yield "task, large map, opened"
    await page.click("[data-action=map_large]")
    await page.evaluate("document.getElementById('task').removeAttribute('data-open')")
    await page.click("#presence-mic")
    await page.wait_for_selector("#presence-hang-up:not([hidden])")
    yield "task, call"
    await chats(page, site)
    yield "task, call, chat"
    await page.click("#presence-talk")
    tell(site, "photo_ready", remaining=119.0, window="open", **checkpoint)
    await page.wait_for_selector("#photo:not([hidden])")
    yield "task, call, photo"


async def opens_the_task(page: Page) -> None:
    """Open the line of the task, which is always open in a wide window."""
    await page.evaluate("document.getElementById('task').setAttribute('data-open', '')")


async def waits(page: Page, site: PresentRobotPage, address: str) -> Scenes:
    """Visit the lobby, wait while another visitor drives and during an emergency stop, and be
    offered the robot.
    """
    await page.goto(address)
    await page.wait_for_selector("#card[data-card=lobby]")
    yield "lobby"
    stopped(site)
    await page.wait_for_selector("#card[data-card='lobby.estop_there']")
    yield "lobby, stopped"
    site.do(site.kernel.clear_estop, time.monotonic())
    site.errors = ("adapter_lost: MoosError",)
    await page.wait_for_selector("#card[data-card='lobby.not_connected']")
    yield "lobby, fault"
    site.errors = ()
    site.practice = {"url": PRACTICE}
    other, screen = await page.context.new_page(), await page.context.new_page()
    await other.goto(f"{site.url}?go=1")
    await driving(other)
    await screen.goto(site.screen_url)
    await page.wait_for_selector("#card[data-card='lobby.busy']")
    yield "lobby, busy"
    await page.bring_to_front()
    await page.click("#card-main")
    await page.wait_for_selector("#drive-page[data-playing][data-phase=queued]")
    yield "queued"
    site.others = [{**FREE, "name": name, "action": f"Drive {name}"} for name in ("Rhodon", "Pepe")]
    site.keep_waiting("paused: before_dock")
    await page.wait_for_selector("#card[data-card='queued.paused'] #card-instead > a")
    yield "queued, others are free"
    site.others = []
    await page.wait_for_selector("#card-instead", state="hidden")
    site.faults = (protocol.Fault(part="session_manager", then="stopped"),)
    await page.wait_for_selector("#card-warning[data-word='fault.session_manager.waits']")
    yield "queued, the server has a problem"
    site.faults = ()
    await page.wait_for_selector("#card-warning", state="hidden")
    stopped(site)
    site.keep_waiting("paused: estop")
    await page.wait_for_selector("#presence-talk:not([hidden])")
    yield "queued, stopped"
    await chats(page, site)
    yield "queued, stopped, chat"
    await page.wait_for_timeout(1000 * PRESSED)
    site.offer_turn(500.0)
    await page.wait_for_selector("#card[data-card=turn]")
    yield "turn"


async def is_a_screen(page: Page, site: PresentRobotPage, address: str) -> Scenes:
    """Be the robot's own screen in a study: with a visitor, a question of the audience, messages,
    and after its stop was pressed.
    """
    site.is_study = True
    visitor = await page.context.new_page()
    await visitor.goto(f"{site.url}?go=1")
    await driving(visitor)
    await page.bring_to_front()
    await page.goto(f"{address}-screen" if address.endswith("spanish") else site.screen_url)
    await page.wait_for_selector("#face[data-scene=visiting][data-live]")
    yield "visited"
    text = "How old is the painting at the end of the corridor? We see only half of it from here."
    asked = protocol.AudienceQuestion(id="q1", text=text, state="answering")
    site.tell_screens("audience", protocol.AudienceState(open=True, questions=(asked,)))
    await page.wait_for_selector("#asked:not([hidden])")
    yield "question"
    site.tell("words", written(site, "Hello! May I come in?"))
    await page.wait_for_selector("#messages > li")
    await page.click("#stop")
    await page.wait_for_selector("#release:not([hidden])")
    yield "question, stopped"
    await page.click("#release")
    yield "question, to be released"


def watched(site: PresentRobotPage) -> None:
    """Have two observers with raised hands, one of whom has asked."""
    text = "How old is the painting at the end of the corridor?"
    asked = protocol.AudienceQuestion(id="q1", text=text, state="waiting")
    hands = protocol.AudienceState(
        open=True, moderates=True, hands=2, names=("Dora", "Eve"), questions=(asked,)
    )
    site.tell("room", protocol.RoomState(driver="Ana", driving=True, observers=2))
    site.tell("audience", hands)


async def chats(page: Page, site: PresentRobotPage) -> None:
    """Open the chat, with two messages from the robot's screen."""
    if await page.locator("#talk-list > li").count() == 0:
        for text in ("Hello! Come in, the door is open.", "We are in the room on the left."):
            site.tell("words", written(site, text))
    await page.click("#presence-talk")
    await page.wait_for_selector("#talk-field")


def written(site: PresentRobotPage, text: str) -> m.Words:
    return m.Words(
        stamp=time.time(),
        action_id=f"say-{len(text)}",
        session=site.session,
        by="screen",
        who="Front desk",
        text=text,
    )


def stopped(site: PresentRobotPage) -> None:
    """Press stop on the robot's screen."""
    action = m.EStop(action_id=f"stop-{time.time()}", stamp=time.time(), role="screen")
    times = {"now": time.monotonic(), "unix": time.time()}
    site.do(lambda: site.kernel.estop(action, CommandSender("mqtt"), **times))


async def under_way(site: PresentRobotPage, kind: type[m.Action]) -> None:
    """Let the robot begin the action that the page requests."""
    await until(lambda: actions(site, kind))
    answered(site, kind, "RUNNING")


def answered(site: PresentRobotPage, kind: type[m.Action], status: Any, reason: str = "") -> None:
    news = m.ActionStatus(
        action_id=actions(site, kind)[-1].action_id,
        status=status,
        stamp=time.time(),
        type=kind.__name__.lower(),
        reason=reason,
        result={"progress": 0.4},
    )
    site.tell("action", news)
