"""The administration's page of a robot in a real Chromium, which shows when the robot connects."""

import datetime
import re

import pytest
from axe_playwright_python.sync_playwright import Axe
from django.urls import reverse
from django.utils import timezone
from playwright.sync_api import expect

from robots.models import Robot, RobotPresence
from tests.support.browsers.drive_page import note_errors
from tests.support.people import person
from tests.support.sessions import replays

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True), pytest.mark.nightly]


def test_owner_connects_and_shows_a_robot_without_leaving_its_page(open_page):
    owner = person("owner", is_staff=True)
    robot = Robot.objects.create(
        name="giraff", title="Giraff", owner=owner, shown_to_visitors=False
    )
    replays.session(robot, person("zaphod"), seconds=90)
    page, problems = open_page(owner, reduced_motion="reduce"), []
    note_errors(page, problems)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.goto(f"/admin/robots/robot/{robot.pk}/change/")
    overview = page.locator("#robot-overview")
    switch = page.locator("input[name=shown_to_visitors]")
    expect(overview).to_contain_text("Waiting for the robot to connect…")
    expect(switch).to_be_disabled()
    page.locator("[data-kind] select[name=adapter]").select_option("ros1")
    expect(page.get_by_label("Address of the ROS master")).to_be_visible()
    expect(page.get_by_label("Address of the MOOSDB")).to_be_hidden()
    page.locator("[data-kind] select[name=profile]").select_option("giraff")
    page.get_by_role("button", name="Create the command").click()
    expect(overview).to_contain_text("Waiting for the robot to connect…")
    page.get_by_role("button", name="Copy").click()
    expect(page.get_by_role("button", name="Copied")).to_be_visible()
    copied = page.evaluate("navigator.clipboard.readText()")
    assert copied == page.locator("#command").inner_text()
    assert "--enrol " in copied

    page.evaluate("window.sameDocument = true")
    settings = {
        name: page.locator(f".field-{name} .readonly") for name in ("between", "seen", "key")
    }
    expect(settings["between"]).to_have_text("New")
    enrolling = {"robot": "giraff", "token": copied.rpartition(" ")[2]}
    assert page.request.post(reverse("agent_enrol"), data=enrolling).status == 200
    RobotPresence.objects.update(
        connection="ONLINE",
        last_seen_at=timezone.now() + datetime.timedelta(hours=1),  # for longer than the test
        report={"battery": {"charge": 0.5}},
        factsheet={"series": "giraff", "agentVersion": "0.1.0"},
    )
    expect(overview.locator("[data-arrived]")).to_be_visible()
    expect(overview.locator("[data-waiting]")).to_be_hidden()
    expect(overview).to_contain_text("50 %")
    expect(overview).to_contain_text("0.1.0")
    assert overview.locator("[data-label]").inner_text() == "Hidden"
    expect(settings["between"]).to_have_text("Hidden")
    expect(settings["seen"]).not_to_have_text("–")
    expect(settings["key"]).to_contain_text(re.compile(r"^created .* · Enrol"))
    expect(page.locator("#command")).to_have_text(copied.partition(" --enrol ")[0])
    expect(page.get_by_text("This command is shown only once.")).to_have_count(0)
    expect(page.get_by_text("This command starts the robot's agent")).to_be_visible()
    assert page.evaluate("window.sameDocument")
    switch.check()
    page.get_by_role("button", name="Save and continue editing").first.click()
    expect(page.locator("input[name=shown_to_visitors]")).to_be_checked()
    assert Robot.objects.get().shown_to_visitors
    assert problems == []
    assert Axe().run(page, "#robot-overview").response["violations"] == []
