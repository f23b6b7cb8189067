"""The site's maintenance during a drive: warned, ended, and next in the queue afterwards."""

import pytest
from playwright.sync_api import expect

from tests.support.media.photographs import keep_at_all_sizes
from tests.support.patience import patient
from tests.support.sessions.site import wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]


STAYS = "from robots.models import Robot; print(Robot.objects.update(returns_home=False))"


@pytest.fixture
def giraff(site):
    site.django(STAYS)  # the next turn would wait for its way home
    with site.robot("giraff", "--start", "corridor-centre") as onlooker:
        yield onlooker


@pytest.mark.usefixtures("giraff")
def test_driver_is_warned_of_maintenance_and_drives_again_after_it(site, visitor):
    expect.set_options(timeout=patient(20) * 1000)
    ada = visitor("ada").drive()
    site.run("manage.py", "maintenance", "begin", "--in", "60")
    expect(ada.page.locator("#alert")).to_contain_text("This site is updated in")
    keep_at_all_sizes(ada.page, "maintenance_announced")
    assert ada.page_data("phase") == "driving"
    assert "No drive is left." in site.run(
        "manage.py", "maintenance", "begin", "--in", "0", "--wait"
    )
    expect(ada.page.locator("#card")).to_contain_text("This site is being updated")
    keep_at_all_sizes(ada.page, "maintenance_began")
    ada.page.get_by_role("button", name="Drive again").click()
    expect(ada.page.locator("#card")).to_contain_text("and keep your place")
    keep_at_all_sizes(ada.page, "maintenance_waiting")
    site.run("manage.py", "maintenance", "end")
    wait_for(lambda: ada.page_data("phase") in {"turn", "driving"}, 20, "the next turn")
