"""A study is rehearsed from its page, with real processes: the rehearsal is started, outlives a
restart of the web server, is killed and ended, and its report is read.
"""

from uuid import UUID

import psutil
import pytest
from playwright.sync_api import expect

from tests.support.patience import patient
from tests.support.sessions.site import Site, wait_for
from tests.support.studies.short_study import store_in

pytestmark = [pytest.mark.browser, pytest.mark.broker, pytest.mark.nightly]
BOSS = "from accounts.models import User; User.objects.update(is_staff=True, is_superuser=True)"
STUDY = "SELECT id FROM experiments_study WHERE slug = 'short'"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A web server and the process that runs rehearsals, without a broker."""
    site = Site(tmp_path_factory.mktemp("rehearsing"))
    try:
        site.prepare()
        store_in(site)
        site.sign_in("ada")
        site.django(BOSS)
        site.start_web()
        site.start("practice", ["manage.py", "run_practice"])
        wait_for(lambda: site.listening(site.web_port), 60, "the web server")
        yield site
    finally:
        site.stop_all()


@pytest.fixture
def study_page(site, visitor):
    """Open a page of the study."""

    def open_it(address: str):
        page = visitor("ada").page
        ((study,),) = site.rows(STUDY)
        page.goto(address.format(UUID(study)))
        return page

    return open_it


def workers(site: Site) -> list[psutil.Process]:
    """Return all processes of rehearsals."""
    return psutil.Process(site.processes["practice"].pid).children(recursive=True)


def nothing_is_left(site: Site, started: list[psutil.Process]) -> None:
    assert psutil.wait_procs(started, timeout=patient(30))[1] == []
    assert workers(site) == []


def test_rehearsal_outlives_the_web_server_and_reports_its_death(site, study_page):
    page = study_page("/admin/experiments/study/{}/change/")
    page.get_by_role("button", name="Rehearse now").click()
    state = page.get_by_role("status")
    expect(state).to_contain_text("Preparing a copy of the site", timeout=patient(20) * 1000)
    site.stop("web")
    site.start_web()
    expect(state).to_contain_text(
        "in 0 of 1 conditions; 0 of 6 bots have finished", timeout=patient(60) * 1000
    )
    started = workers(site)
    (rehearsal,) = (one for one in started if "rehearse_study" in one.cmdline())
    assert rehearsal.nice() == min(19, rehearsal.parent().nice() + 10)
    rehearsal.kill()
    expect(state).to_contain_text("it was ended by SIGKILL", timeout=patient(20) * 1000)
    nothing_is_left(site, started)
    expect(page.get_by_role("button", name="Rehearse now")).to_be_visible()


def test_researcher_ends_a_rehearsal_from_the_publish_page(site, study_page):
    page = study_page("/admin/experiments/study/{}/publish/")
    page.get_by_role("button", name="Rehearse now").click()
    state = page.get_by_role("status")
    expect(state).to_contain_text("Preparing a copy of the site", timeout=patient(20) * 1000)
    wait_for(lambda: workers(site), 20, "its process")
    started = workers(site)
    page.get_by_role("button", name="End the rehearsal").click()
    expect(state).to_contain_text("Ended by ada before it was finished.")
    nothing_is_left(site, started)


@pytest.mark.soak
def test_researcher_reads_the_report_of_a_rehearsal(site, study_page):
    page = study_page("/admin/experiments/study/{}/change/")
    page.get_by_role("button", name="Rehearse now").click()
    expect(page.get_by_role("status")).to_contain_text("Passed.", timeout=patient(400) * 1000)
    expect(page.get_by_role("heading", name="Conditions")).to_be_visible()
    expect(page.get_by_text("A participant needs about")).to_be_visible()
    page = study_page("/admin/experiments/study/{}/publish/")
    expect(page.get_by_text("A rehearsal of this exact definition passed on")).to_be_visible()
