"""Replay and live view in a real Chromium: the marker is where the states are, whether by slider,
strip, key, finger or playing.
"""

import datetime
import math
import re

import pytest
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
def page(open_page, request):
    owner, touch = person("owner", is_superuser=True, is_staff=True), request.param == "phone"
    page = open_page(owner, viewport=SIZES[request.param], has_touch=touch, is_mobile=touch)
    page.size = request.param
    return page


def made(seconds: int = 60):
    session = replays.session(replays.cabin_robot(), person("ada"), seconds=seconds)
    replays.record(session, seconds=seconds)
    drive = replays.drive(
        replays.participant(replays.study(), session.visitor), session, outcome="completed"
    )
    replays.task_told(drive, 1.0, "task_started")
    replays.task_told(drive, 2.0, "checkpoint", number=1)
    replays.told(session, seconds / 2, "collision", detail="front")
    replays.told(session, seconds / 2 + 1.0, "map", source="page", open=True)
    return session


def marker(page) -> tuple[float, float, float]:
    """Return where the map has drawn the robot, in CSS pixels, and the moment of that pose."""
    expect(page.locator("#replay-map")).to_have_attribute("data-marker-t", ANYTHING)
    data = page.evaluate("({...document.getElementById('replay-map').dataset})")
    return float(data["markerX"]), float(data["markerY"]), float(data["markerT"])


def assert_is_where_it_was(page, t: float, within: float = 0.05) -> None:
    wait_for(lambda: abs(marker(page)[2] - t) <= within, 5, f"the moment {t}")
    assert_is_where_it_says(page)


def assert_is_where_it_says(page) -> None:
    """The robot drives a circle in the cabin, which fits the canvas (view/map/transform.js)."""
    x, y, at = marker(page)
    size = "map => [map.clientWidth, map.clientHeight]"
    box = page.locator("#replay-map").evaluate(size)
    scale = min((box[0] - 24) / 8.0, (box[1] - 24) / 4.0)
    true_x, true_y, _ = replays.place(at)
    assert (x, y) == pytest.approx(
        (box[0] / 2 + (true_x - 4.0) * scale, box[1] / 2 - (true_y - 2.0) * scale), abs=1.5
    )


def shot(page, name: str) -> None:
    keep(page, f"{name}-{page.size}", whole=True)


@pytest.mark.nightly
def test_robot_is_shown_where_the_states_are_however_one_seeks(page):
    session = made()
    page.goto(reverse("replay", args=[session.pk]) + "?t=12.5")
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


def test_record_is_requested_once_and_preloads_are_used(page, monkeypatch):
    made_of = []
    monkeypatch.setattr(
        "experiments.research.views.replay", lambda *given: made_of.append(given) or replay(*given)
    )
    logged = []
    page.on("console", lambda message: logged.append(message.text))
    page.goto(reverse("replay", args=[made().pk]))
    expect(page.locator("#replay")).to_have_attribute("data-state", "ready")
    page.goto(reverse("replay", args=[Session.objects.get().pk]))
    expect(page.locator("#replay")).to_have_attribute("data-state", "ready")
    assert len(made_of) == 2  # once for each time that the page was opened
    assert not [text for text in logged if "preload" in text]


def test_replay_plays_to_the_end_and_again(page):
    session = made(60)
    page.goto(reverse("replay", args=[session.pk]))
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


def test_events_are_filtered_by_source(page):
    page.goto(reverse("replay", args=[made().pk]))
    expect(page.get_by_role("button", name="collision")).to_be_visible()
    page.get_by_label("robot", exact=True).uncheck()
    expect(page.get_by_role("button", name="collision")).to_be_hidden()
    expect(page.get_by_role("button", name="checkpoint")).to_be_visible()


def test_page_reports_a_session_without_states_or_that_cannot_be_loaded(page):
    session = made()
    StateChunk.objects.all().delete()
    page.goto(reverse("replay", args=[session.pk]))
    expect(page.get_by_text("No robot states were recorded")).to_be_visible()
    page.route("**/*.json", lambda route: route.abort())
    page.reload()
    expect(page.get_by_text("The session data didn't load.")).to_be_visible()


@pytest.mark.nightly
def test_live_view_follows_the_robot_and_reports_a_lost_server(page):
    pose = {"x": 1.0, "y": 2.0, "theta": 0.0}
    report = {"stamp": 5.0, "pose": pose, "battery": {"charge": 0.7}, "docked": True}
    later = timezone.now() + datetime.timedelta(hours=1)  # online for longer than a page loads
    robot = replays.cabin_robot(connection="ONLINE", last_seen_at=later, report=report)
    study = replays.study()
    page.goto(reverse("study_live", args=[study.slug]))
    card = page.locator("[data-robot=giraff]")
    expect(card).to_contain_text("nobody")
    expect(card).to_contain_text("70 %")
    session = replays.session(
        robot, person("ada"), granted=timezone.now() - datetime.timedelta(seconds=8)
    )
    replays.record(session, seconds=8)
    drive = replays.drive(replays.participant(study, session.visitor), session)
    replays.task_told(drive, 1.0, "task_started")
    replays.task_told(drive, 2.0, "cue", name="go_to_checkpoint", number=1)
    expect(card).to_contain_text(drive.participant.code, timeout=40_000)
    expect(card).to_contain_text("next: go to checkpoint 1")
    canvas = card.locator("canvas")
    expect(canvas).to_have_attribute("data-stops", "1:next 2:later 0:later")
    expect(canvas).to_have_attribute("data-trail", str(session.pk))  # of the past
    x, _y, _ = replays.place(7.75)

    def is_drawn_there() -> bool:
        marker, width, height = card.locator("canvas").evaluate(
            "canvas => [Number(canvas.dataset.markerX), canvas.clientWidth, canvas.clientHeight]"
        )
        scale = min((width - 24) / 8.0, (height - 24) / 4.0)
        return math.isclose(marker, width / 2 + (x - 4.0) * scale, abs_tol=1.5)

    # the text is shown first, and may change the map's size
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
