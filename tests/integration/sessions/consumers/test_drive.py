"""The page's WebSocket in the whole ASGI application, with a bridge in memory."""

import asyncio
import importlib
import time

import msgspec
import pytest
from asgiref.sync import sync_to_async
from django.conf import settings
from django.contrib.auth import get_user_model
from django.db import OperationalError
from django.utils import timezone

from robots.api import messages as m
from robots.api.errors import Rejection
from robots.models import Robot, RobotPermit
from robots.process import log_ids
from sessions import protocol
from sessions.consumers import drive, last_seen, queries
from sessions.consumers.authorization import Authorization
from sessions.leases import store
from sessions.models import Lease, Session
from telepresence_site import asgi
from tests.support import words
from tests.support.browsers.pages import Page
from tests.support.patience import patient, until
from tests.support.robots import online_robot, update_robots

pytestmark = pytest.mark.django_db(transaction=True)
STOP = m.Stop(action_id="s1", stamp=1.0)


@pytest.fixture
def robot(db):
    return online_robot(boot="b1", max_linear=0.4)


async def set_robots(**fields):
    await Robot.objects.aupdate(**fields)


async def permitted(robot, user, kind):
    return await RobotPermit.objects.acreate(robot=robot, user=user, kind=kind)


async def end(session, outcome, reason):
    await sync_to_async(store.end)(session, outcome, reason, timezone.now())


# --- access ---------------------------------------------------------------------------------------


async def test_each_page_gets_its_own_peer_from_the_server(bridge, robot, ada):
    async with Page("giraff", ada) as one, Page("giraff", ada) as two:
        hello, other = await one.expect("hello"), await two.expect("hello")
    assert hello.robot == "giraff"
    assert all((hello.online, hello.may_drive, hello.may_observe))
    assert hello.peer != other.peer
    assert len(hello.peer) >= 16


async def test_page_without_login_is_refused(bridge, robot):
    page = Page("giraff")
    assert await page.open()
    assert await page.closed() == protocol.SIGNED_OUT
    assert page.seen == []


@pytest.mark.parametrize(
    "origin", [None, "http://evil.example.org", "null", "http://127.0.0.1.evil.example.org"]
)
async def test_missing_or_foreign_origin_is_refused(bridge, robot, ada, origin):
    assert not await Page("giraff", ada, origin=origin).open()


async def test_number_of_open_pages_is_limited_for_each_visitor(
    bridge, robot, ada, bob, monkeypatch
):
    monkeypatch.setattr(asgi.pages, "_limit", 2)
    async with Page("giraff", ada):
        async with Page("giraff", ada):
            assert not await Page("giraff", ada).open()
            async with Page("giraff", bob):
                pass
        async with Page("giraff", ada) as page:
            await page.expect("hello")


async def test_page_of_an_unknown_robot_is_closed(bridge, robot, ada):
    page = Page("nobody", ada)
    await page.open()
    assert await page.closed() == protocol.NO_SUCH_ROBOT


async def test_robot_by_invitation_is_closed_to_others(bridge, robot, ada, bob):
    await set_robots(access=Robot.Access.INVITATION)
    await permitted(robot, ada, RobotPermit.Privilege.INVITED)
    stranger = Page("giraff", bob)
    await stranger.open()
    assert await stranger.closed() == protocol.NOT_ALLOWED
    async with Page("giraff", ada) as guest:
        assert (await guest.expect("hello")).may_drive


# --- driving --------------------------------------------------------------------------------------


async def test_free_robot_is_granted_and_its_lease_is_published_at_once(bridge, driver):
    (lease,) = [lease for _, lease in bridge.leases]
    named = (driver.granted.session, driver.granted.epoch, driver.granted.peer)
    assert (lease.session, lease.epoch, lease.peer) == named
    assert lease.who == "Ada"
    assert lease.limits == driver.granted.limits == m.LeaseLimits(linear=0.4)
    row = await Lease.objects.aget()
    assert (str(row.session_id), row.epoch, row.peer) == named
    assert (await Session.objects.aget()).device["browser"] == "Firefox"


