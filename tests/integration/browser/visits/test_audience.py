"""Hands and questions on real pages: of two observers, the driver and the robot's screen."""

import re

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from tests.support.media.photographs import keep_at_all_sizes
from tests.support.patience import patient
from tests.support.sessions.site import wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
KEY = """
from django.utils import timezone
from robots.models import Robot
from robots.screens import make_screen_key
print(make_screen_key(Robot.objects.get(name="giraff"), timezone.now()))
"""
ASKED = "What is <b>behind</b> the door, and who has been there since this morning?"
FOCUS = "document.activeElement.id"


@pytest.fixture(scope="module")
def giraff(site):
    return site.start_robot("giraff", "--start", "lab-before-door", "--seed", "3")


def photograph(pages) -> None:
    for name, page in pages.items():
        keep_at_all_sizes(page, f"audience-{name}")


def watches(person):
    person.open()
    person.page.locator("#card-other, #card-main").get_by_text("Watch").click()
    person.wait_for("phase", "watching")
    person.page.get_by_role("button", name="Audience").click()
    return person.page


def asks(page, text) -> None:
    page.get_by_label("Your question").fill(text)
    page.get_by_role("button", name="Send").click()
    expect(page.get_by_label("Your question")).to_have_value("", timeout=patient(10) * 1000)


def test_driver_answers_the_audience_without_losing_the_keys(site, visitor, giraff):
    expect.set_options(timeout=patient(15) * 1000)
    carl = visitor("carl").drive()
    driver = carl.page
    expect(driver.locator("#audience-open")).to_be_hidden()
    dora, eve = watches(visitor("dora")), watches(visitor("eve"))
    screen = carl.context.new_page()
    screen.goto(f"/robots/giraff/screen/#{site.django(KEY).strip()}")

    dora.get_by_role("button", name="Raise hand").click()
    expect(dora.get_by_role("button", name="Lower hand")).to_be_visible()
    asks(dora, ASKED)
    expect(dora.locator("#questions")).to_contain_text("Waiting")
    asks(eve, "Is it cold there?")
    driver.bring_to_front()
    expect(driver.locator("#audience-count")).to_have_text("3")
    said = driver.locator("#audience-said")
    expect(said).to_have_text(re.compile("Audience: .* waiting"), timeout=30_000)
    assert driver.evaluate(FOCUS) != "audience-open"

    driver.get_by_role("button", name="Audience").click()
    panel = driver.locator("#audience-panel")
    expect(panel).to_contain_text("1 hand up: dora")
    expect(panel.locator("li")).to_contain_text([ASKED, "Is it cold there?"])
    assert driver.evaluate(FOCUS) == "viewport"
    for page in (driver, dora):
        assert Axe().run(page).response["violations"] == []
    photograph({"driver": driver, "watcher": dora})

    # The keys drive while the panel is open, and while it changes.
    carl.wait_for("link", "live")
    before = giraff.truth()
    driver.keyboard.down("ArrowLeft")
    panel.locator("li", has_text=ASKED).get_by_role("button", name="Answer now").click()
    carl.hold("ArrowLeft", lambda: abs(giraff.truth().theta - before.theta) > 0.1, 15, "a turn")
    driver.keyboard.up("ArrowLeft")
    assert driver.evaluate(FOCUS) == "viewport"
    for page in (dora, eve, driver, screen):
        expect(page.locator("#asked-text")).to_have_text(ASKED)
    expect(eve.locator("body")).not_to_contain_text("dora")
    expect(dora.locator("#questions")).to_contain_text("Being answered")
    photograph({"driver-answering": driver, "watcher-answering": eve, "screen": screen})

    panel.locator("li", has_text="cold").get_by_role("button", name="Dismiss").click()
    expect(eve.locator("#questions")).to_contain_text("Declined")
    panel.locator("li", has_text=ASKED).get_by_role("button", name="Answered").click()
    expect(screen.locator("#asked")).to_be_hidden()
    expect(dora.locator("#questions")).to_contain_text("Answered")
    panel.get_by_role("button", name="Lower all hands").click()
    expect(dora.get_by_role("button", name="Raise hand")).to_be_visible()
    dora.get_by_label("Your question").fill("wasd ")
    assert dora.get_by_label("Your question").input_value() == "wasd "
    carl.leave()
    expect(dora.locator("#audience-open")).to_be_hidden()
    wait_for(lambda: not carl.problems, 1, "no complaints")
