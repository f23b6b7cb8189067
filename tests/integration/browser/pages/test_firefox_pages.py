"""Firefox ESR shows every kind of page: no script fails, and nothing is wider than the screen."""

import msgspec
import pytest
from django.test import Client

from experiments.research import analysis_views
from robots.models import Robot, RobotPresence
from tests.integration.browser.studies.test_replay import made
from tests.support.browsers.firefox import Firefox, firefox
from tests.support.people import person
from tests.support.sessions.site import wait_for
from tests.support.studies import participants as p
from tests.support.studies.study_walk import Walker
from tests.support.words import factsheet

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True), pytest.mark.nightly]
SIZES = [(1366, 768), (390, 844)]
TOO_WIDE = """document.documentElement.scrollWidth > innerWidth
    ? [document.documentElement.scrollWidth, innerWidth] : null"""
COURSE = "document.querySelectorAll('#course-map *').length > 10"
# A canvas is drawn when its pixels differ.
REPLAY = """(() => {
  const canvas = document.getElementById("replay-map");
  if (!canvas.width || document.getElementById("replay").dataset.state === "loading") return false;
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const points = new Uint32Array(data.buffer);
  return points.some((point) => point !== points[0]);
})()"""


@pytest.fixture(scope="module")
def started():
    with firefox() as browser:
        yield browser


@pytest.fixture
def browser(started):
    started.errors.clear()
    return started


def sign_in(browser: Firefox, client: Client) -> None:
    browser.set_cookie("sessionid", client.cookies["sessionid"].value, "localhost")


def faults(browser: Firefox, where: str) -> list[str]:
    """Return the faults of the open page."""
    found = []
    for size in SIZES:
        browser.resize(*size)
        if wide := browser.evaluate(TOO_WIDE):
            found.append(f"{where} at {size}: {wide[0]} of {wide[1]} wide")
    found += [f"{where}: {error}" for error in browser.errors]
    browser.errors.clear()
    return found


def look(browser: Firefox, site: str, *addresses: str) -> list[str]:
    found = []
    for address in addresses:
        browser.goto(f"{site}{address}")
        found += faults(browser, address)
    return found


def test_pages_of_strangers(browser, live_server):
    p.site()
    p.published(p.of("exploration"))
    pages = ("/", "/about/", "/accounts/login/", "/accounts/signup/", "/studies/exploration/")
    assert not look(browser, live_server.url, *pages)


def test_check_of_browser_and_network_finishes(browser, site):
    browser.goto(f"{site.url}/check/")
    done = "!!document.querySelector('#check:not([data-state=busy]) .check__line')"
    wait_for(lambda: browser.evaluate(done), 60, "the end of the check")
    assert not faults(browser, "/check/")


def test_every_step_of_a_study(browser, live_server):
    walker = Walker(p.published(p.of("exploration")), person(), p.site())
    walker.come()
    sign_in(browser, walker.client)
    found, seen = [], set()
    for _ in range(20):
        found += look(browser, live_server.url, walker.url())
        seen.add(walker.step.kind)
        if walker.participant.status != "active":
            break
        walker.do()
    assert {"consent", "form", "instructions", "task", "questionnaire"} <= seen
    assert not found, "\n".join(found)


def test_pages_of_researchers_draw_their_maps(browser, live_server, monkeypatch):
    monkeypatch.setattr(analysis_views, "REFRESH_S", 3600)  # no reload during the test
    visit = made()
    p.site()  # the course is drawn on its floor plan
    RobotPresence.objects.update(factsheet=msgspec.to_builtins(factsheet(series="giraff")))
    study = p.published(p.of("exploration"))
    client = Client()
    client.force_login(person("owner", is_superuser=True, is_staff=True))
    sign_in(browser, client)
    built = f"/admin/experiments/study/{study.pk}/build"
    robot = f"/admin/robots/robot/{Robot.objects.earliest('pk').pk}/change/"
    pages = [f"{built}/{part}/" for part in ("about", "steps/0", "conditions/0")]
    pages += [f"/studies/{study.slug}/{part}/" for part in ("live", "analysis")]
    found = look(browser, live_server.url, "/admin/", robot, *pages)
    maps = {f"{built}/courses/0/": COURSE, f"/studies/replay/{visit.pk}/": REPLAY}
    for address, drawn in maps.items():
        browser.resize(*SIZES[0])
        browser.goto(f"{live_server.url}{address}")
        wait_for(lambda drawn=drawn: browser.evaluate(drawn), 30, f"a map on {address}")
        found += faults(browser, address)
    assert not found, "\n".join(found)