async def test_drivers_commands_reach_the_robot_with_the_identity_set_by_the_server(bridge, driver):
    await driver.say("command/velocity", words.velocity(seq=3))
    await driver.say("command/heartbeat", m.CommandHeartbeat(n=4, stamp=1.0, peer="forged"))
    tilt = m.Tilt(action_id="t1", stamp=1.0, angle=0.2, role="owner", user="Mallory")
    await driver.say("command/action", tilt)
    offer = m.SdpOffer(sdp="v=0", role="screen", session="forged", epoch=99, who="Mallory")
    await driver.say("signal", offer)
    await driver.settle(bridge)
    assert bridge.commands() == [
        words.velocity(seq=3, session=driver.granted.session, epoch=driver.granted.epoch)
    ]
    assert bridge.commands("command/heartbeat")[0].peer == driver.granted.peer
    (tilt,) = bridge.commands("command/action")
    stamped = ("driver", "Ada", driver.granted.session, driver.granted.epoch)
    assert (tilt.role, tilt.user, tilt.session, tilt.epoch) == stamped
    (offer,) = bridge.commands(f"signal/{driver.granted.peer}")
    assert (offer.role, offer.who, offer.session, offer.epoch) == stamped


async def test_forged_commands_of_an_observer_do_not_reach_the_robot(bridge, driver, watcher):
    forged = {"session": driver.granted.session, "epoch": driver.granted.epoch}
    for suffix, message in (
        ("command/velocity", words.velocity(**forged)),
        ("command/heartbeat", m.CommandHeartbeat(n=1, stamp=1.0, peer=driver.granted.peer)),
        ("command/action", m.Goto(action_id="g", stamp=1.0, x=1.0, y=1.0, **forged)),
        ("command/action", m.ClearEStop(action_id="c", stamp=1.0, role="owner", user="Ada")),
        ("signal", m.SdpOffer(sdp="v=0", role="driver", **forged)),
    ):
        await watcher.say(suffix, message)
    await watcher.settle(bridge)
    denials = [await watcher.denied() for _ in range(4)]
    assert denials == [
        ("command/velocity", "observer"),
        ("command/heartbeat", "observer"),
        ("command/action", "observer"),
        ("command/action", "not_allowed"),
    ]
    (_, suffix, offer), *_bye = bridge.sent
    assert suffix.startswith("signal/")
    assert driver.granted.peer not in suffix
    assert (offer.role, offer.session, offer.epoch) == ("observer", None, 0)


async def test_stop_passes_from_a_visitor_who_waits(bridge, driver, other):
    await other.queue()
    await other.say("command/action", STOP)
    await until(lambda: bridge.stops)
    assert bridge.stops[0][1].role == "observer"


async def test_operator_clears_an_emergency_stop_and_the_driver_cannot(bridge, robot, ada, bob):
    await permitted(robot, bob, RobotPermit.Privilege.OPERATOR)
    clear = m.ClearEStop(action_id="c", stamp=1.0)
    async with Page("giraff", ada) as driver, Page("giraff", bob) as operator:
        await driver.take()
        await driver.say("command/action", clear)
        assert (await driver.expect("denied")).reason == "not_allowed"
        await operator.say("command/action", clear)
        await until(lambda: bridge.commands("command/action"))
    (sent,) = bridge.commands("command/action")
    assert (sent.role, sent.user) == ("staff", "Bob")
    # of the server's clock: the robot has no clock offset of an operator
    assert abs(sent.stamp - time.time()) < 60


async def test_rate_of_a_page_is_limited_and_a_flood_closes_it(bridge, robot, ada, monkeypatch):
    receive = Authorization.receive
    monkeypatch.setattr(
        Authorization,
        "receive",
        lambda authorization, frame, lease, _now: receive(authorization, frame, lease, 1000.0),
    )  # all at one time
    async with Page("giraff", ada) as page:
        await page.take()
        for seq in range(90):
            await page.say("command/velocity", words.velocity(seq=seq))
        assert (await page.expect("denied")).reason == "rate"
        for _ in range(800):
            await page.say_frame("nonsense")
        assert await page.closed() == protocol.FLOODED
    assert len(bridge.commands()) == 60


# --- the queue ------------------------------------------------------------------------------------


async def test_second_visitor_waits_and_gets_the_robot_when_the_first_leaves(bridge, driver, other):
    queued = await other.queue()
    assert queued.place == 1
    await driver.say("session/leave", protocol.Leave())
    assert (await driver.expect("session/ended")).outcome == "cancelled"
    assert bridge.leases[-1] == ("giraff", None)
    later = await other.take()
    assert later.session == queued.session != driver.granted.session
    assert later.epoch > driver.granted.epoch
    assert bridge.leases[-1][1].who == "Bob"


