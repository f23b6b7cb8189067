"""A study's drive begins at the charging station: the page waits while the robot is elsewhere, says
why, and continues by itself.
"""

import signal

import pytest
from playwright.sync_api import expect

from robots.simulator.wire import CarryTo
from tests.support.agents.truth import SimulatorOperator
from tests.support.sessions.site import Site, wait_for
from tests.support.studies.task_study import begin_short_study

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
TITLE = "The robot is not in its charging station"
DOCK, CORRIDOR = CarryTo(0.5, 6.3, 3.14159), CarryTo(8.6, 4.4, 1.57)


@pytest.fixture(scope="module")
def hands(site):
    """A person beside the robot, who can carry it."""
    giraff = site.start_robot("giraff", "--start", "corridor-centre", "--seed", "3")
    return SimulatorOperator(giraff.port)


def join(site: Site, name: str) -> None:
    """Make a visitor a participant of the stored study, at its task."""
    site.django(
        "from django.utils import timezone; from accounts.models import User;"
        "from experiments.participation import progress; from experiments.models import Study;"
        f"user, _ = User.objects.get_or_create(username={name!r});"
        "progress.enter(Study.objects.get(slug='short'),"
        " user, access='open', recruitment={}, now=timezone.now())"
    )


def called(site: Site) -> int:
    """Return how often staff were called."""
    calls = "SELECT count(*) FROM telepresence_sessions_sessionevent WHERE type = 'staff_called'"
    return int(site.rows(calls)[0][0])


def test_two_participants_wait_until_the_robot_is_back_in_its_station(site, visitor, hands):
    begin_short_study(site, "ana")
    join(site, "ben")
    for number, name in enumerate(("ana", "ben"), 1):
        guest = visitor(name)
        page = guest.page
        page.goto("/studies/short/step/")
        page.get_by_role("link", name="Go to the robot").click()
        page.get_by_role("button", name="Drive Giraff").click()
        title = page.locator("#card-title")
        expect(title).to_have_text(TITLE, timeout=20_000)
        expect(page.locator("#card-text")).to_contain_text("staff have been informed")
        wait_for(lambda number=number: called(site) == number, 30, "the call for staff")
        site.stop("session-manager", signal.SIGKILL)
        site.start("session-manager")
        page.reload()
        expect(title).to_have_text(TITLE, timeout=30_000)
        assert [row[2] for row in site.sessions() if row[1] == name] == ["waiting"]

        assert hands.wish(DOCK) == ""
        guest.wait_for("phase", "turn", 60)
        assert called(site) == number, "the restarted session manager did not call again"
        page.locator("#card-main").click()
        guest.wait_for_picture(40)
        expect(page.locator("#task-cue")).to_have_text(
            "Drive backwards out of the charging station.", timeout=20_000
        )
        assert hands.wish(CORRIDOR) == "", "the robot is carried away during the drive"
        page.get_by_role("button", name="Leave", exact=True).first.click()
        page.locator("#card-main").click()
        guest.wait_for("phase", "ended", 20)
