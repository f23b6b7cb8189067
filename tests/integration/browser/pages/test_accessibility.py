"""axe-core finds no fault on any page: those of strangers, visitors, participants and researchers,
the drive page and the robot's screen.
"""

import functools
import re
from dataclasses import asdict

import msgspec
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from django.urls import reverse
from django.utils import timezone
from playwright.sync_api import Page, expect

from experiments.coding import store
from experiments.models import Rehearsal
from experiments.research import analysis_views
from experiments.research.analysis_topics import TOPICS
from robots.models import RobotPresence
from tests.integration.browser.studies.test_replay import made
from tests.integration.experiments.research.test_analysis_views import computed
from tests.integration.experiments.study_admin.test_rehearsals import REPORT
from tests.support.agents.told_task import guide, tell
from tests.support.analysis.study_dataset import made_up
from tests.support.browsers.fake_robot_page import FakeRobotPage
from tests.support.browsers.present_robot_page import PresentRobotPage
from tests.support.media.photographs import LANGUAGE, keep
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.study_rows import put
from tests.support.studies.study_walk import Walker
from tests.support.words import factsheet

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]
SIZES = [(1280, 800), (390, 844)]
PHONE = SIZES[1:]
NAMES = {1280: "desktop", 390: "phone", 844: "landscape"}
PATIENCE = 60_000  # ms
# Without animations: a fading text has every contrast.
STILL = {"reduced_motion": "reduce"}


@pytest.fixture
def opened(open_page):
    """Open a page without animations, as a user or as a stranger."""
    return functools.partial(open_page, locale=LANGUAGE, **STILL)


