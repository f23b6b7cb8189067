"""The page's WebSocket through the whole ASGI application, with a bridge in memory and a real
database.
"""

import asyncio
import time

import msgspec
import pytest
from asgiref.sync import sync_to_async
from django.contrib.auth import get_user_model
from django.utils import timezone

from robots import log_ids
from robots.api import messages as m
from robots.api.errors import Rejection
from robots.models import Robot, RobotPermit
from sessions import protocol
from sessions.consumers import drive, last_seen
from sessions.leases import store
from sessions.models import Lease, Session
from telepresence_site import asgi
from tests.support import words
from tests.support.browsers.pages import Page, until
from tests.support.patience import patient
from tests.support.robots import create_robot, update_robots

pytestmark = pytest.mark.django_db(transaction=True)
STOP = m.Stop(action_id="s1", stamp=1.0)


@pytest.fixture
def robot(db):
    return create_robot(
        name="giraff",
        title="Giraff",
        connection="ONLINE",
        boot="b1",
        last_seen_at=timezone.now(),
        max_linear=0.4,
    )


@pytest.fixture
def ada(db):
    return get_user_model().objects.create_user("ada", display_name="Ada L.", password="x")


def rows(query):
    return sync_to_async(lambda: list(query.all()))()


async def first(query):
    return (await rows(query))[0]


# --- who comes in ---------------------------------------------------------------------------------


async def test_a_visitor_is_greeted_with_a_peer_of_the_servers_making(bridge, robot, ada):
    async with Page("giraff", ada) as one, Page("giraff", ada) as two:
        hello, other = await one.expect("hello"), await two.expect("hello")
    assert (hello.robot, hello.online, hello.may_drive, hello.may_observe) == (
        "giraff",
        True,
        True,
        True,
    )
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
async def test_a_missing_or_foreign_origin_is_refused(bridge, robot, ada, origin):
    assert not await Page("giraff", ada, origin=origin).open()


