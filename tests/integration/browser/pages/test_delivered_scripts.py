"""Every script runs in a real browser as it is delivered: collected, under its hashed name, with
the content policy of its page.
"""

import re

import msgspec
import pytest
from django.contrib.staticfiles.storage import staticfiles_storage
from django.utils import timezone
from playwright.sync_api import Page

from experiments.rehearsal import runs
from robots.models import RobotPresence
from surveys.questionnaires import shipped, store
from tests.integration.browser.pages.test_accessibility import driving
from tests.integration.browser.studies.test_replay import made
from tests.support.agents.told_task import guide
from tests.support.browsers.drive_page import note_errors
from tests.support.browsers.fake_robot_page import FakeRobotPage
from tests.support.browsers.present_robot_page import PresentRobotPage
from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.studies import participants as p
from tests.support.studies.study_walk import Walker
from tests.support.studies.wizard_study import wizard_document
from tests.support.words import factsheet

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]

ENTRY = re.compile(r"<script[^>]* src=\"{% static '(js/[^']+)' %}\"")
LOAD = """async (urls) => {
  const failed = [];
  for (const url of urls) {
    await import(url).catch((error) => failed.push(`${url}: ${error}`));
  }
  return failed;
}"""


def entries() -> set[str]:
    """Return the scripts that pages name."""
    return {
        name
        for path in (ROOT / "templates").rglob("*.html")
        for name in ENTRY.findall(path.read_text())
    }


class Complaints(list[str]):
    """The errors of a page's scripts; `ran` are those that it requested."""

    def __init__(self, page: Page) -> None:
        self.ran: set[str] = set()
        note_errors(page, self, but="WebSocket")  # the server has none, and the page keeps trying
        page.on("request", lambda request: self.ran.add(request.url.partition("/static/")[2]))

    def check(self, *names: str) -> None:
        """There were no errors, and these scripts were requested by their collected names."""
        assert self == []
        missing = {name for name in names if staticfiles_storage.stored_name(name) not in self.ran}
        assert not missing


@pytest.mark.nightly
def test_every_module_can_be_loaded_by_itself(open_page):
    page = open_page()
    page.goto("/about/")
    static = ROOT / "static"
    names = {str(path.relative_to(static)) for path in (static / "js").rglob("*.js")} - entries()
    assert len(names) > 100
    stored = [staticfiles_storage.stored_name(name) for name in sorted(names)]
    assert page.evaluate(LOAD, [f"/static/{name}" for name in stored]) == []


def test_every_script_that_a_page_names_runs_there(open_page, browser, settings):
    ran: set[str] = set()
    settings.PRACTICE_ROBOTS = 1
    visit, robot = made(), p.site()
    RobotPresence.objects.update(factsheet=msgspec.to_builtins(factsheet(series="giraff")))
    study = p.published(p.of("exploration"))
    replays.study(slug="operated", definition=wizard_document(study={"slug": "operated"}))
    rehearsal = runs.begin(study, "lab", timezone.now())
    asked = store(shipped()["sus"], timezone.now())
    page = open_page(person("owner", is_superuser=True, is_staff=True))
    complaints = Complaints(page)
    for address, shows in {
        "/try/": "#try [data-soon]",
        "/": "[data-robot]",
        "/check/": "#check:not([data-state=busy]) .check__line",
        f"/studies/{study.slug}/live/": "main",
        "/studies/operated/wizard/": "#video-wait",
        f"/studies/replay/{visit.pk}/": "#replay[data-state=ready]",
        f"/admin/experiments/study/{study.pk}/change/": "#content",
        f"/admin/experiments/rehearsal/{rehearsal.pk}/change/": "[data-rehearsal]",
        f"/admin/surveys/questionnaire/{asked.pk}/preview/": "main",
        f"/admin/experiments/study/{study.pk}/build/courses/0/": "#course-map .course__handle",
        f"/admin/robots/robot/{robot.pk}/change/": "#robot-overview",
        f"/admin/robots/floorplan/{robot.floor_plan_id}/finish/": "#plan-map .course__handle",
    }.items():
        page.goto(address)
        page.wait_for_selector(shows, state="attached", timeout=patient(20) * 1000)
        page.wait_for_load_state("networkidle")
    own = {
        f"js/pages/{name}.js"
        for name in (
            *("site", "robots", "try", "check/page", "live/page", "wizard/page", "replay/page"),
            *("copy", "admin/course", "admin/kind", "admin/plan", "admin/rehearsal", "admin/robot"),
            "survey/look",
        )
    }
    complaints.check(*own)
    ran |= own

    walker = Walker(study, person("walker"), robot)
    walker.come()
    page = open_page(walker.client)
    complaints = Complaints(page)
    while walker.participant.status == "active":
        if type(walker.step).__name__ != "Task":  # the drive page is below
            page.goto(walker.url())
        walker.do()
    page.goto(walker.url())
    own = {"js/pages/survey/page.js", "js/pages/copy.js"}
    complaints.check(*own)
    ran |= own

    for site in (PresentRobotPage(), FakeRobotPage(study=guide())):
        with site:
            page = browser.new_context().new_page()
            complaints = Complaints(page)
            page.goto(f"{site.url}?go=1")
            driving(page)
            if site.study is None:
                page.goto(site.screen_url)
                page.wait_for_selector("#face[data-scene]", timeout=patient(20) * 1000)
                own = {
                    f"js/{name}.js"
                    for name in ("drive/load_retry", "drive/page", "pages/screen/page")
                }
                complaints.check(*own)
                ran |= own
            page.context.close()
            complaints.check("js/drive/page.js")

    assert ran == entries(), "a script that no page of this test runs"