async def test_notices_reach_the_page_of_their_session_and_no_other(bridge, driver, other):
    session = (await other.queue()).session
    bridge.notify(protocol.Queued(session=session, place=1, minutes=3.5))
    bridge.notify(protocol.Offered(session=session, seconds=60.0))
    bridge.notify(protocol.TurnWarning(session=driver.granted.session, remaining=90.0))
    bridge.notify(protocol.PresenceAsked(session=driver.granted.session, seconds=30.0))
    bridge.notify(protocol.PresenceConfirmed(session=driver.granted.session))
    assert (await other.expect("session/queued")).minutes == 3.5
    assert (await other.expect("session/offered")).seconds == 60.0
    assert (await driver.expect("session/turn_warning")).remaining == 90.0
    assert (await driver.expect("session/asked_there")).seconds == 30.0
    await driver.expect("session/found_there")
    assert other.told("session/turn_warning") == driver.told("session/offered") == []


async def test_malformed_notice_is_logged_and_the_page_goes_on(bridge, driver, caplog):
    for frame in ("", "session/ended", 'session/ended\n{"session": 1}', "state\n{}"):
        bridge.delivery.bring_notice(driver.granted.session, frame)
    bridge.notify(protocol.TurnWarning(session=driver.granted.session, remaining=9.0))
    assert (await driver.expect("session/turn_warning")).remaining == 9.0
    assert caplog.text.count("notice_rejected") == 4


async def test_driver_whom_an_operator_stops_is_notified_and_no_longer_drives(bridge, driver):
    outcome, reason = "stopped_by_operator", "closing time"
    bridge.notify(protocol.Ended(session=driver.granted.session, outcome=outcome, reason=reason))
    ended = await driver.expect("session/ended")
    await driver.say("command/velocity", words.velocity())
    assert (await driver.expect("denied")).reason == "not_driver"
    assert (ended.outcome, ended.reason) == (outcome, reason)
    assert bridge.commands() == []
    assert bridge.commands(f"signal/{driver.granted.peer}") == [m.Bye(reason="left")]


async def test_second_tab_is_refused_or_takes_over_and_the_first_is_notified(bridge, robot, ada):
    async with Page("giraff", ada) as first_tab, Page("giraff", ada) as second_tab:
        granted = await first_tab.take()
        await second_tab.say("session/take", protocol.Take())
        refused = await second_tab.expect("session/refused")
        assert (refused.reason, refused.session) == ("elsewhere", granted.session)
        assert refused.since == pytest.approx(time.time(), abs=patient(30.0))
        async with Page("giraff", ada) as third_tab:
            hello = await third_tab.expect("hello")
            assert (hello.live_elsewhere, hello.live_since) == (True, refused.since)
        await Session.objects.filter(pk=granted.session).aupdate(state="reconnecting")
        async with Page("giraff", ada) as late_tab:  # no page drives it: each may resume
            hello = await late_tab.expect("hello")
            assert (hello.live_elsewhere, hello.live_since) == (False, refused.since)
        await Session.objects.filter(pk=granted.session).aupdate(state="driving")
        moved = await second_tab.take(session=granted.session, takeover=True)
        ended = await first_tab.expect("session/ended")
        await first_tab.say(
            "command/velocity", words.velocity(session=moved.session, epoch=moved.epoch)
        )
        assert (await first_tab.expect("denied")).reason == "not_driver"
    assert (ended.session, ended.outcome) == (granted.session, "moved")
    assert (moved.session, moved.resumed) == (granted.session, False)
    assert moved.epoch > granted.epoch


async def test_page_that_lost_its_socket_resumes_with_its_old_peer_and_epoch(bridge, driver, ada):
    async with Page("giraff", ada) as back:
        again = await back.take(session=driver.granted.session, peer=driver.granted.peer)
        assert again.resumed
        assert (again.peer, again.epoch) == (driver.granted.peer, driver.granted.epoch)
        assert await driver.closed() == protocol.REPLACED
        await back.say("command/velocity", words.velocity(seq=9))
        await back.settle(bridge)
        bridge.say("giraff", f"signal/{driver.granted.peer}/reply", m.SdpAnswer(sdp="v=0"))
        assert (await back.expect("signal/reply")).sdp == "v=0"
        await driver.close()
        assert bridge.stops == []
        assert (await Session.objects.aget()).seen_at is not None
    assert bridge.commands()[0].epoch == driver.granted.epoch


async def test_knowing_the_drivers_peer_does_not_give_the_robot_to_others(bridge, driver, other):
    await other.say(
        "session/take",
        protocol.Take(session=driver.granted.session, peer=driver.granted.peer, takeover=True),
    )
    refused = await other.expect("session/refused")
    assert (refused.reason, refused.outcome) == ("ended", "")
    await other.say(
        "command/velocity",
        words.velocity(session=driver.granted.session, epoch=driver.granted.epoch),
    )
    assert (await other.expect("denied")).reason == "not_driver"
    assert bridge.commands() == []


