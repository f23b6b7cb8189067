"""Pages on real WebSockets, daphne, a real broker, and a robot behind it."""

import asyncio
import contextlib
import time

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus

from robots.api import codec
from robots.api import messages as m
from robots.api.idle import WATCHER
from sessions import protocol
from tests.support import words
from tests.support.patience import patient
from tests.support.sessions.bridge_rig import Portal, Rig, RobotDouble, SocketPage, until

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


@pytest.mark.nightly
async def test_server_sets_session_and_epoch_of_messages_between_page_and_robot(site):
    async with RobotDouble(site) as robot, page(site, "ada") as ada:
        granted = await ada.take(takeover=True)
        await until(lambda: robot.commands("lease"))
        assert robot.commands("lease")[-1].peer == granted.peer
        await ada.say("signal", m.SdpOffer(sdp="v=0", role="screen", session="forged", epoch=99))
        await ada.say("command/velocity", words.velocity(seq=1))
        await ada.settle(robot)
        (offer,) = robot.commands(f"signal/{granted.peer}")
        (command,) = robot.commands("command/velocity")
        own = granted.session, granted.epoch
        assert (offer.role, offer.session, offer.epoch) == ("driver", *own)
        assert (command.session, command.epoch) == own
        await robot.say(f"signal/{granted.peer}/reply", m.SdpAnswer(sdp="v=0 answer"))
        await robot.say("state", words.state(seq=4))
        assert (await ada.expect("signal/reply")).sdp == "v=0 answer"
        assert (await ada.expect("state")).seq == 4
        await leave(ada)
        await until(lambda: ("lease", None) in robot.got)


@pytest.mark.parametrize("origin", [None, "http://evil.example.org"])
async def test_missing_or_foreign_origin_is_refused(site, origin):
    with pytest.raises(InvalidStatus) as refused:
        async with page(site, "ada", origin=origin):
            pass
    assert refused.value.response.status_code == 403


async def test_visitor_without_login_gets_a_close_code(site):
    async with SocketPage(site, "no cookie") as page:
        with pytest.raises(ConnectionClosed) as closed:
            await page.next()
    assert closed.value.rcvd.code == protocol.SIGNED_OUT


async def test_large_frame_is_denied_and_a_huge_one_ends_the_connection(site):
    async with page(site, "bob") as bob:
        await bob.say_frame("signal\n" + " " * protocol.MAX_FRAME)
        assert (await bob.expect("denied")).reason == "oversized"
        with contextlib.suppress(ConnectionClosed):  # it may be closed before all is sent
            await bob.say_frame("x" * 2_000_000)
        await asyncio.wait_for(bob.socket.wait_closed(), patient(10))


@pytest.mark.nightly
async def test_driver_moves_between_web_processes(site):
    port = site.second_web()
    async with (
        RobotDouble(site) as robot,
        page(site, "ada") as here,
        page(site, "ada", port=port) as there,
        page(site, "bob", port=port) as bob,
    ):
        granted = await here.take(takeover=True)
        await bob.observe()
        await tune_in(robot, here, bob)
        own = {"session": granted.session, "epoch": granted.epoch}
        await robot.say("state", words.state(seq=8, viewers=2, **own))
        await bob.expect("room", lambda room: room.driving and room.driver == "ada")
        moved = await there.take(takeover=True)
        ended = await here.expect("session/ended")
        assert (ended.session, ended.outcome) == (granted.session, "moved")
        assert moved.session == granted.session
        own = {"session": moved.session, "epoch": moved.epoch}
        await here.say("command/velocity", words.velocity(seq=1, **own))
        await there.say("command/velocity", words.velocity(seq=2))
        assert (await here.expect("denied")).reason == "not_driver"
        await there.settle(robot)
        (command,) = robot.commands("command/velocity")
        assert (command.seq, command.epoch) == (2, moved.epoch)
        await leave(there)
    site.stop("web-2")


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

NOT_A_NUMBER = st.sampled_from(
    ["NaN", "Infinity", "-Infinity", "1e309", '"1"', "null", "[]", "{}", "true"]
)
OUT_OF_RANGE = st.sampled_from(["1e9", "-11", "10.0001", "1e300"])


VELOCITY = {
    "session": '"s"',
    "epoch": "0",
    "seq": "1",
    "stamp": "1",
    "linear": "0.1",
    "angular": "0",
    "method": '"keyboard"',
}


def velocity_with(name, values):
    """Return frames of velocities whose field has one of the values, as JSON."""
    return values.map(
        lambda value: (
            "command/velocity\n{"
            + ",".join(f'"{field}":{text}' for field, text in (VELOCITY | {name: value}).items())
            + "}"
        )
    )


