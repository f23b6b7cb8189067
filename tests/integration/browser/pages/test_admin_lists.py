"""The administration's lists on a laptop, with the menu open: nothing of a row is cut off."""

import re

import pytest
from django.conf import settings
from django.contrib import admin
from django.urls import reverse
from playwright.sync_api import expect

from accounts import audit
from accounts.models import User
from experiments.models import Study
from robots.models import Robot, RobotElsewhere
from sessions.models import Session
from tests.integration.site.web.test_roles import world
from tests.support.media.photographs import keep

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]
__all__ = ["world"]
LAPTOP = {"viewport": {"width": 1366, "height": 768}, "reduced_motion": "reduce"}
# Parts that are wider than what shows them.
CUT = """() => [document.documentElement, ...document.querySelectorAll(".results")]
  .filter((one) => one.scrollWidth > one.clientWidth)
  .map((one) => `${one.className || one.tagName} ${one.scrollWidth} > ${one.clientWidth}`)"""

# Whether the buttons beside a title cover its words.
COVERED = """() => {
  const words = document.createRange(), tools = document.querySelector(".object-tools");
  words.selectNodeContents(document.querySelector("#content h1"));
  const title = words.getBoundingClientRect();
  return [...(tools?.children ?? [])].map((one) => one.getBoundingClientRect()).some((one) =>
    one.left < title.right && one.right > title.left &&
    one.top < title.bottom && one.bottom > title.top);
}"""


def make_long(world) -> None:
    """Give names and titles realistic lengths."""
    for user in User.objects.all():
        User.objects.filter(pk=user.pk).update(
            email=f"{user.username}.mccarthy-lopez@telepresence.example.org",
            display_name=f"{user.username} Guadalupe de la Torre Fernández",
        )
    Robot.objects.update(title="Giraff of the residence for the elderly, second floor")
    Study.objects.update(title="Exploring an unknown building with assistance of three levels")
    Session.objects.update(outcome="stopped_by_operator")
    RobotElsewhere.objects.create(name="giraff-3", site="https://telepresence.example.org/second/")
    actor = world["people"]["administrator"]
    audit.note("robot_freed", actor=actor, robot=world["robot"], detail="why " * 9)


@pytest.mark.nightly
@pytest.mark.parametrize("language", ["en", "es"])
def test_no_list_is_cut_off_on_a_laptop_with_open_menu(open_page, world, live_server, language):
    make_long(world)
    page = open_page(world["people"]["administrator"], **LAPTOP)
    page.context.add_cookies(
        [{"name": settings.LANGUAGE_COOKIE_NAME, "value": language, "url": live_server.url}]
    )
    page.goto(reverse("admin:index"))  # the models are registered with the addresses
    found, seen = [], 0
    for model in admin.site._registry:
        name = f"admin:{model._meta.app_label}_{model._meta.model_name}_changelist"
        answer = page.goto(reverse(name))
        if answer.status != 200:
            continue
        assert page.locator("#nav-sidebar").is_visible(), name
        seen += page.locator("#result_list tbody tr").count() > 0
        keep(page, f"list-{model._meta.model_name}-{language}")
        assert page.locator("html").get_attribute("lang") == language
        found += [f"{name}: {line}" for line in page.evaluate(CUT)]
        for width, height in ((1366, 768), (820, 1180), (844, 390)):
            page.set_viewport_size({"width": width, "height": height})
            found += [f"{name}, {width}: the title is covered"] * page.evaluate(COVERED)
        page.set_viewport_size({"width": 1366, "height": 768})
    page.goto(reverse("admin:robots_robot_change", args=[world["robot"].pk]))
    assert not page.evaluate(COVERED)
    assert found == []
    assert seen >= 14


def test_folded_filter_shows_the_choice_and_opens(open_page, world):
    page = open_page(world["people"]["administrator"], **LAPTOP)
    page.goto(reverse("admin:robots_robot_changelist"))
    summary = page.locator("#changelist-filter summary", has_text="access")
    invited = page.locator("#changelist-filter a[href*='access__exact=invitation']")
    assert not invited.is_visible()
    summary.click()
    invited.click()
    expect(summary).to_have_text(re.compile(r"By access\s*: by invitation"))