# --- messages of the robot ------------------------------------------------------------------------


async def test_messages_of_a_robot_reach_all_of_its_pages_and_no_others(bridge, robot, ada, bob):
    await sync_to_async(Robot.objects.create)(name="rhodon", title="Rhodon")
    async with (
        Page("giraff", ada) as one,
        Page("giraff", bob) as two,
        Page("rhodon", bob) as elsewhere,
    ):
        for page in (one, two, elsewhere):
            await page.expect("hello")
        bridge.say("giraff", "state", words.state(seq=5))
        bridge.say("giraff", "pose", words.pose())
        bridge.say("giraff", "event", m.Event(stamp=1.0, boot="b1", seq=6, type="docked"))
        bridge.say("giraff", "action", m.ActionStatus(action_id="a", status="FINISHED", stamp=1.0))
        for page in (one, two):
            assert (await page.expect("state")).seq == 5
            assert (await page.expect("pose")).stamp == 1.0
            assert (await page.expect("event")).type == "docked"
            assert (await page.expect("action")).status == "FINISHED"
        bridge.say("rhodon", "state", words.state(seq=1))
        assert (await elsewhere.expect("state")).seq == 1


async def test_replies_and_echoes_reach_only_their_own_peer(bridge, driver, other):
    own = (await other.expect("hello")).peer
    echoes = tuple(
        m.Echo(peer=peer, n=1, stamp=1.0, received=2.0)
        for peer in (driver.granted.peer, own, "server")
    )
    bridge.say("giraff", "heartbeat", m.Heartbeat(n=1, stamp=1.0, echoes=echoes))
    bridge.say("giraff", f"signal/{driver.granted.peer}/reply", m.SdpAnswer(sdp="for ada"))
    bridge.say("giraff", f"signal/{own}/reply", m.SdpAnswer(sdp="for bob"))
    assert [echo.peer for echo in (await driver.expect("heartbeat")).echoes] == [
        driver.granted.peer
    ]
    assert [echo.peer for echo in (await other.expect("heartbeat")).echoes] == [own]
    assert (await driver.expect("signal/reply")).sdp == "for ada"
    assert (await other.expect("signal/reply")).sdp == "for bob"


async def test_every_page_shows_the_driver_and_how_many_watch_and_wait(bridge, driver, other):
    await other.say("session/observe", protocol.Observe())
    await driver.expect(
        "room",
        lambda room: (room.driver, room.observers, room.driving) == ("Ada", 1, False),
    )
    state = words.state(session=driver.granted.session, epoch=driver.granted.epoch, viewers=4)
    bridge.say("giraff", "state", state)
    await other.expect("room", lambda room: room.driving and room.observers == 3)
    await other.say("session/take", protocol.Take())
    await driver.expect("room", lambda room: room.waiting == 1)


async def test_visitor_who_closes_the_page_no_longer_counts_as_waiting(driver, bob):
    async with Page("giraff", bob) as other:
        await other.say("session/take", protocol.Take())
        await driver.expect("room", lambda room: room.waiting == 1)
    await driver.expect("room", lambda room: room.waiting == 0)


async def test_visitor_who_waits_and_watches_is_counted_once(driver, other):
    await other.queue()
    await other.observe()
    await driver.expect("room", lambda room: (room.observers, room.waiting) == (0, 1))
    assert max(room.observers for room in driver.told("room")) == 0


@pytest.mark.parametrize("by", ["visitor", "session manager"])
async def test_every_page_shows_what_a_robot_does_after_a_visit(bridge, robot, ada, bob, by):
    can_dock = {"capabilities": ["dock"]}
    await sync_to_async(update_robots)(returns_home=True, factsheet=can_dock)
    async with Page("giraff", ada) as driver, Page("giraff", bob) as other:
        granted = await driver.take()
        if by == "visitor":
            await driver.say("session/leave", protocol.Leave())
        else:
            await end(granted.session, "timed_out", "")
            bridge.say("giraff", "lease", None)
        for page in (driver, other):
            await page.expect(
                "room", lambda room: (room.driver, room.pause) == (None, "returning: dock")
            )
    async with Page("giraff", bob) as later:
        await later.expect("room", lambda room: room.pause == "returning: dock")