BAD = st.one_of(
    st.text(max_size=300),
    st.binary(max_size=300),
    velocity_with("linear", NOT_A_NUMBER | OUT_OF_RANGE),
    velocity_with("seq", st.sampled_from(["-1", "0.5", "9007199254740992", "1e30", '"1"', "null"])),
    velocity_with("stamp", st.sampled_from(["-1", "1e12", "NaN", "null"])),
    velocity_with("method", st.sampled_from(['"telepathy"', "1", "null"])),
    velocity_with("epoch", st.sampled_from(["-1", '"7"', "1.5"])),
    velocity_with("session", st.sampled_from(['""', '"a b"', '"../x"', "5"])),
    st.builds(
        lambda kind: f'command/action\n{{"type":"{kind}","actionId":"a","stamp":1}}',
        st.sampled_from(["goto!", "fly", "", "lease", "tilt", "resend_states", "follow"]),
    ),
    st.builds(
        lambda suffix, payload: f"{suffix}\n{payload}",
        st.sampled_from(
            [
                *("lease", "config", "floorplan", "state", "event", "photo/a", "connection"),
                *("signal/p", "../x", "#", "+"),
            ]
        ),
        st.text(max_size=50),
    ),
    st.builds(lambda size: "command/velocity\n" + "[" * size, st.integers(1, 60_000)),
    st.builds(lambda size: "command/action\n" + " " * size, st.integers(65_537, 120_000)),
)
FORGED = st.one_of(
    st.builds(
        lambda seq, linear: ("command/velocity", words.velocity(seq=seq, linear=linear)),
        st.integers(0, 2**50),
        st.floats(-10, 10),
    ),
    st.builds(
        lambda role: ("command/action", m.Goto(action_id="g", stamp=1.0, x=1.0, y=1.0, role=role)),
        st.sampled_from(["driver", "owner", "server"]),
    ),
    st.builds(
        lambda role: (
            "command/action",
            m.ClearEStop(action_id="c", stamp=1.0, role=role, user="boss"),
        ),
        st.sampled_from(["staff", "owner"]),
    ),
    st.builds(
        lambda n: ("command/heartbeat", m.CommandHeartbeat(n=n, stamp=1.0)), st.integers(0, 1000)
    ),
)


def forge(message, granted):
    """Give a message the session, epoch or peer of the driver."""
    claims = (
        {"session": granted.session, "epoch": granted.epoch}
        if hasattr(message, "epoch")
        else {"peer": granted.peer}
    )
    return msgspec.structs.replace(message, **claims)


class Attackers:
    """A driver who sends malformed frames, an observer who forges messages, and their robot."""

    def __init__(self, site):
        self.site = site

    async def open(self):
        self.robot, self.ada, self.bob = (
            RobotDouble(self.site),
            page(self.site, "ada"),
            page(self.site, "bob"),
        )
        for end in (self.robot, self.ada, self.bob):
            await end.__aenter__()
        self.granted = await self.ada.take(takeover=True)
        await self.bob.observe()
        await until(lambda: self.robot.commands("lease"))
        self.robot.got = []
        self.reading = [asyncio.create_task(drain(end)) for end in (self.ada, self.bob)]

    async def close(self):
        for task in self.reading:
            task.cancel()
        await asyncio.gather(*self.reading, return_exceptions=True)
        await leave(self.ada)
        for end in (self.ada, self.bob, self.robot):
            await end.__aexit__()

    async def try_one(self, bad, forged):
        """Assert that only the stops that both send afterwards reach the robot."""
        await self.ada.say_frame(bad)
        suffix, message = forged
        await self.bob.say(suffix, forge(message, self.granted))
        await self.ada.settle(self.robot)
        await self.bob.settle(self.robot)
        await asyncio.sleep(0.02)  # at most sixty stops per second pass
        assert [sent for sent in self.robot.got if not of_the_server(sent[1])] == []


def of_the_server(message):
    """Return whether the server sends a message by itself while pages are open."""
    return message == m.Stay() or (
        isinstance(message, m.CommandHeartbeat) and message.peer == WATCHER
    )


async def drain(end):
    while True:
        await end.socket.recv()


@pytest.fixture
def attackers(site):
    with Portal() as portal:
        attackers = Attackers(site)
        portal.run(attackers.open())
        attackers.portal = portal
        yield attackers
        portal.run(attackers.close())


@pytest.mark.nightly
@settings(
    max_examples=300,
    deadline=None,
    suppress_health_check=[
        HealthCheck.function_scoped_fixture,
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
    ],
)
@given(bad=BAD, forged=FORGED)
def test_only_stops_pass_beside_malformed_and_forged_frames(attackers, bad, forged):
    attackers.portal.run(attackers.try_one(bad, forged))


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


async def test_session_manager_renews_the_lease_and_offers_the_robot_to_the_next(site):
    site.start("session-manager", ["manage.py", "run_session_manager"])
    try:
        async with RobotDouble(site) as robot, page(site, "ada") as ada, page(site, "bob") as bob:
            await robot.say("connection", words.online(), retain=True)
            granted = await ada.take(takeover=True)
            publishing = asyncio.create_task(publish_states(robot, granted))
            await until(lambda: leases(robot, granted) and leases(robot, granted)[-1].renewal > 0)
            await bob.say("session/take", protocol.Take())
            queued = await bob.expect("session/queued")
            await ada.say("session/leave", protocol.Leave())
            await ada.expect("session/ended")
            assert (await bob.expect("session/offered")).session == queued.session
            granted = await bob.take(takeover=True)
            assert granted.session == queued.session
            await leave(bob)
            publishing.cancel()
    finally:
        site.stop("session-manager")


async def publish_states(robot, granted):
    own = {"session": granted.session, "epoch": granted.epoch, "visitor_silence": 0.1}
    seq = 0
    while True:
        seq += 1
        await robot.say("state", words.state(seq=seq, stamp=time.time(), **own))
        await asyncio.sleep(0.25)


def test_web_server_logged_no_traceback(site):
    for log in (site.var / "log").glob("web*.log"):
        assert "Traceback" not in log.read_text(errors="replace")
    assert codec.MAX_FRAME > protocol.MAX_FRAME
