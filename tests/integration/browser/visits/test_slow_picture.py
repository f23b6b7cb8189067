"""With no network interface but lo there is no WebRTC path: the robot is driven with single
pictures that come through the server.
"""

import json
import math
import re
import time
from dataclasses import replace
from statistics import median

import pytest
from playwright.sync_api import expect

from tests.support.browsers.firefox import firefox
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.media.photographs import keep
from tests.support.programs.loopback_only import loopback_only
from tests.support.programs.narrow import Narrow
from tests.support.sessions.site import LOOPBACK, running_site, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
ARROW_LEFT = "\ue012"
# How many different pictures the canvas has shown, by its pixels.
COUNT = """() => {
  const canvas = document.getElementById('slow'), seen = new Set();
  window.pictures = () => seen.size;
  const small = document.createElement('canvas');
  small.width = 32; small.height = 24;
  const context = small.getContext('2d', { willReadFrequently: true });
  setInterval(() => {
    if (canvas.hidden) return;
    context.drawImage(canvas, 0, 0, 32, 24);
    seen.add(context.getImageData(0, 0, 32, 24).data.join());
  }, 50);
}"""
SPREAD = """() => {
  const canvas = document.getElementById('slow'), context = canvas.getContext('2d');
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  let sum = 0, squares = 0;
  for (let i = 0; i < data.length; i += 4) { sum += data[i + 1]; squares += data[i + 1] ** 2; }
  const n = data.length / 4;
  return Math.sqrt(squares / n - (sum / n) ** 2);
}"""


@pytest.fixture(scope="module")
def computer():
    with loopback_only() as computer:
        yield computer


@pytest.fixture(scope="module")
def site(computer, tmp_path_factory):
    # longer than the restart of a web server on a busy computer
    with running_site(tmp_path_factory.mktemp("site"), GRACE_SECONDS="150") as site:
        yield site


@pytest.fixture(scope="module")
def giraff(site):
    return site.start_robot("giraff", "--start", "lab-before-door", "--seed", "3", "--fps", "10")


def slow_seconds(site, where: str, *values) -> list[dict]:
    """Return the network samples of seconds with single pictures."""
    sql = f"SELECT data FROM telepresence_sessions_networksample WHERE {where}"
    samples = [json.loads(data) for (data,) in site.rows(sql, *values)]
    return [sample for sample in samples if sample.get("path") == "server/jpeg"]


def wait_for_slow_picture(visitor):
    visitor.wait_for("slow", "", within=20)
    picture = visitor.page.locator("#slow")
    wait_for(lambda: not picture.is_hidden(), 10, "a picture through the server")


def test_visitor_without_a_direct_path_drives_with_single_pictures(site, visitor, giraff):
    anna = visitor("anna").open(go=True)
    wait_for_slow_picture(anna)
    anna.page.evaluate(COUNT)
    assert anna.page.evaluate(SPREAD) > 8
    expect(anna.page.locator("#status-text")).to_have_text(re.compile("slow video", re.IGNORECASE))
    expect(anna.page.locator("#alert")).to_contain_text("without sound")
    expect(anna.page.locator("#sound")).to_be_hidden()
    assert anna.page_data("transport") == "mqtt"
    before = giraff.truth()
    gone = lambda now: math.hypot(now.x - before.x, now.y - before.y)
    anna.hold("ArrowUp", lambda: gone(giraff.truth()) > 0.8, 20, "a drive")
    wait_for(lambda: anna.page.evaluate("window.pictures()") > 15, 10, "pictures that move")
    keep(anna.page, "slow-desktop")
    anna.page.keyboard.up("ArrowUp")
    wait_for(lambda: abs(giraff.truth().linear) < 0.01, 5, "a robot at rest")
    anna.page.set_viewport_size({"width": 390, "height": 844})
    anna.page.wait_for_timeout(500)
    keep(anna.page, "slow-phone")
    anna.page.set_viewport_size({"width": 1280, "height": 800})
    anna.leave()
    session = site.sessions()[0][0]
    states = wait_for(
        lambda: (found := site.states(session)) and len(found) > 20 and found, 10, "the record"
    )
    applied = [command for state in states for command in state.get("applied", [])]
    assert {command["way"] for command in applied} == {"mqtt"}
    assert max(command["age"] for command in applied) < 1.0
    wait_for(lambda: site.sessions()[0][2:] == ("ended", "completed"), 10, "the outcome")
    slow = slow_seconds(site, "session_id = ?", session)
    assert len(slow) >= 2
    assert max(second["fps"] for second in slow) > 2


@pytest.mark.soak
def test_firefox_without_a_direct_path_drives_with_single_pictures(site, giraff):
    with firefox() as browser:
        browser.set_cookie("sessionid", site.sign_in("fiona"), LOOPBACK)
        browser.goto(f"{site.url}/robots/giraff/?go=1")
        hidden = "document.getElementById('slow').hidden"
        wait_for(lambda: not browser.evaluate(hidden), 40, "a picture through the server")
        assert browser.evaluate(f"({SPREAD})()") > 8
        before = giraff.truth()
        turned = lambda: abs(giraff.truth().theta - before.theta)
        browser.hold(ARROW_LEFT, lambda: turned() > 0.2, 20, "a turn")
        browser.evaluate("document.getElementById('leave').click()")
        shown = "!document.getElementById('card').hidden"
        wait_for(lambda: browser.evaluate(shown), 10, "the question whether to leave")
        browser.evaluate("document.getElementById('card-main').click()")
        phase = "document.getElementById('drive-page').dataset.phase"
        wait_for(lambda: browser.evaluate(phase) == "ended", 10, "the end of the session")