async def test_pages_show_an_offline_robot_and_ignore_a_late_last_will(bridge, page):
    await page.expect("hello")
    bridge.say("giraff", "connection", words.online("b2"))
    bridge.say("giraff", "connection", words.broken("b1"))
    bridge.say("giraff", "connection", words.broken("b2"))
    assert not (await page.expect("robot")).online
    bridge.say("giraff", "connection", words.online("b3"))
    assert (await page.expect("robot")).online
    assert [presence.online for presence in page.told("robot")] == [False, True]


async def test_observers_leave_one_of_the_robots_viewers_to_the_driver(bridge, page, other):
    bridge.say("giraff", "factsheet", words.factsheet(viewers=2))
    await page.observe()
    await other.say("session/observe", protocol.Observe())
    assert (await other.expect("session/refused")).reason == "observers_full"
    await page.say("session/leave", protocol.Leave())
    await other.expect("room", lambda room: room.observers == 0)
    await other.observe()


async def test_observing_is_refused_if_the_robot_allows_no_observers(bridge, robot, ada):
    await set_robots(observers_allowed=False)
    async with Page("giraff", ada) as page:
        await page.say("session/observe", protocol.Observe())
        assert (await page.expect("session/refused")).reason == "not_allowed"


async def test_only_the_driver_chooses_the_assistance(bridge, driver, other):
    await driver.say("session/assist", protocol.Assist(level="steer"))
    await until(lambda: bridge.leases[-1][1] and bridge.leases[-1][1].assist == "steer")
    assert (bridge.leases[-1][1].epoch, bridge.leases[-1][1].renewal) == (driver.granted.epoch, 1)
    await other.say("session/assist", protocol.Assist(level="off"))
    assert (await other.expect("denied")).reason == "not_driver"
    session = await Session.objects.aget()
    assert session.assist == "steer"


# --- closed sockets and leaving -------------------------------------------------------------------


async def test_closing_the_socket_stops_the_robot_once_and_the_session_goes_on(bridge, driver):
    await driver.say("command/velocity", words.velocity(seq=21))
    await driver.settle(bridge)
    await driver.close()
    ((_, stop),) = bridge.stops
    stopped = (stop.role, stop.session, stop.epoch, stop.seq)
    assert stopped == ("driver", driver.granted.session, driver.granted.epoch, 21)
    session = await Session.objects.aget()
    assert session.state != "ended"
    assert session.seen_at is None


async def test_closing_the_socket_stops_nothing_while_the_data_channel_drives(bridge, driver):
    await driver.say("command/heartbeat", m.CommandHeartbeat(n=1, stamp=1.0))
    await driver.settle(bridge)
    await driver.close()
    assert bridge.stops == []


async def test_page_that_closes_during_a_take_leaves_an_unseen_session(bridge, robot, ada):
    page = Page("giraff", ada)
    await page.open()
    await page.expect("hello")
    await page.say("session/take", protocol.Take())
    await page.close()
    session = await Session.objects.aget()
    assert session.seen_at is None
    assert bridge.leases[0][1].session == str(session.pk)


async def test_session_left_without_a_connection_ends_when_the_page_reconnects(bridge, driver, ada):
    await driver.close()
    async with Page("giraff", ada) as back:
        leave = protocol.Leave(session=driver.granted.session, peer=driver.granted.peer)
        await back.say("session/leave", leave)
        ended = await back.expect("session/ended")
        await back.say("session/leave", leave)
        again = await back.expect("session/ended")
    assert (ended.session, ended.outcome, ended.reason) == (
        driver.granted.session,
        "cancelled",
        "left",
    )
    assert again == ended
    assert bridge.leases[-1] == ("giraff", None)


async def test_late_leave_ends_neither_a_moved_session_nor_one_of_another_visitor(
    bridge, robot, ada, bob
):
    async with Page("giraff", ada) as page, Page("giraff", bob) as foreign:
        granted = await page.take()
        await foreign.say(
            "session/leave", protocol.Leave(session=granted.session, peer=granted.peer)
        )
        assert (await foreign.expect("denied")).reason == "not_yours"
        async with Page("giraff", ada) as other:
            await other.say(
                "session/leave", protocol.Leave(session=granted.session, peer="someone-else")
            )
            assert (await other.expect("session/ended")).outcome == "moved"
    session = await Session.objects.aget()
    assert not session.outcome
    assert bridge.leases[-1][1].session == granted.session


