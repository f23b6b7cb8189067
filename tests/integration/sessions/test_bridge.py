"""Pages on real WebSockets, daphne, a real broker, and a robot behind it."""

import asyncio
import contextlib

import msgspec
import pytest
from websockets.exceptions import ConnectionClosed

from robots.api import codec, messages as m
from sessions import protocol
from tests.support import words
from tests.support.patience import patient, until
from tests.support.sessions.bridge_rig import Rig, RobotDouble, SocketPage

pytestmark = pytest.mark.broker


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    rig = Rig(tmp_path_factory.mktemp("site"))
    try:
        rig.start_web()
        rig.cookies = {name: rig.sign_in(name) for name in ("ada", "bob")}
        yield rig
    finally:
        rig.stop_all()


def page(site, who, **options):
    return SocketPage(site, site.cookies[who], **options)


def leases(robot, granted):
    """Return the leases of this epoch that the robot received."""
    return [lease for lease in robot.commands("lease") if lease and lease.epoch == granted.epoch]


async def leave(page):
    await page.say("session/leave", protocol.Leave())
    await page.expect("session/ended")


async def test_large_frame_is_denied_and_a_huge_one_ends_the_connection(site):
    async with page(site, "bob") as bob:
        await bob.say_frame("signal\n" + " " * protocol.MAX_FRAME)
        assert (await bob.expect("denied")).reason == "oversized"
        with contextlib.suppress(ConnectionClosed):  # it may be closed before all is sent
            await bob.say_frame("x" * 2_000_000)
        await asyncio.wait_for(bob.socket.wait_closed(), patient(10))


@pytest.mark.nightly
async def test_slow_page_loses_only_old_telemetry_and_others_lose_nothing(
    site,
):
    scan = m.Scan(
        stamp=1.0,
        angle_min=0.0,
        angle_increment=0.003,
        range_max=10.0,
        ranges=tuple(1.0 + number / 7 for number in range(1900)),
    )
    async with (
        RobotDouble(site) as robot,
        page(site, "ada", slow=True) as slow,
        page(site, "bob") as quick,
    ):
        await tune_in(robot, slow, quick)
        received = asyncio.create_task(expect_scan(quick, 600.0))
        for number in range(1, 601):
            await robot.say("scan", msgspec.structs.replace(scan, stamp=float(number)))
            if number % 100 == 0:
                event = m.Event(stamp=float(number), boot="b1", seq=number, type="docked")
                await robot.say("event", event)
        await received
        assert len(answers(quick, "scan")) == 600
        await expect_scan(slow, 600.0)
        while len(answers(slow, "event")) < 6:
            await slow.next()
    stamps = [scan.stamp for scan in answers(slow, "scan")]
    assert stamps == sorted(stamps)
    assert len(stamps) < 600
    assert [event.seq for event in answers(slow, "event")] == [100, 200, 300, 400, 500, 600]


async def tune_in(robot, *pages):
    """Wait until the pages receive the robot, to which the server subscribes for the first page."""
    received = asyncio.gather(*(page.expect("state") for page in pages))
    while not received.done():  # at the latest by the timeout of `expect`
        await robot.say("state", words.state())
        await asyncio.sleep(0.02)
    received.result()


def answers(page, wanted):
    return [message for suffix, message in page.seen if suffix == wanted]


async def expect_scan(page, stamp):
    while (await page.expect("scan")).stamp != stamp:
        pass


# --- malformed and forged frames ------------------------------------------------------------------

# --- the broker -----------------------------------------------------------------------------------


async def test_drive_continues_after_a_restart_of_the_broker(site):
    async with page(site, "ada") as ada:
        granted = await ada.take(takeover=True)
        site.stop("broker")
        presence = await ada.expect("robot")
        assert (presence.online, presence.reason) == (False, "server")
        await ada.say("command/velocity", words.velocity(seq=1))
        await ada.say("signal", m.SdpOffer(sdp="v=0"))
        assert (await ada.expect("denied")).reason == "robot_unreachable"
        site.start_broker()
        async with RobotDouble(site) as robot:
            await robot.say("connection", words.online(), retain=True)
            await ada.expect("robot", lambda presence: presence.online)
            await until(lambda: leases(robot, granted))
            await ada.say("command/velocity", words.velocity(seq=2))
            await ada.settle(robot)
            assert [command.seq for command in robot.commands("command/velocity")] == [2]
            await leave(ada)


# --- the session manager --------------------------------------------------------------------------


def test_web_server_logged_no_traceback(site):
    for log in (site.var / "log").glob("web*.log"):
        assert "Traceback" not in log.read_text(errors="replace")
    assert codec.MAX_FRAME > protocol.MAX_FRAME
