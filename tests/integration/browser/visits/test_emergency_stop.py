"""An emergency stop pressed beside the robot, shown to the driver, and released by a remote
operator.
"""

import pytest
from playwright.sync_api import expect

from tests.support.media.photographs import keep_at_all_sizes
from tests.support.patience import patient

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
SET_UP = """
from django.utils import timezone
from accounts.models import User
from robots.models import Robot, RobotPermit
from robots.screens import make_screen_key
robot = Robot.objects.get(name="giraff")
operator, _ = User.objects.get_or_create(username="olga")
RobotPermit.objects.create(robot=robot, user=operator, kind=RobotPermit.Privilege.OPERATOR)
print(make_screen_key(robot, timezone.now()))
"""
RELEASE = "Release the stop"


@pytest.fixture(scope="module")
def giraff(site):
    return site.start_robot("giraff", "--start", "lab-before-door", "--seed", "3")


def button(page):
    return page.get_by_role("button", name=RELEASE, exact=True)


def test_operator_releases_the_stop_and_the_driver_goes_on(site, visitor, giraff):
    expect.set_options(timeout=patient(15) * 1000)
    key = site.django(SET_UP).strip()
    carl = visitor("carl").drive()
    screen = carl.context.new_page()
    screen.goto(f"/robots/giraff/screen/#{key}")
    olga = visitor("olga")
    olga.open()
    for place in ("lobby", "watching"):
        screen.bring_to_front()
        screen.locator("#stop").click()
        expect(carl.page.locator("#alert")).to_have_attribute("data-word", "alert.estop_screen")
        expect(button(carl.page)).to_be_hidden()
        olga.page.bring_to_front()
        keep_at_all_sizes(olga.page, f"emergency-stop-{place}")
        button(olga.page).click()
        expect(button(olga.page)).to_be_hidden()
        expect(carl.page.locator("#alert")).not_to_have_attribute("data-word", "alert.estop_screen")
        if place == "lobby":
            olga.page.locator("#card-other, #card-main").get_by_text("Watch").click()
            olga.wait_for("phase", "watching")
    before = giraff.truth()
    carl.page.bring_to_front()
    carl.hold("ArrowLeft", lambda: abs(giraff.truth().theta - before.theta) > 0.1, 15, "a turn")
