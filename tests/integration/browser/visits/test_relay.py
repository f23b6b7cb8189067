"""A firewall that drops all datagrams on either side, and a relay outside of it, reached by TCP."""

import shutil
import tempfile
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.support.browsers.visitor import Visitor, chromium
from tests.support.programs.coturn import SECRET, Coturn
from tests.support.programs.loopback_only import SECOND, loopback_only
from tests.support.sessions.site import running_site, wait_for

pytestmark = [pytest.mark.browser, pytest.mark.nightly]
USER = "turnserver"


@pytest.fixture(scope="module")
def computer():
    with loopback_only() as computer:
        computer.plug()
        computer.close_udp()
        computer.let_through(USER)
        yield computer


@pytest.fixture(scope="module")
def relay(computer):
    directory = Path(tempfile.mkdtemp(prefix="telepresence-turn-"))
    directory.chmod(0o755)
    with Coturn(directory, SECOND.partition("/")[0], USER) as coturn:
        yield coturn
    shutil.rmtree(directory)


@pytest.fixture(scope="module")
def site(relay, tmp_path_factory):
    # Without datagrams a page cannot find the nearest region, and tries both.
    here = [f"here={url}" for url in relay.server("udp", "tcp").urls]
    turn = ",".join([*here, f"away=turn:{relay.address}:9?transport=tcp"])
    # Every site with a relay has an address server, which cannot be reached here.
    stun = f"stun:{relay.address}:{relay.port}"
    with running_site(
        tmp_path_factory.mktemp("site"), STUN_URLS=stun, TURN_URLS=turn, TURN_SECRET=SECRET
    ) as site:
        yield site


def test_video_and_driving_use_the_relay_where_no_datagram_passes(computer, site, playwright):
    giraff = site.start_robot("giraff", "--start", "corridor-centre")
    with chromium(playwright) as browser:
        anna = Visitor(browser, site, "anna").open(go=True)
        anna.wait_for("link", "live", within=30)
        anna.wait_for_picture(within=20)
        expect(anna.page.locator("#slow")).to_be_hidden()
        anna.wait_for("transport", "datachannel")
        before = giraff.truth()
        anna.hold("ArrowLeft", lambda: abs(giraff.truth().theta - before.theta) > 0.1, 10, "a turn")
        anna.page.keyboard.up("ArrowLeft")
        wait_for(lambda: path_of(site) == "relay/tcp", 15, "a record of the path of packets")
        anna.leave()
        assert anna.problems == []
        anna.close()


def path_of(site) -> str:
    newest = "FROM telepresence_sessions_networksample ORDER BY received_at DESC LIMIT 1"
    rows = site.rows(f"SELECT json_extract(data, '$.path') {newest}")
    return rows[0][0] if rows else ""