async def test_failed_connection_leaves_no_listener(bridge, other, ada, monkeypatch):
    page = Page("giraff", ada)
    await page.open()
    await page.take()
    await other.expect("room", lambda room: room.driver == "Ada")

    def fail(*_arguments, **_frame):
        raise RuntimeError("a fault of ours")

    monkeypatch.setattr(drive.RobotConsumer, "receive", fail)
    await page.say("session/leave", protocol.Leave())
    with pytest.raises(RuntimeError, match="a fault of ours"):
        await asyncio.wait_for(page.socket.future, patient(10))
    monkeypatch.undo()
    listeners = bridge.delivery._listeners["giraff"]
    assert sum(isinstance(one, drive.RobotConsumer) for one in listeners) == 1
    assert bridge.delivery._followers == {}


# --- the broker is unreachable --------------------------------------------------------------------


async def test_without_a_broker_velocities_are_dropped_and_actions_are_denied(bridge, driver):
    bridge.lose_broker()
    await driver.say("command/velocity", words.velocity(seq=1))
    await driver.say("signal", m.SdpOffer(sdp="v=0"))
    await driver.say("command/action", m.Photo(action_id="p", stamp=1.0))
    assert (await driver.expect("robot")).reason == "server"
    for suffix in ("signal", "command/action"):
        assert await driver.denied() == (suffix, "robot_unreachable")
    await driver.say("command/action", STOP)
    await until(lambda: bridge.stops)
    bridge.find_broker()
    await driver.settle(bridge)
    assert bridge.sent == []


async def test_signal_to_an_offline_robot_is_denied(bridge, driver):
    bridge.say("giraff", "connection", words.broken())
    await driver.say("signal", m.SdpOffer(sdp="v=0"))
    assert (await driver.expect("denied")).reason == "robot_unreachable"
    assert bridge.sent == []


async def test_lease_is_published_again_when_the_broker_is_reachable_again(bridge, driver):
    bridge.say("giraff", "lease", msgspec.structs.replace(bridge.leases[0][1], renewal=6))
    bridge.lose_broker()
    bridge.find_broker()
    await until(lambda: len(bridge.leases) == 2)
    again = bridge.leases[1][1]
    named = (driver.granted.session, driver.granted.epoch, driver.granted.peer)
    assert (again.session, again.epoch, again.peer, again.renewal) == (*named, 6)


async def test_session_that_ended_without_a_broker_is_reported_and_not_revived(bridge, driver):
    bridge.lose_broker()
    await end(driver.granted.session, "timed_out", "turn_over")
    bridge.find_broker()
    ended = await driver.expect("session/ended")
    assert (ended.outcome, ended.reason) == ("timed_out", "turn_over")
    assert len(bridge.leases) == 1


async def test_late_empty_lease_ends_no_drive(bridge, driver):
    bridge.say("giraff", "lease", None)
    await until(lambda: len(bridge.leases) == 2)
    assert bridge.leases[1][1].renewal > bridge.leases[0][1].renewal
    await driver.say("command/velocity", words.velocity())
    await driver.settle(bridge)
    assert bridge.commands()[0].epoch == driver.granted.epoch


async def test_offer_that_was_made_without_a_broker_is_sent_again(bridge, driver, other):
    session = (await other.queue()).session
    bridge.lose_broker()
    await sync_to_async(Session.objects.filter(pk=session).update)(offered_at=timezone.now())
    bridge.find_broker()
    assert 0.0 < (await other.expect("session/offered")).seconds <= 60.0


# --- lost access ----------------------------------------------------------------------------------


async def sign_out(page):
    engine = importlib.import_module(settings.SESSION_ENGINE)
    await engine.SessionStore(page.cookie).adelete()


async def test_visitor_who_has_signed_out_in_another_tab_cannot_take_the_robot(bridge, page):
    await page.expect("hello")
    await sign_out(page)
    await page.say("session/take", protocol.Take())
    assert await page.closed() == protocol.SIGNED_OUT
    assert bridge.leases == []


@pytest.fixture
def often(monkeypatch):
    """Have pages recorded as seen, and their permissions checked, often."""
    monkeypatch.setattr(drive, "PAGE_SEEN_EVERY", 0.05)
    monkeypatch.setattr(drive, "WELCOME_EVERY", 0.1)


@pytest.fixture
def permit(robot, ada):
    """The permit without which Ada may not drive."""
    Robot.objects.update(access=Robot.Access.TRAINED)
    kind = RobotPermit.Privilege.TRAINED
    return RobotPermit.objects.create(robot=robot, user=ada, kind=kind)