def test_observers_get_single_pictures_and_others_get_none(site, visitor, giraff):
    ben = visitor("ben").open(go=True)
    wait_for_slow_picture(ben)
    otto = visitor("otto").open()
    listening = """() => {
      window.binary = 0; window.denied = [];
      const page = location.href.replace(/\\?.*/, '');
      const socket = new WebSocket(
        page.replace('http', 'ws').replace('/robots/', '/ws/robots/'));
      const asks = () => JSON.stringify({ stamp: Date.now() / 1000, peer: 'stolen' });
      socket.onopen = () => setInterval(
        () => socket.send('command/picture\\n' + asks()), 100);
      socket.onmessage = (event) => {
        if (typeof event.data !== 'string') window.binary += 1;
        else if (event.data.startsWith('denied'))
          window.denied.push(JSON.parse(event.data.split('\\n')[1]).reason);
      };
    }"""
    otto.page.evaluate(listening)
    wait_for(lambda: otto.page.evaluate("window.denied.length") > 2, 10, "a refusal")
    assert otto.page.evaluate("[...new Set(window.denied)]") == ["no_role"]
    assert otto.page.evaluate("window.binary") == 0
    otto.page.locator("#card-other, #card-main").filter(
        has_text=re.compile("watch", re.IGNORECASE)
    ).click()
    wait_for_slow_picture(otto)
    expect(otto.page.locator("#alert")).to_contain_text("without sound")
    assert otto.page.evaluate(SPREAD) > 8
    assert otto.page.evaluate("window.binary") == 0
    expect(ben.page.locator("#people")).to_be_visible()
    ben.leave()


def test_pictures_get_smaller_instead_of_older_on_a_slow_network(site, browser, giraff):
    with Narrow(site.web_port) as narrow:
        dan = Visitor(browser, replace(site, web_port=narrow.port), "dan").open(go=True)
        wait_for_slow_picture(dan)
        narrow.rate = 50_000.0
        dan.page.wait_for_timeout(3000)  # some pictures until the size has adapted
        begun, before = time.time(), giraff.truth()
        dan.hold("ArrowRight", lambda: abs(giraff.truth().theta - before.theta) > 1.0, 20, "a turn")
        dan.page.keyboard.up("ArrowRight")
        session = site.sessions()[-1][0]
        dan.page.wait_for_timeout(4000)
        ended, narrow.rate = time.time(), None
        dan.leave()
        dan.close()
    # A sample is of the second before its stamp; all processes share one clock. Medians, as the
    # computer may have been busy for a second.
    within = "session_id = ? AND stamp BETWEEN ? AND ?"
    slow = slow_seconds(site, within, session, begun + 1.0, ended)
    assert len(slow) >= 3, slow
    assert median(second["frameAge"] for second in slow) < 0.8, slow
    assert median(second["fps"] for second in slow) >= 1, slow
    assert median(second["bitrate"] for second in slow) < 8 * 60_000, slow


def test_restart_of_the_web_server_stops_the_robot_and_pictures_return(site, visitor, giraff):
    eva = visitor("eva").open(go=True)
    wait_for_slow_picture(eva)
    eva.page.keyboard.down("ArrowLeft")
    wait_for(lambda: abs(giraff.truth().angular) > 0.1, 10, "a turn")
    site.stop("web")
    wait_for(lambda: abs(giraff.truth().angular) < 0.01, 5, "a robot at rest")
    frozen = eva.page.locator("#drive-page[data-frozen]")
    wait_for(frozen.count, 10, "a picture that is marked as old")
    eva.page.keyboard.up("ArrowLeft")
    site.start("web")
    wait_for(site.web_answers, 40, "the web server")
    playing = eva.page.locator("#drive-page[data-slow][data-playing]")
    wait_for(playing.count, 30, "a new picture")
    before = giraff.truth()
    eva.hold("ArrowRight", lambda: abs(giraff.truth().theta - before.theta) > 0.2, 40, "a turn")
    eva.page.keyboard.up("ArrowRight")
    eva.leave()


def test_single_pictures_behind_a_firewall_last_until_a_path_opens(
    computer, site, playwright, giraff
):
    computer.plug()
    computer.close_udp()
    with chromium(playwright) as browser:
        cora = Visitor(browser, site, "cora").open(go=True)
        wait_for_slow_picture(cora)
        computer.open_udp()
        cora.wait_for("link", "live", within=60)
        cora.wait_for_picture()
        expect(cora.page.locator("#drive-page")).not_to_have_attribute(
            "data-slow", "", timeout=40_000
        )
        expect(cora.page.locator("#slow")).to_be_hidden()
        cora.wait_for("transport", "datachannel")
        before = giraff.truth()
        cora.hold("ArrowLeft", lambda: abs(giraff.truth().theta - before.theta) > 0.1, 10, "a turn")
        cora.page.keyboard.up("ArrowLeft")
        cora.leave()
        assert cora.problems == []
