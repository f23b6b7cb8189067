"""How soon the pages of a visit say that the session manager or the database hangs: stopped
processes keep their connections, so that only silence shows it.
"""

import contextlib
import time
from dataclasses import dataclass

import psutil
import pytest
from playwright.sync_api import expect

from tests.support.collected import collected_files
from tests.support.patience import patient
from tests.support.programs.postgres import running_postgres
from tests.support.programs.redis import Redis
from tests.support.sessions.site import Site, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
SOON = 2.0  # s
LINES = {
    part: (f"fault.{part.replace('-', '_')}.", "server.failing")
    for part in ("session-manager", "database")
}
SEED = "from telepresence_site.demo.seed import seed; print(seed({mqtt!r}))"
STAYS = "from robots.models import Robot; Robot.objects.update(returns_home=False)"
SCREEN_KEY = """
from django.utils import timezone
from robots.models import Robot
from robots.screens import make_screen_key
print(make_screen_key(Robot.objects.get(name="giraff"), timezone.now()))
"""
ONLINE = """
from django.utils import timezone
from robots.models import Robot
print(Robot.objects.get(name={name!r}).is_online(timezone.now()))
"""
DOCKED = """
from robots.models import Robot
print(Robot.objects.filter(name={name!r}, presence__report__docked=True).exists())
"""
# WebRTC finds no path, so that commands and single pictures take the WebSocket.
NO_PATH = """
const Real = window.RTCPeerConnection;
window.RTCPeerConnection = class extends Real {
  constructor(options) {
    super({ ...options, iceServers: [], iceTransportPolicy: "relay" });
  }
};
"""


@dataclass
class PostgresSite(Site):
    """A site on PostgreSQL and Redis."""

    def prepare(self):
        self.var.mkdir()
        self.django(SEED.format(mqtt=self.mqtt_url))
        self.django(STAYS)
        (self.var / "static").symlink_to(collected_files())

    def robot_is_online(self, name):
        return self.django(ONLINE.format(name=name)).strip() == "True"

    def robot_is_docked(self, name):
        return self.django(DOCKED.format(name=name)).strip() == "True"


@pytest.fixture(scope="module")
def postgres():
    with running_postgres() as server:
        yield server


@pytest.fixture(scope="module")
def redis(tmp_path_factory):
    server = Redis(tmp_path_factory.mktemp("redis"))
    server.start()
    yield server
    psutil.Process(server.pid).resume()
    server.kill()


@pytest.fixture(scope="module")
def site(tmp_path_factory, postgres, redis):
    settings = {"DATABASE_URL": postgres.url, "REDIS_URL": redis.url}
    site = PostgresSite(tmp_path_factory.mktemp("site") / "var", settings=settings)
    try:
        site.prepare()
        site.start_servers()
        site.start_robot("giraff", "--start", "dock", "--seed", "3")
        yield site
    finally:
        site.stop_all()


@contextlib.contextmanager
def hung(site, postgres, part):
    with contextlib.ExitStack() as stack:
        if part == "database":
            stack.callback(postgres.go_on)
            postgres.hold()
        else:
            process = psutil.Process(site.processes[part].pid)
            for one in (process, *process.children(recursive=True)):
                one.suspend()
                stack.callback(one.resume)
        yield


def line(page):
    """Return the key of the line that this page shows, or nothing."""
    lines = page.locator(":is(#alert, #card-warning, #notice, #trouble):visible")
    return next((word for one in lines.all() if (word := one.get_attribute("data-word"))), "")


def seconds_until_named(site, postgres, pages, part):
    wait_for(lambda: not any(is_named(page) for page in pages.values()), 60, "pages without faults")
    took = {}
    with hung(site, postgres, part):
        began = time.monotonic()
        while len(took) < len(pages) and time.monotonic() - began < patient(6.0):
            for name, page in pages.items():
                if name not in took and line(page).startswith(LINES[part]):
                    took[name] = time.monotonic() - began
    print(part, {name: round(seconds, 2) for name, seconds in took.items()})
    assert set(took) == set(pages), {name: line(page) for name, page in pages.items()}
    return took


def is_named(page):
    return line(page).startswith(("fault.", "server."))


@pytest.fixture(scope="module")
def screen_key(site):
    return site.django(SCREEN_KEY).strip()


def people(visitor, site, screen_key, *, with_path):
    """Return the pages of a driver, a visitor in the queue, an observer and the robot's display."""
    driver = visitor("anna")
    if not with_path:
        driver.context.add_init_script(NO_PATH)
    driver.open(go=True)
    driver.wait_for("phase", "driving", 30)
    driver.wait_for("transport", "datachannel" if with_path else "mqtt", 30)
    waiting = visitor("ben").open(go=True)
    waiting.wait_for("phase", "queued")
    watching = visitor("carl").open()
    watching.page.get_by_role("button", name="Just watch").click()
    watching.wait_for("phase", "watching")
    display = visitor()
    display.page.goto(f"/robots/giraff/screen/#{screen_key}")
    expect(display.page.locator("#face")).to_have_attribute("data-scene", "visiting")
    pages = {"driving": driver, "waiting": waiting, "watching": watching, "display": display}
    return {name: one.page for name, one in pages.items()}


@pytest.mark.parametrize("with_path", [True, False], ids=["webrtc", "websocket"])
def test_pages_name_a_part_that_hangs_within_two_seconds(
    site, postgres, visitor, screen_key, with_path
):
    pages = people(visitor, site, screen_key, with_path=with_path)
    for part in LINES:
        took = seconds_until_named(site, postgres, pages, part)
        assert max(took.values()) <= SOON, took