@pytest.mark.parametrize("lost", ["session", "permit", "account"])
async def test_driver_who_loses_access_is_disconnected_within_a_minute(
    bridge, often, permit, driver, lost
):
    if lost == "session":
        await sign_out(driver)
    elif lost == "permit":
        await sync_to_async(permit.delete)()
    else:
        await sync_to_async(get_user_model().objects.update)(is_active=False)
    code = protocol.NOT_ALLOWED if lost == "permit" else protocol.SIGNED_OUT
    assert await driver.closed() == code
    await driver.close()
    assert bridge.leases[-1] == ("giraff", None)
    assert bridge.commands(f"signal/{driver.granted.peer}") == [m.Bye(reason="left")]
    session = await Session.objects.aget()
    assert (session.state, session.outcome) == ("ended", "stopped_by_operator")


def signals(bridge) -> list[m.Message]:
    """Return the signals that were sent to the robot, of all pages."""
    return [message for _, suffix, message in bridge.sent if suffix.startswith("signal/")]


async def test_watching_ends_with_the_pages_socket(bridge, driver, bob):
    """The video connection needs no socket: it would go on until the server ends it."""
    async with Page("giraff", bob) as observer:
        await observer.observe()
        assert signals(bridge) == []
    assert signals(bridge) == [m.Bye(reason="left")]
    await driver.close()
    assert signals(bridge) == [m.Bye(reason="left")], "the lease ends the driver's connection"


async def test_server_keeps_only_the_connections_of_observers(bridge, often, driver, watcher):
    await until(lambda: signals(bridge).count(m.Stay()) >= 3)
    assert bridge.commands(f"signal/{driver.granted.peer}") == []


async def test_watching_ends_within_a_minute_after_the_permission(bridge, often, page):
    await page.observe()
    await set_robots(observers_allowed=False)
    assert (await page.expect("session/refused")).reason == "not_allowed"
    assert [one for one in signals(bridge) if one != m.Stay()] == [m.Bye(reason="left")]
    await page.say("session/observe", protocol.Observe())
    assert (await page.expect("session/refused")).reason == "not_allowed"
    assert (await page.take()).session, "driving is still allowed"


async def test_former_operator_clears_no_stop_from_a_page_that_is_still_open(bridge, robot, ada):
    permit = await permitted(robot, ada, RobotPermit.Privilege.OPERATOR)
    clear = m.ClearEStop(action_id="c", stamp=1.0)
    async with Page("giraff", ada) as page:
        await page.say("command/action", clear)
        await until(lambda: bridge.commands("command/action"))
        await sync_to_async(permit.delete)()
        await page.say("command/action", clear)
        assert (await page.expect("denied")).reason == "not_allowed"
    assert len(bridge.commands("command/action")) == 1


async def test_open_page_is_recorded_as_seen_and_shows_that_its_session_ended(often, driver):
    before = (await Session.objects.aget()).seen_at
    async with asyncio.timeout(patient(5)):
        while (await Session.objects.aget()).seen_at == before:
            await asyncio.sleep(0.02)
    await end(driver.granted.session, "robot_fault", "robot_offline")
    assert (await driver.expect("session/ended")).outcome == "robot_fault"


async def test_page_that_reconnects_too_late_shows_how_its_session_ended(driver, ada):
    old = driver.granted
    await driver.close()
    await end(old.session, "robot_fault", "robot_offline")
    async with Page("giraff", ada) as page:
        await page.say("session/take", protocol.Take(session=old.session, peer=old.peer))
        refused = await page.expect("session/refused")
    assert (refused.reason, refused.outcome) == ("ended", "robot_fault")


async def test_page_that_closes_before_it_is_recorded_as_seen_counts_as_gone(
    bridge, robot, ada, monkeypatch
):
    monkeypatch.setattr(drive, "PAGE_SEEN_EVERY", 0.01)
    monkeypatch.setattr(last_seen, "GATHER_SECONDS", 0.3)
    async with Page("giraff", ada) as page:
        await page.take()
        await asyncio.sleep(0.1)
    await asyncio.sleep(0.6)
    assert (await Session.objects.aget()).seen_at is None


async def test_take_is_denied_and_the_page_stays_open_when_the_database_fails(page, monkeypatch):
    def broken(*_arguments, **_named):
        raise OperationalError("database is locked")

    await page.expect("hello")
    monkeypatch.setattr(queries, "take", broken)
    await page.say("session/take", protocol.Take())
    assert (await page.expect("denied")).reason == "unavailable"
    monkeypatch.undo()
    await page.take()


# --- the record -----------------------------------------------------------------------------------


async def test_reports_of_a_page_reach_the_session_manager(bridge, driver):
    await driver.say(
        "page/network", protocol.PageNetwork(stamp=1.0, way="datachannel", round_trip=0.01)
    )
    await driver.settle(bridge)
    ((topic, report),) = bridge.reports
    assert topic == f"telepresence/v1/server/page/{driver.granted.session}"
    assert msgspec.json.decode(report.message, type=protocol.PageNetwork).round_trip == 0.01