def called(where: str) -> str:
    """Return the name of a picture of a page: its address without keys of this run."""
    plain = re.sub(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", "", where.lower())
    return re.sub(r"[^a-z]+", "-", plain).strip("-") or "home"


def faults(page: Page, where: str, sizes=SIZES) -> list[str]:
    """Return what axe-core finds at every size, a line each."""
    found = []
    for width, height in sizes:
        page.set_viewport_size({"width": width, "height": height})
        keep(page, f"{called(where)}-{NAMES[width]}", whole=True)
        for violation in Axe().run(page).response["violations"]:
            places = "; ".join(
                f"{node['target'][0]} {node['html'][:120]}" for node in violation["nodes"][:4]
            )
            found.append(
                f"{where} {width}x{height}: {violation['id']} ({violation['impact']}): {places}"
            )
    return found


def check(page: Page, *addresses: str) -> None:
    found = []
    for address in addresses:
        answer = page.goto(address)
        assert answer is not None
        assert answer.status in {200, 202, 404}, address
        found += faults(page, address)
    assert not found, "\n".join(found)


def test_pages_of_strangers(opened):
    robot = p.site()
    RobotPresence.objects.filter(pk=robot.pk).update(report={"battery": {"charge": 0.5}})
    p.published(p.of("exploration"))
    accounts = [f"/accounts/{page}/" for page in ("login", "signup", "password/reset")]
    check(opened(), "/", "/about/", *accounts, "/no/such/page/", "/studies/exploration/")


def test_check_of_browser_and_network(opened):
    page = opened()
    page.goto("/check/")
    page.wait_for_selector("#check:not([data-state=busy]) .check__line", timeout=PATIENCE)
    assert not faults(page, "check")


def test_pages_of_visitors(opened):
    robot = p.site()
    own = ["/profile/", "/profile/data/", "/accounts/password/change/", "/accounts/email/"]
    check(opened(person()), "/", f"/robots/{robot.name}/", *own)


@pytest.mark.nightly
def test_every_step_of_a_study(opened):
    walker = Walker(p.published(p.of("exploration")), person(), p.site())
    walker.come()
    page = opened(walker.client)
    found, seen = [], set()
    for _ in range(20):
        page.goto(walker.url())
        kind = walker.step.kind
        found += faults(page, kind)
        seen.add(kind)
        if walker.participant.status != "active":
            break
        walker.do()
    assert {"consent", "form", "instructions", "task", "questionnaire"} <= seen
    assert not found, "\n".join(found)


@pytest.mark.nightly
def test_pages_of_researchers(opened, monkeypatch):
    monkeypatch.setattr(analysis_views, "REFRESH_S", 3600)  # no reload during the test
    visit = made()
    p.site()  # the course is drawn on its floor plan
    RobotPresence.objects.update(factsheet=msgspec.to_builtins(factsheet(series="giraff")))
    study = p.published(p.of("exploration"))
    page = opened(person("owner", is_superuser=True, is_staff=True))
    codes = [{"code": "help", "name": "Asks for help", "kind": "point", "key": "h"}]
    coded = visit.drive.participant.study
    store.store_scheme(coded, store.scheme_from(codes), timezone.now())
    own = [
        f"/studies/replay/{visit.pk}/",
        f"/studies/coding/{visit.pk}/",
        f"/studies/{coded.slug}/coding/",
        f"/studies/{study.slug}/live/",
        f"/studies/{study.slug}/analysis/",
    ]
    built = f"/admin/experiments/study/{study.pk}/build"
    ours = [f"{built}/about/", f"{built}/steps/0/", f"{built}/conditions/0/", f"{built}/courses/0/"]
    rehearsal = Rehearsal.objects.create(
        study=study, began_at=timezone.now(), status="done", report=asdict(REPORT)
    )
    ours.append(f"/admin/experiments/rehearsal/{rehearsal.pk}/change/")
    check(page, *own, *ours)


def test_withdrawal_from_a_study_and_its_receipt(opened):
    walker = Walker(p.published(p.of("exploration")), person(), p.site())
    walker.come()
    page = opened(walker.client)
    page.goto(f"/taking-part/{walker.participant.code}/withdraw/")
    found = faults(page, "withdraw", PHONE)
    page.get_by_role("button", name=re.compile("^(Withdraw|Leave)")).click()
    expect(page.get_by_role("button", name=re.compile("receipt"))).to_be_visible()
    found += faults(page, "receipt", PHONE)
    assert not found, "\n".join(found)


@pytest.mark.nightly
def test_analysis_pages(opened, settings, tmp_path, monkeypatch):
    settings.VAR_DIR = tmp_path
    # takes most of the time, and is on no page
    monkeypatch.setattr("experiments.analysis.report.as_pdf", lambda _: b"%PDF-1.7")
    study = put(made_up(np.random.default_rng(91), 4)).study
    computed(study)
    page = opened(person("owner", is_superuser=True, is_staff=True))
    found = []
    others = [one for one in TOPICS if one.key in {"questionnaires", "trajectories"}]
    for topic in (TOPICS[0], *others):
        own = () if topic is TOPICS[0] else (topic.key,)
        page.goto(reverse("analysis_topic" if own else "analysis", args=[study.slug, *own]))
        expect(page.get_by_text("Computed on")).to_be_visible()
        found += faults(page, f"analysis {topic.key}", PHONE)
        rows = page.locator("tbody tr").all()
        assert not [one for one in rows if (one.bounding_box() or {"height": 0})["height"] > 400]
    assert not found, "\n".join(found)


def driving(page: Page) -> None:
    page.wait_for_selector("#drive-page[data-playing][data-link=live]", timeout=PATIENCE)


@pytest.mark.nightly
def test_drive_page_before_during_and_after_driving(browser):
    with PresentRobotPage() as site:
        page = browser.new_context(**STILL).new_page()
        page.goto(site.url)
        expect(page.get_by_role("button", name="Drive Giraff")).to_be_visible(timeout=PATIENCE)
        found = faults(page, "before")
        page.get_by_role("button", name="Drive Giraff").click()
        driving(page)
        page.locator("#presence-talk").click()
        found += faults(page, "driving", [*SIZES, (844, 390)])
        page.locator("#presence-volumes").click()
        page.locator("#profiles button[value=technical]").click()
        expect(page.locator(".figure").first).to_be_attached(timeout=PATIENCE)
        found += faults(page, "technical", [*SIZES, (844, 390)])
        page.get_by_role("button", name="Leave").click()
        found += faults(page, "leaving")
        site.end("turn_over")
        page.wait_for_selector("#drive-page[data-phase=ended]", timeout=PATIENCE)
        found += faults(page, "ended")
        page.goto(site.screen_url)
        page.wait_for_selector("#face[data-scene]", timeout=PATIENCE)
        found += faults(page, "screen")
        page.context.close()
    assert not found, "\n".join(found)


def test_drive_page_with_a_task(browser):
    with FakeRobotPage(study=guide()) as site:
        page = browser.new_context(**STILL).new_page()
        page.goto(f"{site.url}?go=1")
        driving(page)
        tell(site, "go_to_checkpoint", number=2, x=8.4, y=1.0, passed=(1,), remaining=119.0)
        expect(page.get_by_text("Go to checkpoint 2.", exact=True).first).to_be_visible(
            timeout=PATIENCE
        )
        found = faults(page, "task")
        tell(site, "photo_turn_left", number=4, x=8.1, y=2.2, passed=(1, 2, 3, 4), window="open")
        expect(page.get_by_role("region", name="Photo")).to_be_visible(timeout=PATIENCE)
        found += faults(page, "photo")
        page.context.close()
    assert not found, "\n".join(found)
