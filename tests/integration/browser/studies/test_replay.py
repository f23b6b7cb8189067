"""Replay and live view in a real Chromium: the marker is where the states say, by slider, strip,
key, finger and play.
"""

import datetime
import math
import re

import pytest
from django.test import Client
from django.urls import reverse
from django.utils import timezone
from playwright.sync_api import expect

from experiments.research.replay import replay
from robots.models import Robot
from sessions.models import Session, StateChunk
from tests.support.media.photographs import keep
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.sessions.site import wait_for

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]
SIZES = {"desktop": {"width": 1280, "height": 800}, "phone": {"width": 390, "height": 844}}
ANYTHING = re.compile(".")


@pytest.fixture(params=SIZES)
def page(browser, live_server, request):
    client = Client()
    client.force_login(person("owner", is_superuser=True, is_staff=True))
    touch = request.param == "phone"
    context = browser.new_context(
        base_url=live_server.url,
        locale="en",
        viewport=SIZES[request.param],
        has_touch=touch,
        is_mobile=touch,
    )
    context.add_cookies(
        [{"name": "sessionid", "value": client.cookies["sessionid"].value, "url": live_server.url}]
    )
    page = context.new_page()
    page.size = request.param
    page.problems = []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    page.on(
        "console",
        lambda message: (
            page.problems.append(message.text)
            if "Content Security Policy" in message.text
            else None
        ),
    )
    yield page
    context.close()
    assert page.problems == []


def made(seconds: int = 60):
    visit = replays.session(replays.cabin_robot(), person("ada"), seconds=seconds)
    replays.record(visit, seconds=seconds)
    drive = replays.drive(
        replays.participant(replays.study(), visit.visitor), visit, outcome="completed"
    )
    replays.task_told(drive, 1.0, "task_started")
    replays.task_told(drive, 2.0, "checkpoint", number=1)
    replays.told(visit, seconds / 2, "collision", detail="front")
    replays.told(visit, seconds / 2 + 1.0, "map", source="page", open=True)
    return visit


def marker(page) -> tuple[float, float, float]:
    """Where the map's canvas says the robot was drawn, in CSS pixels, and for which moment, as soon
    as it is drawn at all.
    """
    expect(page.locator("#replay-map")).to_have_attribute("data-marker-t", ANYTHING)
    data = page.evaluate("({...document.getElementById('replay-map').dataset})")
    return float(data["markerX"]), float(data["markerY"]), float(data["markerT"])


def assert_is_where_it_was(page, t: float, within: float = 0.05) -> None:
    """A moment is drawn with the browser's next frame."""
    wait_for(lambda: abs(marker(page)[2] - t) <= within, 5, f"the moment {t}")
    assert_is_where_it_says(page)


def assert_is_where_it_says(page) -> None:
    """The cabin is fitted into the canvas as view/map/transform.js does it; the robot drives a
    circle.
    """
    x, y, at = marker(page)
    box = page.evaluate(
        "(({clientWidth, clientHeight}) => [clientWidth,"
        " clientHeight])(document.getElementById('replay-map'))"
    )
    scale = min((box[0] - 24) / 8.0, (box[1] - 24) / 4.0)
    true_x, true_y, _ = replays.place(at)
    assert (x, y) == pytest.approx(
        (box[0] / 2 + (true_x - 4.0) * scale, box[1] / 2 - (true_y - 2.0) * scale), abs=1.5
    )


def shot(page, name: str) -> None:
    keep(page, f"{name}-{page.size}", whole=True)


@pytest.mark.nightly
def test_the_robot_is_shown_where_the_states_say_however_one_gets_there(page):
    visit = made()
    page.goto(reverse("replay", args=[visit.pk]) + "?t=12.5")
    expect(page.locator("#replay")).to_have_attribute("data-state", "ready")
    assert_is_where_it_was(page, 12.5)
    shot(page, "replay")
    page.get_by_role("slider", name="Playback position").fill("33.1")
    assert_is_where_it_was(page, 33.1)
    strips = page.locator("#strips")
    box = strips.bounding_box()
    if page.size == "phone":
        strips.tap(position={"x": box["width"] / 2, "y": 40})
    else:
        strips.click(position={"x": box["width"] / 2, "y": 40})
    assert_is_where_it_was(page, 30.0, within=0.3)
    page.get_by_role("slider", name="Playback position").press("Home")
    page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("ArrowRight")
    assert_is_where_it_was(page, 11.0, within=0.001)
    page.get_by_role("button", name="collision").click()
    assert_is_where_it_was(page, 30.0, within=0.001)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_the_record_is_asked_for_once_and_what_was_preloaded_is_used(page, monkeypatch):
    made_of = []
    monkeypatch.setattr(
        "experiments.research.views.replay", lambda *given: made_of.append(given) or replay(*given)
    )
    said = []
    page.on("console", lambda message: said.append(message.text))
    page.goto(reverse("replay", args=[made().pk]))
    expect(page.locator("#replay")).to_have_attribute("data-state", "ready")
    page.goto(reverse("replay", args=[Session.objects.get().pk]))
    expect(page.locator("#replay")).to_have_attribute("data-state", "ready")
    assert len(made_of) == 2  # once for each time that the page was opened
    assert not [text for text in said if "preload" in text]


