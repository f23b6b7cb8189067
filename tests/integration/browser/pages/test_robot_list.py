"""The landing page in a real Chromium: cards update by themselves, and menu and forms work by
keyboard.
"""

import re

import pytest
from django.urls import reverse
from django.utils import timezone
from playwright.sync_api import expect

from accounts.models import User
from robots.models import Robot, RobotPresence
from sessions.models import Session
from tests.support.people import PASSWORD, person
from tests.support.robots import online_robot

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]


@pytest.fixture
def page(open_page):
    return open_page(viewport={"width": 390, "height": 844})


@pytest.fixture
def giraff():
    return online_robot(report={"battery": {"charge": 0.5}})


def later(page, milliseconds: int = 5100) -> None:
    with page.expect_response("**/robots.json*"):
        page.clock.run_for(milliseconds)


def test_card_follows_its_robot_without_a_reload(page, giraff):
    page.clock.install()
    page.goto("/")
    card = page.locator("[data-robot=giraff]")
    expect(card).to_contain_text("Free now")
    session = Session.objects.create(
        robot=giraff,
        visitor=person("driver"),
        state="driving",
        live_key="x",
        queued_at=timezone.now(),
    )
    RobotPresence.objects.update(report={"battery": {"charge": 0.25}})
    page.evaluate("window.sameDocument = true")
    later(page)
    expect(card).to_have_attribute("data-state", "busy")
    expect(card).to_contain_text("Join the queue")
    expect(card).to_contain_text("25 %")
    Session.objects.filter(pk=session.pk).update(state="ended")
    RobotPresence.objects.update(connection="OFFLINE")
    later(page)
    expect(card).to_contain_text("Offline")
    expect(card.locator("meter")).to_be_hidden()
    assert page.evaluate("window.sameDocument")


def test_new_robot_appears(page, giraff):
    page.clock.install()
    page.goto("/")
    Robot.objects.create(name="rhodon", title="Rhodon")
    later(page)
    expect(page.locator("[data-robot=rhodon]")).to_be_visible()


def test_invitation_follows_the_robots_without_a_reload(page, giraff):
    RobotPresence.objects.update(connection="OFFLINE")
    page.clock.install()
    page.goto("/")
    invitation = page.locator("[data-invitation]").get_by_role("link")
    expect(invitation).to_have_text("See the robots")
    RobotPresence.objects.update(connection="ONLINE")
    later(page)
    expect(invitation).to_have_text("Sign up and drive")
    expect(invitation).to_have_attribute("href", re.compile("/robots/giraff/|robots%2Fgiraff"))
    RobotPresence.objects.update(connection="OFFLINE")
    later(page)
    expect(invitation).to_have_attribute("href", "#robots")


def test_lost_connection_is_shown_until_it_is_back(page, giraff):
    page.clock.install()
    page.goto("/")
    page.route("**/robots.json*", lambda route: route.abort())
    page.clock.run_for(5100)
    expect(page.get_by_text("Connection lost.")).to_be_visible()
    page.unroute("**/robots.json*")
    later(page)
    expect(page.get_by_text("Connection lost.")).to_be_hidden()


def test_sign_up_needs_only_the_keyboard(page, giraff):
    page.goto(f"{reverse('account_signup')}?next={reverse('about')}")
    page.locator("#id_username").focus()
    for text in ("ada", "Ada Lovelace", "ada@example.org", PASSWORD):
        page.keyboard.type(text)
        page.keyboard.press("Tab")
    expect(page.get_by_role("button", name="Show the password")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#id_password1")).to_have_attribute("type", "text")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1)).to_have_text("What we record")
    assert User.objects.get().shown_name == "Ada Lovelace"


def test_menu_closes_with_escape_and_returns_the_focus(page, giraff):
    person()
    page.goto(reverse("account_login"))
    page.fill("#id_login", "ada")
    page.fill("#id_password", PASSWORD)
    # the next page needs its scripts for Escape
    with page.expect_navigation():
        page.get_by_role("button", name="Log in").click()
    menu = page.locator("[data-menu] > summary")
    menu.focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("link", name="Your profile")).to_be_visible()
    page.keyboard.press("Tab")
    page.keyboard.press("Escape")
    expect(page.get_by_role("link", name="Your profile")).to_be_hidden()
    expect(menu).to_be_focused()


@pytest.mark.parametrize("address", ["home", "about", "account_login", "account_signup"])
def test_page_fits_a_phone_and_a_window_at_200_percent(page, giraff, address):
    for width in (390, 320, 640):  # 640 CSS pixels: a window of 1280 at 200 %
        page.set_viewport_size({"width": width, "height": 700})
        page.goto(reverse(address))
        assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("address", ["home", "about", "account_login", "account_signup"])
def test_touch_targets_are_44_pixels_high(page, giraff, address):
    page.goto(reverse(address))
    small = page.evaluate(
        """() => [...document.querySelectorAll("button, .button, .bar__link, .brand, summary"
            + ", input:not([type=hidden], [type=checkbox])")]
            .filter((e) => e.checkVisibility() && e.getBoundingClientRect().height < 43.5)
            .map((e) => `${e.textContent.trim() || e.name} ${e.getBoundingClientRect().height}`)"""
    )
    assert small == []
