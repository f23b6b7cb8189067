"""How a session ends when the robot's agent or the visitor's network does not come back."""

import signal

import pytest

from tests.support.browsers.chromium import CHROMIUM
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.programs.namespace import HERE, namespace
from tests.support.sessions.site import wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]


@pytest.fixture
def giraff(site):
    with site.robot("giraff", "--start", "corridor-centre") as onlooker:
        yield onlooker


def ended(site) -> str:
    _, _, state, outcome = site.sessions()[-1]
    return outcome if state == "ended" else ""


@pytest.mark.usefixtures("giraff")
def test_lost_agent_ends_the_session_as_robot_fault(site, visitor):
    anna = visitor("anna").drive()
    anna.wait_for("link", "live")
    site.stop("giraff", signal.SIGKILL)
    wait_for(lambda: ended(site) == "robot_fault", 90, "the visit's end")
    anna.wait_for("phase", "ended", 20)


@pytest.mark.usefixtures("giraff")
def test_unplugged_visitor_ends_the_session_as_connection_lost(tmp_path, playwright, site):
    with (
        namespace() as network,
        chromium(playwright, str(network.wrapper(tmp_path, CHROMIUM))) as browser,
    ):
        far = Visitor(browser, site, "far", host=HERE).drive()
        far.wait_for("link", "live")
        network.pull()
        wait_for(lambda: ended(site) == "connection_lost", 90, "the visit's end")