def test_it_plays_at_its_speed_to_the_end_and_again(page):
    """What is clicked while it plays has a minute for it; only the end is waited for at four times
    its speed.
    """
    visit = made(60)
    page.goto(reverse("replay", args=[visit.pk]))
    expect(page.locator("#replay")).to_have_attribute("data-state", "ready")
    page.get_by_role("button", name="Play").click()
    page.locator("body").press("Space")
    expect(page.get_by_role("button", name="Play")).to_be_visible()
    assert 0.0 <= marker(page)[2] < 60.0
    assert_is_where_it_says(page)
    page.get_by_role("slider", name="Playback position").fill("54")
    page.get_by_label("Playback speed").select_option("4")
    page.get_by_role("button", name="Play").click()
    expect(page.locator("#clock")).to_have_text("1:00.0 / 1:00", timeout=40_000)
    expect(page.get_by_role("button", name="Play")).to_be_visible()
    page.get_by_label("Playback speed").select_option("1")
    page.locator("body").press("Space")
    page.get_by_role("button", name="Pause").click()
    assert marker(page)[2] < 60.0
    assert_is_where_it_says(page)


def test_events_are_filtered_by_who_tells_them(page):
    page.goto(reverse("replay", args=[made().pk]))
    expect(page.get_by_role("button", name="collision")).to_be_visible()
    page.get_by_label("robot", exact=True).uncheck()
    expect(page.get_by_role("button", name="collision")).to_be_hidden()
    expect(page.get_by_role("button", name="checkpoint")).to_be_visible()


def test_a_session_without_states_says_so_and_one_that_cannot_be_loaded_too(page):
    visit = made()
    StateChunk.objects.all().delete()
    page.goto(reverse("replay", args=[visit.pk]))
    expect(page.get_by_text("No robot states were recorded")).to_be_visible()
    page.route("**/*.json", lambda route: route.abort())
    page.reload()
    expect(page.get_by_text("The session data didn't load.")).to_be_visible()


@pytest.mark.nightly
def test_the_live_view_follows_the_robot_and_says_when_it_has_no_news(page):
    report = {
        "stamp": 5.0,
        "pose": {"x": 1.0, "y": 2.0, "theta": 0.0},
        "battery": {"charge": 0.7},
        "docked": True,
    }
    heard = timezone.now() + datetime.timedelta(hours=1)  # for longer than any page takes to load
    robot = replays.cabin_robot(connection="ONLINE", last_seen_at=heard, report=report)
    study = replays.study()
    page.goto(reverse("study_live", args=[study.slug]))
    card = page.locator("[data-robot=giraff]")
    expect(card).to_contain_text("nobody")
    expect(card).to_contain_text("70 %")
    visit = replays.session(
        robot, person("ada"), granted=timezone.now() - datetime.timedelta(seconds=8)
    )
    replays.record(visit, seconds=8)
    drive = replays.drive(replays.participant(study, visit.visitor), visit)
    replays.task_told(drive, 1.0, "task_started")
    replays.task_told(drive, 2.0, "cue", name="go_to_checkpoint", number=1)
    expect(card).to_contain_text(drive.participant.code, timeout=40_000)
    expect(card).to_contain_text("next: go to checkpoint 1")
    canvas = card.locator("canvas")
    expect(canvas).to_have_attribute("data-stops", "1:next 2:later 0:later")
    expect(canvas).to_have_attribute("data-trail", str(visit.pk))  # what was driven before
    x, _y, _ = replays.place(7.75)

    def is_drawn_there() -> bool:
        marker, width, height = card.locator("canvas").evaluate(
            "canvas => [Number(canvas.dataset.markerX), canvas.clientWidth, canvas.clientHeight]"
        )
        return math.isclose(
            marker,
            width / 2 + (x - 4.0) * min((width - 24) / 8.0, (height - 24) / 4.0),
            abs_tol=1.5,
        )

    # the words come first, and may change the map's size
    wait_for(is_drawn_there, 5, "the marker where the robot is")
    shot(page, "live")
    card.get_by_label("Message or reason").fill("a new carpet")
    card.get_by_role("button", name="Pause visits").click()
    expect(card).to_contain_text("visits paused: a new carpet", timeout=40_000)
    assert Robot.objects.get().held == "a new carpet"
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.route("**/live.json", lambda route: route.abort())
    expect(page.get_by_text("The server can't be reached")).to_be_visible(timeout=40_000)
    page.unroute("**/live.json")
    expect(page.get_by_text("The server can't be reached")).to_be_hidden(timeout=40_000)
