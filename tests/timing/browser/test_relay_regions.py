"""A real browser picks the region whose relays answer first."""

import functools
import http.server
import socket
import threading
import time

import pytest
from aioice import stun

from tests.support.browsers.visitor import chromium
from tests.support.paths import ROOT
from tests.support.programs.loopback_only import FIRST, SECOND, loopback_only

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
NEAREST = """async (servers) => {
  const { createRelayRegions } = await import("/protocol/relay_regions.js");
  const nearest = createRelayRegions().nearest;
  const found = [await nearest(servers), await nearest(servers)];
  return found.map((list) => list.map(({ urls }) => urls));
}"""


class Relay(threading.Thread):
    """Answers STUN binding requests after some seconds."""

    def __init__(self, delay: float) -> None:
        super().__init__(daemon=True)
        self.delay, self.asked = delay, 0
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((SECOND.partition("/")[0], 0))

    @property
    def url(self) -> str:
        return "turn:{}:{}?transport=udp".format(*self.socket.getsockname())

    def run(self) -> None:
        while True:
            data, sender = self.socket.recvfrom(2048)
            self.asked += 1
            time.sleep(self.delay)
            asked = stun.parse_message(data).transaction_id
            answer = stun.Message(stun.Method.BINDING, stun.Class.RESPONSE, asked)
            # An address that is not the browser's own, as behind a router.
            answer.attributes["XOR-MAPPED-ADDRESS"] = ("203.0.113.7", sender[1])
            self.socket.sendto(bytes(answer), sender)


@pytest.fixture(scope="module")
def computer():
    with loopback_only() as computer:
        computer.plug()
        yield computer


@pytest.fixture(scope="module")
def page(computer, playwright):
    handler = functools.partial(Quiet, directory=ROOT / "static" / "js")
    with http.server.ThreadingHTTPServer((FIRST.partition("/")[0], 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with chromium(playwright) as browser:
            page = browser.new_page()
            page.goto("http://{}:{}/lib/clock.js".format(*server.server_address))
            yield page
        server.shutdown()


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


def nearest(page, *delays: float) -> tuple[list[list[str]], list[Relay]]:
    relays = [Relay(delay) for delay in delays]
    for relay in relays:
        relay.start()
    login = {"username": "u", "credential": "c"}
    servers = [{"urls": [relay.url, "turns:relay.example.org"], **login} for relay in relays]
    first, again = page.evaluate(NEAREST, servers)
    assert first == again
    return [urls[0] for urls in first], relays


@pytest.mark.parametrize("delays", [(0.2, 0.02), (0.02, 0.2)])
def test_the_region_that_answers_first_is_used(page, delays):
    found, relays = nearest(page, *delays)
    assert found == [relays[delays.index(min(delays))].url]
    assert [relay.asked for relay in relays] == [1, 1]


def test_all_regions_are_tried_if_none_answers_in_time(page):
    found, relays = nearest(page, 2.0, 2.0)
    assert found == [relay.url for relay in relays]
