"""What a visitor sees of a camera that starts slowly, cannot be reached, or is lost for a while: a
real RTSP server and a real agent.
"""

import pytest
from playwright.sync_api import expect

from tests.support.media.photographs import keep_at_all_sizes
from tests.support.patience import patient
from tests.support.programs.rtsp_server import RtspServer
from tests.support.sessions.site import wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]

KEY_INTERVAL = 3.0  # s, more than the limit between two pictures
LATER = patient(40.0) * 1000  # ms


@pytest.fixture(scope="module")
def camera(site):
    """The robot's camera, not plugged in yet; its address has a password in it."""
    server = RtspServer(KEY_INTERVAL)
    site.start_robot("giraff", "--seed", "5", agent=("--camera", server.url_for("ana", "hunter2")))
    yield server
    if server.is_plugged:
        server.pull()


def errors_of(site) -> list[str]:
    states = site.states(site.sessions()[-1][0])
    return states[-1].get("errors", []) if states else []


def test_camera_out_of_reach_is_reported_until_it_works(site, visitor, camera):
    anna = visitor("anna").open("giraff", go=True)
    card = anna.page.locator("#card")
    expect(card).to_contain_text("The camera isn't working", timeout=LATER)
    expect(card).to_contain_text(
        f"The robot reports: the camera rtsp://127.0.0.1:{camera.port} cannot be read: connection"
        " refused."
    )
    keep_at_all_sizes(anna.page, "camera-failed")
    refused = lambda: [error for error in errors_of(site) if "connection refused" in error]
    wait_for(refused, 20, "the reason in the robot's state")
    assert not any("hunter2" in error for error in errors_of(site))
    camera.plug()
    anna.wait_for_picture(within=patient(40.0))
    expect(card).to_be_hidden()
    wait_for(lambda: errors_of(site) == [], 20, "no reason any more")
    anna.leave()


def test_slow_camera_is_reported_as_starting(visitor, camera):
    ben = visitor("ben").open("giraff", go=True)
    card = ben.page.locator("#card")
    ben.wait_for("link", "live")
    expect(card).to_contain_text("Starting the camera…")
    keep_at_all_sizes(ben.page, "camera-starting")
    ben.wait_for_picture(within=patient(30.0))
    expect(card).to_be_hidden()
    ben.leave()


def test_lost_camera_is_reported_over_the_last_frame_until_it_works(visitor, camera):
    cleo = visitor("cleo").drive()
    alert = cleo.page.locator("#alert")
    for _ in range(2):
        camera.pull()
        expect(alert).to_have_attribute("data-word", "alert.camera", timeout=LATER)
        keep_at_all_sizes(cleo.page, "camera-stopped")
        seen = cleo.frames()
        camera.plug()
        wait_for(lambda seen=seen: cleo.frames() > seen + 5, patient(40), "video again")
        expect(alert).not_to_have_attribute("data-word", "alert.camera", timeout=LATER)