async def test_a_visitor_has_so_many_pages_open_and_another_one_when_one_has_gone(
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


async def test_there_is_no_page_for_a_robot_that_does_not_exist(bridge, robot, ada):
    page = Page("nobody", ada)
    await page.open()
    assert await page.closed() == protocol.NO_SUCH_ROBOT


async def test_a_robot_by_invitation_is_closed_to_others(bridge, robot, ada, bob):
    await sync_to_async(Robot.objects.update)(access=Robot.Access.INVITATION)
    await sync_to_async(RobotPermit.objects.create)(
        robot=robot, user=ada, kind=RobotPermit.Privilege.INVITED
    )
    stranger = Page("giraff", bob)
    await stranger.open()
    assert await stranger.closed() == protocol.NOT_ALLOWED
    async with Page("giraff", ada) as guest:
        assert (await guest.expect("hello")).may_drive


# --- driving --------------------------------------------------------------------------------------


async def test_a_free_robot_is_granted_and_its_lease_is_published_at_once(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        granted = await page.take()
        (lease,) = [lease for _, lease in bridge.leases]
    assert (lease.session, lease.epoch, lease.peer) == (
        granted.session,
        granted.epoch,
        granted.peer,
    )
    assert lease.who == "Ada L."
    assert lease.limits == granted.limits == m.LeaseLimits(linear=0.4)
    row = await first(Lease.objects)
    assert (str(row.session_id), row.epoch, row.peer) == (
        granted.session,
        granted.epoch,
        granted.peer,
    )
    assert (await first(Session.objects)).device["browser"] == "Firefox"


async def test_a_drivers_commands_reach_the_robot_under_the_servers_stamps(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        granted = await page.take()
        await page.say("command/velocity", words.velocity(seq=3))
        await page.say("command/heartbeat", m.CommandHeartbeat(n=4, stamp=1.0, peer="forged"))
        await page.say(
            "command/action",
            m.Tilt(action_id="t1", stamp=1.0, angle=0.2, role="owner", user="Mallory"),
        )
        await page.say(
            "signal",
            m.SdpOffer(sdp="v=0", role="screen", session="forged", epoch=99, who="Mallory"),
        )
        await page.settle(bridge)
    assert bridge.commands() == [
        words.velocity(seq=3, session=granted.session, epoch=granted.epoch)
    ]
    assert bridge.commands("command/heartbeat")[0].peer == granted.peer
    (tilt,) = bridge.commands("command/action")
    assert (tilt.role, tilt.user, tilt.session, tilt.epoch) == (
        "driver",
        "Ada L.",
        granted.session,
        granted.epoch,
    )
    (offer,) = bridge.commands(f"signal/{granted.peer}")
    assert (offer.role, offer.who, offer.session, offer.epoch) == (
        "driver",
        "Ada L.",
        granted.session,
        granted.epoch,
    )


async def test_an_observer_watches_and_whatever_it_forges_stays_here(bridge, robot, ada, bob):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as observer:
        granted = await driver.take()
        await observer.observe()
        await observer.say(
            "command/velocity", words.velocity(session=granted.session, epoch=granted.epoch)
        )
        await observer.say(
            "command/heartbeat", m.CommandHeartbeat(n=1, stamp=1.0, peer=granted.peer)
        )
        await observer.say(
            "command/action",
            m.Goto(
                action_id="g", stamp=1.0, x=1.0, y=1.0, session=granted.session, epoch=granted.epoch
            ),
        )
        await observer.say(
            "command/action", m.ClearEStop(action_id="c", stamp=1.0, role="owner", user="Ada L.")
        )
        await observer.say(
            "signal",
            m.SdpOffer(sdp="v=0", role="driver", session=granted.session, epoch=granted.epoch),
        )
        await observer.settle(bridge)
        denials = [(await observer.expect("denied")) for _ in range(4)]
    assert [(denied.suffix, denied.reason) for denied in denials] == [
        ("command/velocity", "observer"),
        ("command/heartbeat", "observer"),
        ("command/action", "observer"),
        ("command/action", "not_allowed"),
    ]
    (_, suffix, offer), *_bye = bridge.sent
    assert suffix.startswith("signal/")
    assert granted.peer not in suffix
    assert (offer.role, offer.session, offer.epoch) == ("observer", None, 0)


async def test_a_stop_passes_from_an_observer_and_from_who_waits(bridge, robot, ada, bob):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as other:
        await driver.take()
        await other.queue()
        await other.say("command/action", STOP)
        await until(lambda: bridge.stops)
    assert bridge.stops[0][1].role == "observer"


async def test_the_operator_clears_an_emergency_stop_and_the_driver_does_not(
    bridge, robot, ada, bob
):
    await sync_to_async(RobotPermit.objects.create)(
        robot=robot, user=bob, kind=RobotPermit.Privilege.OPERATOR
    )
    clear = m.ClearEStop(action_id="c", stamp=1.0)
    async with Page("giraff", ada) as driver, Page("giraff", bob) as operator:
        await driver.take()
        await driver.say("command/action", clear)
        assert (await driver.expect("denied")).reason == "not_allowed"
        await operator.say("command/action", clear)
        await until(lambda: bridge.commands("command/action"))
    (sent,) = bridge.commands("command/action")
    assert (sent.role, sent.user) == ("staff", "bob")
    # the server's clock: the robot knows no other of an operator
    assert abs(sent.stamp - time.time()) < 60


async def test_a_page_in_a_hurry_is_slowed_and_a_flood_ends_it(bridge, robot, ada, monkeypatch):
    from sessions.consumers.authorization import Authorization

    receive = Authorization.receive
    monkeypatch.setattr(
        Authorization,
        "receive",
        lambda authorization, frame, lease, _now: receive(authorization, frame, lease, 1000.0),
    )  # all at the same moment
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


async def test_a_second_visitor_waits_and_gets_the_robot_when_the_first_leaves(
    bridge, robot, ada, bob
):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as next_one:
        granted = await driver.take()
        queued = await next_one.queue()
        assert queued.place == 1
        await driver.say("session/leave", protocol.Leave())
        assert (await driver.expect("session/ended")).outcome == "cancelled"
        assert bridge.leases[-1] == ("giraff", None)
        later = await next_one.take()
    assert later.session == queued.session != granted.session
    assert later.epoch > granted.epoch
    assert bridge.leases[-1][1].who == "bob"


async def test_news_of_the_queue_reach_the_page_that_waits_and_no_other(bridge, robot, ada, bob):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as waiting:
        granted = await driver.take()
        session = (await waiting.queue()).session
        bridge.notify(protocol.Queued(session=session, place=1, minutes=3.5))
        bridge.notify(protocol.Offered(session=session, seconds=60.0))
        bridge.notify(protocol.TurnWarning(session=granted.session, remaining=90.0))
        bridge.notify(protocol.PresenceAsked(session=granted.session, seconds=30.0))
        bridge.notify(protocol.PresenceConfirmed(session=granted.session))
        assert (await waiting.expect("session/queued")).minutes == 3.5
        assert (await waiting.expect("session/offered")).seconds == 60.0
        assert (await driver.expect("session/turn_warning")).remaining == 90.0
        assert (await driver.expect("session/asked_there")).seconds == 30.0
        await driver.expect("session/found_there")
    assert waiting.told("session/turn_warning") == driver.told("session/offered") == []


async def test_a_notice_that_is_none_is_logged_and_the_page_goes_on(bridge, robot, ada, caplog):
    async with Page("giraff", ada) as page:
        granted = await page.take()
        for frame in ("", "session/ended", 'session/ended\n{"session": 1}', "state\n{}"):
            bridge.delivery.bring_notice(granted.session, frame)
        bridge.notify(protocol.TurnWarning(session=granted.session, remaining=9.0))
        assert (await page.expect("session/turn_warning")).remaining == 9.0
    assert caplog.text.count("notice_rejected") == 4


async def test_driver_whom_an_operator_stops_is_notified_and_no_longer_drives(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        granted = await page.take()
        bridge.notify(
            protocol.Ended(
                session=granted.session, outcome="stopped_by_operator", reason="closing time"
            )
        )
        ended = await page.expect("session/ended")
        await page.say("command/velocity", words.velocity())
        assert (await page.expect("denied")).reason == "not_driver"
    assert (ended.outcome, ended.reason) == ("stopped_by_operator", "closing time")
    assert bridge.commands() == []
    assert bridge.commands(f"signal/{granted.peer}") == [m.Bye(reason="left")]


async def test_a_second_tab_is_refused_or_takes_over_and_the_first_is_told(bridge, robot, ada):
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
        async with Page("giraff", ada) as late_tab:  # no page drives it: any may resume
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


async def test_a_page_that_lost_its_socket_resumes_with_its_old_peer_and_epoch(bridge, robot, ada):
    async with Page("giraff", ada) as lost:
        granted = await lost.take()
        async with Page("giraff", ada) as back:
            again = await back.take(session=granted.session, peer=granted.peer)
            assert again.resumed
            assert (again.peer, again.epoch) == (granted.peer, granted.epoch)
            assert await lost.closed() == protocol.REPLACED
            await back.say("command/velocity", words.velocity(seq=9))
            await back.settle(bridge)
            bridge.say("giraff", f"signal/{granted.peer}/reply", m.SdpAnswer(sdp="v=0"))
            assert (await back.expect("signal/reply")).sdp == "v=0"
            await lost.close()
            assert bridge.stops == []
            assert (await first(Session.objects)).seen_at is not None
    assert bridge.commands()[0].epoch == granted.epoch


async def test_a_peer_that_was_overheard_gives_nobody_the_robot(bridge, robot, ada, bob):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as thief:
        granted = await driver.take()
        await thief.say(
            "session/take", protocol.Take(session=granted.session, peer=granted.peer, takeover=True)
        )
        refused = await thief.expect("session/refused")
        assert (refused.reason, refused.outcome) == ("ended", "")
        await thief.say(
            "command/velocity", words.velocity(session=granted.session, epoch=granted.epoch)
        )
        assert (await thief.expect("denied")).reason == "not_driver"
    assert bridge.commands() == []


# --- what the robot says --------------------------------------------------------------------------


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


async def test_replies_and_echoes_go_to_their_own_peer_alone(bridge, robot, ada, bob):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as observer:
        granted = await driver.take()
        own = (await observer.expect("hello")).peer
        echoes = tuple(
            m.Echo(peer=peer, n=1, stamp=1.0, received=2.0)
            for peer in (granted.peer, own, "server")
        )
        bridge.say("giraff", "heartbeat", m.Heartbeat(n=1, stamp=1.0, echoes=echoes))
        bridge.say("giraff", f"signal/{granted.peer}/reply", m.SdpAnswer(sdp="for ada"))
        bridge.say("giraff", f"signal/{own}/reply", m.SdpAnswer(sdp="for bob"))
        assert [echo.peer for echo in (await driver.expect("heartbeat")).echoes] == [granted.peer]
        assert [echo.peer for echo in (await observer.expect("heartbeat")).echoes] == [own]
        assert (await driver.expect("signal/reply")).sdp == "for ada"
        assert (await observer.expect("signal/reply")).sdp == "for bob"


async def test_everybody_sees_who_drives_and_how_many_watch_and_wait(bridge, robot, ada, bob):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as other:
        granted = await driver.take()
        await other.say("session/observe", protocol.Observe())
        await until_room(
            driver,
            lambda authorization: (
                (authorization.driver, authorization.observers, authorization.driving)
                == ("Ada L.", 1, False)
            ),
        )
        bridge.say(
            "giraff", "state", words.state(session=granted.session, epoch=granted.epoch, viewers=4)
        )
        await until_room(
            other, lambda authorization: authorization.driving and authorization.observers == 3
        )
        await other.say("session/take", protocol.Take())
        await until_room(driver, lambda authorization: authorization.waiting == 1)


async def test_visitor_who_closes_the_page_no_longer_counts_as_waiting(bridge, robot, ada, bob):
    async with Page("giraff", ada) as driver:
        await driver.take()
        async with Page("giraff", bob) as other:
            await other.say("session/take", protocol.Take())
            await until_room(driver, lambda room: room.waiting == 1)
        await until_room(driver, lambda room: room.waiting == 0)


def goes_home():
    update_robots(returns_home=True, factsheet={"capabilities": ["dock"]})


async def test_visitor_who_waits_and_watches_is_counted_once(bridge, robot, ada, bob):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as other:
        await driver.take()
        await other.queue()
        await other.observe()
        await until_room(driver, lambda room: (room.observers, room.waiting) == (0, 1))
    assert max(room.observers for room in driver.told("room")) == 0


@pytest.mark.parametrize("by", ["visitor", "session manager"])
async def test_every_page_reads_what_a_robot_does_after_a_visit(bridge, robot, ada, bob, by):
    await sync_to_async(goes_home)()
    async with Page("giraff", ada) as driver, Page("giraff", bob) as other:
        granted = await driver.take()
        if by == "visitor":
            await driver.say("session/leave", protocol.Leave())
        else:
            end = sync_to_async(store.end)
            await end(granted.session, Session.Outcome.TIMED_OUT, "", timezone.now())
            bridge.say("giraff", "lease", None)
        for page in (driver, other):
            await until_room(
                page, lambda room: (room.driver, room.pause) == (None, "returning: dock")
            )
    async with Page("giraff", bob) as later:
        await until_room(later, lambda room: room.pause == "returning: dock")


async def until_room(page, condition):
    await page.expect("room", condition)


async def test_pages_are_told_when_the_robot_goes_and_a_late_will_tells_nothing(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        await page.expect("hello")
        bridge.say("giraff", "connection", words.online("b2"))
        bridge.say("giraff", "connection", words.broken("b1"))
        bridge.say("giraff", "connection", words.broken("b2"))
        assert not (await page.expect("robot")).online
        bridge.say("giraff", "connection", words.online("b3"))
        assert (await page.expect("robot")).online
    assert [presence.online for presence in page.told("robot")] == [False, True]


async def test_observers_are_as_many_as_the_robot_has_viewers_less_its_drivers_place(
    bridge, robot, ada, bob
):
    bridge.stored["giraff", "factsheet"] = msgspec.json.encode(words.factsheet(viewers=2))
    async with Page("giraff", ada) as one, Page("giraff", bob) as two:
        await one.observe()
        await two.say("session/observe", protocol.Observe())
        assert (await two.expect("session/refused")).reason == "observers_full"
        await one.say("session/leave", protocol.Leave())
        await until_room(two, lambda authorization: authorization.observers == 0)
        await two.observe()


async def test_a_robot_without_observers_is_only_driven(bridge, robot, ada):
    await sync_to_async(Robot.objects.update)(observers_allowed=False)
    async with Page("giraff", ada) as page:
        await page.say("session/observe", protocol.Observe())
        assert (await page.expect("session/refused")).reason == "not_allowed"


async def test_a_driver_chooses_how_much_the_robot_helps_and_nobody_else_does(
    bridge, robot, ada, bob
):
    async with Page("giraff", ada) as page, Page("giraff", bob) as other:
        granted = await page.take()
        await page.say("session/assist", protocol.Assist(level="steer"))
        await until(lambda: bridge.leases[-1][1] and bridge.leases[-1][1].assist == "steer")
        assert (bridge.leases[-1][1].epoch, bridge.leases[-1][1].renewal) == (granted.epoch, 1)
        await other.say("session/assist", protocol.Assist(level="off"))
        assert (await other.expect("denied")).reason == "not_driver"
    (session,) = await rows(Session.objects)
    assert session.assist == "steer"


# --- going ----------------------------------------------------------------------------------------


async def test_a_socket_that_closes_mid_drive_stops_the_robot_once_and_the_visit_goes_on(
    bridge, robot, ada
):
    async with Page("giraff", ada) as page:
        granted = await page.take()
        await page.say("command/velocity", words.velocity(seq=21))
        await page.settle(bridge)
    ((_, stop),) = bridge.stops
    assert (stop.role, stop.session, stop.epoch, stop.seq) == (
        "driver",
        granted.session,
        granted.epoch,
        21,
    )
    session = await first(Session.objects)
    assert session.state != "ended"
    assert session.seen_at is None


async def test_a_socket_that_closes_while_the_data_channel_drives_stops_nothing(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        await page.take()
        await page.say("command/heartbeat", m.CommandHeartbeat(n=1, stamp=1.0))
        await page.settle(bridge)
    assert bridge.stops == []


async def test_a_page_that_closes_during_a_take_leaves_a_visit_whose_page_is_gone(
    bridge, robot, ada
):
    page = Page("giraff", ada)
    await page.open()
    await page.expect("hello")
    await page.say("session/take", protocol.Take())
    await page.close()
    (session,) = await rows(Session.objects)
    assert session.seen_at is None
    assert bridge.leases[0][1].session == str(session.pk)


async def test_a_visit_that_was_left_while_the_page_had_no_connection_ends_when_it_is_back(
    bridge, robot, ada
):
    async with Page("giraff", ada) as page:
        granted = await page.take()
    async with Page("giraff", ada) as back:
        await back.say("session/leave", protocol.Leave(session=granted.session, peer=granted.peer))
        ended = await back.expect("session/ended")
        await back.say("session/leave", protocol.Leave(session=granted.session, peer=granted.peer))
        again = await back.expect("session/ended")
    assert (ended.session, ended.outcome, ended.reason) == (granted.session, "cancelled", "left")
    assert again == ended
    assert bridge.leases[-1] == ("giraff", None)


async def test_a_late_leave_ends_neither_what_moved_to_another_page_nor_the_visit_of_another(
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
    (session,) = await rows(Session.objects)
    assert not session.outcome
    assert bridge.leases[-1][1].session == granted.session


async def test_a_connection_that_fails_leaves_nothing_behind(bridge, robot, ada, bob, monkeypatch):
    async with Page("giraff", bob) as other:
        page = Page("giraff", ada)
        await page.open()
        await page.take()
        await until_room(other, lambda authorization: authorization.driver == "Ada L.")

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


# --- the broker is away ---------------------------------------------------------------------------


async def test_without_a_broker_commands_are_dropped_and_what_is_wanted_is_denied(
    bridge, robot, ada
):
    async with Page("giraff", ada) as page:
        await page.take()
        bridge.lose_broker()
        await page.say("command/velocity", words.velocity(seq=1))
        await page.say("signal", m.SdpOffer(sdp="v=0"))
        await page.say("command/action", m.Photo(action_id="p", stamp=1.0))
        assert (await page.expect("robot")).reason == "server"
        for suffix in ("signal", "command/action"):
            denied = await page.expect("denied")
            assert (denied.suffix, denied.reason) == (suffix, "robot_unreachable")
        await page.say("command/action", STOP)
        await until(lambda: bridge.stops)
        bridge.find_broker()
        await page.settle(bridge)
    assert bridge.sent == []


async def test_an_offline_robot_is_said_to_be_unreachable(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        await page.take()
        bridge.say("giraff", "connection", words.broken())
        await page.say("signal", m.SdpOffer(sdp="v=0"))
        assert (await page.expect("denied")).reason == "robot_unreachable"
    assert bridge.sent == []


async def test_the_lease_of_a_live_session_is_published_again_when_the_broker_is_back(
    bridge, robot, ada
):
    async with Page("giraff", ada) as page:
        granted = await page.take()
        bridge.say("giraff", "lease", msgspec.structs.replace(bridge.leases[0][1], renewal=6))
        bridge.lose_broker()
        bridge.find_broker()
        await until(lambda: len(bridge.leases) == 2)
    again = bridge.leases[1][1]
    assert (again.session, again.epoch, again.peer, again.renewal) == (
        granted.session,
        granted.epoch,
        granted.peer,
        6,
    )


async def test_a_session_that_ended_while_the_broker_was_away_is_told_and_its_lease_is_not_revived(
    bridge, robot, ada
):
    from sessions.leases import store

    async with Page("giraff", ada) as page:
        granted = await page.take()
        bridge.lose_broker()
        await sync_to_async(store.end)(granted.session, "timed_out", "turn_over", timezone.now())
        bridge.find_broker()
        ended = await page.expect("session/ended")
    assert (ended.outcome, ended.reason) == ("timed_out", "turn_over")
    assert len(bridge.leases) == 1


async def test_an_empty_lease_that_comes_late_takes_the_robot_from_nobody(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        granted = await page.take()
        bridge.say("giraff", "lease", None)
        await until(lambda: len(bridge.leases) == 2)
        assert bridge.leases[1][1].renewal > bridge.leases[0][1].renewal
        await page.say("command/velocity", words.velocity())
        await page.settle(bridge)
    assert bridge.commands()[0].epoch == granted.epoch


async def test_an_offered_turn_that_was_announced_while_the_broker_was_away_is_announced_again(
    bridge, robot, ada, bob
):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as waiting:
        await driver.take()
        session = (await waiting.queue()).session
        bridge.lose_broker()
        await sync_to_async(Session.objects.filter(pk=session).update)(offered_at=timezone.now())
        bridge.find_broker()
        assert 0.0 < (await waiting.expect("session/offered")).seconds <= 60.0


# --- pages that may not stay ----------------------------------------------------------------------


async def sign_out(page):
    from importlib import import_module

    from django.conf import settings

    await sync_to_async(import_module(settings.SESSION_ENGINE).SessionStore(page.cookie).delete)()


async def test_a_visitor_who_has_signed_out_in_another_tab_takes_nothing(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        await page.expect("hello")
        await sign_out(page)
        await page.say("session/take", protocol.Take())
        assert await page.closed() == protocol.SIGNED_OUT
    assert bridge.leases == []


@pytest.mark.parametrize("lost", ["session", "permit", "account"])
async def test_a_driver_who_may_not_stay_is_sent_away_within_the_minute(
    bridge, robot, ada, monkeypatch, lost
):
    monkeypatch.setattr(drive, "PAGE_SEEN_EVERY", 0.05)
    monkeypatch.setattr(drive, "WELCOME_EVERY", 0.1)
    await sync_to_async(Robot.objects.update)(access=Robot.Access.TRAINED)
    permit = await sync_to_async(RobotPermit.objects.create)(
        robot=robot, user=ada, kind=RobotPermit.Privilege.TRAINED
    )
    async with Page("giraff", ada) as page:
        granted = await page.take()
        if lost == "session":
            await sign_out(page)
        elif lost == "permit":
            await sync_to_async(permit.delete)()
        else:
            await sync_to_async(get_user_model().objects.update)(is_active=False)
        assert await page.closed() == (
            protocol.NOT_ALLOWED if lost == "permit" else protocol.SIGNED_OUT
        )
    assert bridge.leases[-1] == ("giraff", None)
    assert bridge.commands(f"signal/{granted.peer}") == [m.Bye(reason="left")]
    session = await first(Session.objects)
    assert (session.state, session.outcome) == ("ended", "stopped_by_operator")


def signals(bridge) -> list[m.Message]:
    """Return the signals that were sent to the robot, of all pages."""
    return [message for _, suffix, message in bridge.sent if suffix.startswith("signal/")]


async def test_watching_ends_with_the_pages_socket(bridge, robot, ada, bob):
    """The connection to the robot needs no socket: without a word of the server it would go on for
    ever.
    """
    async with Page("giraff", ada) as driver:
        granted = await driver.take()
        async with Page("giraff", bob) as observer:
            await observer.observe()
            assert signals(bridge) == []
        assert signals(bridge) == [m.Bye(reason="left")]
        assert bridge.commands(f"signal/{granted.peer}") == []
    assert signals(bridge) == [m.Bye(reason="left")], "the lease looks after who drives"


async def test_the_server_speaks_for_who_watches_and_for_nobody_else(
    bridge, robot, ada, bob, monkeypatch
):
    monkeypatch.setattr(drive, "PAGE_SEEN_EVERY", 0.05)
    monkeypatch.setattr(drive, "WELCOME_EVERY", 0.0)
    async with Page("giraff", ada) as driver, Page("giraff", bob) as observer:
        granted = await driver.take()
        await observer.observe()
        await until(lambda: signals(bridge).count(m.Stay()) >= 3)
        assert bridge.commands(f"signal/{granted.peer}") == []


async def test_watching_ends_within_a_minute_after_the_permission(bridge, robot, ada, monkeypatch):
    monkeypatch.setattr(drive, "PAGE_SEEN_EVERY", 0.05)
    monkeypatch.setattr(drive, "WELCOME_EVERY", 0.1)
    async with Page("giraff", ada) as page:
        await page.observe()
        await sync_to_async(Robot.objects.update)(observers_allowed=False)
        assert (await page.expect("session/refused")).reason == "not_allowed"
        assert [one for one in signals(bridge) if one != m.Stay()] == [m.Bye(reason="left")]
        await page.say("session/observe", protocol.Observe())
        assert (await page.expect("session/refused")).reason == "not_allowed"
        assert (await page.take()).session, "and may drive, as everybody"


async def test_former_operator_clears_no_stop_from_a_page_that_is_still_open(bridge, robot, ada):
    permit = await sync_to_async(RobotPermit.objects.create)(
        robot=robot, user=ada, kind=RobotPermit.Privilege.OPERATOR
    )
    clear = m.ClearEStop(action_id="c", stamp=1.0)
    async with Page("giraff", ada) as page:
        await page.say("command/action", clear)
        await until(lambda: bridge.commands("command/action"))
        await sync_to_async(permit.delete)()
        await page.say("command/action", clear)
        assert (await page.expect("denied")).reason == "not_allowed"
    assert len(bridge.commands("command/action")) == 1


async def test_an_open_page_is_seen_and_learns_that_its_session_is_over(
    bridge, robot, ada, monkeypatch
):
    from sessions.leases import store

    monkeypatch.setattr(drive, "PAGE_SEEN_EVERY", 0.05)
    async with Page("giraff", ada) as page:
        granted = await page.take()
        before = (await first(Session.objects)).seen_at
        async with asyncio.timeout(patient(5)):
            while (await first(Session.objects)).seen_at == before:
                await asyncio.sleep(0.02)
        await sync_to_async(store.end)(
            granted.session, "robot_fault", "robot_offline", timezone.now()
        )
        assert (await page.expect("session/ended")).outcome == "robot_fault"


async def test_a_page_that_comes_back_too_late_hears_how_its_session_ended(bridge, robot, ada):
    from sessions.leases import store

    async with Page("giraff", ada) as page:
        granted = await page.take()
    await sync_to_async(store.end)(granted.session, "robot_fault", "robot_offline", timezone.now())
    async with Page("giraff", ada) as page:
        await page.say("session/take", protocol.Take(session=granted.session, peer=granted.peer))
        refused = await page.expect("session/refused")
    assert (refused.reason, refused.outcome) == ("ended", "robot_fault")


async def test_a_page_that_closes_while_it_is_about_to_be_seen_is_gone(
    bridge, robot, ada, monkeypatch
):
    monkeypatch.setattr(drive, "PAGE_SEEN_EVERY", 0.01)
    monkeypatch.setattr(last_seen, "GATHER_SECONDS", 0.3)
    async with Page("giraff", ada) as page:
        await page.take()
        await asyncio.sleep(0.1)
    await asyncio.sleep(0.6)
    assert (await first(Session.objects)).seen_at is None


async def test_a_database_that_does_not_answer_is_said_and_the_page_stays(
    bridge, robot, ada, monkeypatch
):
    from django.db import OperationalError

    from sessions.consumers import queries

    def broken(*_arguments, **_named):
        raise OperationalError("database is locked")

    async with Page("giraff", ada) as page:
        await page.expect("hello")
        monkeypatch.setattr(queries, "take", broken)
        await page.say("session/take", protocol.Take())
        assert (await page.expect("denied")).reason == "unavailable"
        monkeypatch.undo()
        await page.take()


# --- the record -----------------------------------------------------------------------------------


async def test_reports_of_a_page_reach_the_session_manager(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        granted = await page.take()
        await page.say(
            "page/network", protocol.PageNetwork(stamp=1.0, way="datachannel", round_trip=0.01)
        )
        await page.settle(bridge)
    ((topic, report),) = bridge.reports
    assert topic == f"telepresence/v1/server/page/{granted.session}"
    assert msgspec.json.decode(report.message, type=protocol.PageNetwork).round_trip == 0.01


# --- pictures through the server ------------------------------------------------------------------

JPEG = b"\xff\xd8\xff\xe0 a picture \xff\xd9"


async def test_a_picture_goes_to_the_pages_that_asked_for_it_and_to_nobody_else(
    bridge, robot, ada, bob
):
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


async def test_a_picture_for_one_peer_goes_to_no_other_page(bridge, robot, ada, bob):
    async with Page("giraff", ada) as driver, Page("giraff", bob) as watcher:
        await driver.take()
        await watcher.observe()
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


async def test_a_picture_of_another_robot_and_one_that_is_none_reach_nobody(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        await page.take()
        await page.say("command/picture", m.PictureRequest(stamp=1.0))
        await until(lambda: bridge.commands("command/picture"))
        bridge.say_picture("rhodon", 5.0, JPEG)
        with pytest.raises(Rejection):
            bridge.delivery.arrive(
                "telepresence/v1/giraff/picture", b"no picture at all", time.monotonic()
            )
        with pytest.raises(Rejection):
            bridge.say_picture("giraff", 5.0, JPEG[:-2] + b"x" * 50_000 + JPEG[-2:])
        bridge.say_picture("giraff", 6.0, JPEG)
        assert await page.expect("picture") == (6.0, JPEG)


async def test_after_the_visit_no_picture_comes_any_more(bridge, robot, ada):
    async with Page("giraff", ada) as page:
        await page.take()
        await page.say("command/picture", m.PictureRequest(stamp=1.0))
        await until(lambda: bridge.commands("command/picture"))
        await page.say("session/leave", protocol.Leave())
        await page.expect("session/ended")
        bridge.say_picture("giraff", 6.0, JPEG)
        bridge.say("giraff", "state", words.state(seq=7))
        await page.expect("state")
    assert page.told("picture") == []


# --- what lines of the log are about --------------------------------------------------------------


async def test_lines_about_a_page_name_its_request_robot_and_session_also_when_the_robot_speaks(
    bridge, robot, ada, monkeypatch
):
    monkeypatch.setattr(log_ids, "_process", {})  # whatever this process is said to be about
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