# --- pictures through the server ------------------------------------------------------------------

JPEG = b"\xff\xd8\xff\xe0 a picture \xff\xd9"


async def test_picture_reaches_only_the_pages_that_requested_it(bridge, robot, ada, bob):
    async with (
        Page("giraff", ada) as driver,
        Page("giraff", bob) as watcher,
        Page("giraff", bob) as guest,
    ):
        await driver.take()
        await watcher.observe()
        for page in (driver, watcher, guest):
            await page.say("command/picture", m.PictureRequest(stamp=1.0))
        await until(lambda: len(bridge.commands("command/picture")) == 2)
        peers = {request.peer for request in bridge.commands("command/picture")}
        assert (await guest.expect("denied")).reason == "no_role"
        bridge.say_picture("giraff", 5.0, JPEG)
        assert await driver.expect("picture") == (5.0, JPEG)
        assert await watcher.expect("picture") == (5.0, JPEG)
        bridge.say_picture("giraff", 6.0, JPEG)
        for page in (driver, watcher, guest):
            await page.settle(bridge)
            bridge.say("giraff", "state", words.state(seq=7))
            await page.expect("state")
    assert "page" not in peers
    assert len(peers) == 2
    assert [len(page.told("picture")) for page in (driver, watcher, guest)] == [1, 1, 0]


async def test_picture_for_one_peer_reaches_no_other_page(bridge, driver, watcher):
    await watcher.say("command/picture", m.PictureRequest(stamp=1.0))
    await until(lambda: bridge.commands("command/picture"))
    watching = bridge.commands("command/picture")[0].peer
    await driver.say("command/picture", m.PictureRequest(stamp=1.0))
    await until(lambda: len(bridge.commands("command/picture")) == 2)
    driving = bridge.commands("command/picture")[1].peer
    bridge.say_picture("giraff", 5.0, JPEG, watching)
    assert await watcher.expect("picture") == (5.0, JPEG)
    bridge.say_picture("giraff", 6.0, JPEG, driving)
    assert await driver.expect("picture") == (6.0, JPEG)
    assert [len(page.told("picture")) for page in (driver, watcher)] == [1, 1]


async def test_picture_of_another_robot_or_a_malformed_one_reaches_no_page(bridge, driver):
    await driver.say("command/picture", m.PictureRequest(stamp=1.0))
    await until(lambda: bridge.commands("command/picture"))
    bridge.say_picture("rhodon", 5.0, JPEG)
    with pytest.raises(Rejection):
        bridge.delivery.arrive(
            "telepresence/v1/giraff/picture", b"no picture at all", time.monotonic()
        )
    with pytest.raises(Rejection):
        bridge.say_picture("giraff", 5.0, JPEG[:-2] + b"x" * 50_000 + JPEG[-2:])
    bridge.say_picture("giraff", 6.0, JPEG)
    assert await driver.expect("picture") == (6.0, JPEG)


async def test_no_picture_arrives_after_the_session(bridge, driver):
    await driver.say("command/picture", m.PictureRequest(stamp=1.0))
    await until(lambda: bridge.commands("command/picture"))
    await driver.say("session/leave", protocol.Leave())
    await driver.expect("session/ended")
    bridge.say_picture("giraff", 6.0, JPEG)
    bridge.say("giraff", "state", words.state(seq=7))
    await driver.expect("state")
    assert driver.told("picture") == []


# --- ids in log lines -----------------------------------------------------------------------------


async def test_log_lines_about_a_page_name_its_request_robot_and_session(
    bridge, robot, ada, monkeypatch
):
    monkeypatch.setattr(log_ids, "_process", {})  # ids that this process has set
    about, handle_message = [], drive.RobotConsumer._handle_message

    def noting(page, inbound):
        about.append((inbound.suffix, log_ids.current()))
        handle_message(page, inbound)

    monkeypatch.setattr(drive.RobotConsumer, "_handle_message", noting)
    async with Page("giraff", ada) as page:
        await page.say("session/take", protocol.Take())
        granted = await page.expect("session/granted")
        bridge.say("giraff", "state", words.state())
        await page.expect("state")
    ids = next(ids for suffix, ids in reversed(about) if suffix == "state")
    assert (ids["robot"], ids["session"], len(ids["request"])) == ("giraff", granted.session, 16)
    assert log_ids.current() == {}
