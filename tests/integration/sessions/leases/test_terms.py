"""The terms of a session: fixed when it begins, applied by lease, queue and page."""

import msgspec
import pytest

from accounts.models import User
from robots.api import messages as m
from robots.models import Robot
from sessions import protocol
from sessions.consumers import queries
from sessions.leases import store, terms
from sessions.leases.expiry import tick
from sessions.leases.transitions import RobotLink, SetState
from sessions.manager.scheduler import Scheduler
from sessions.models import Lease, Session
from sessions.protocol import Ended
from sessions.views import page_config
from tests.support.browsers.pages import Page
from tests.support.robots import online_robot, update_robots
from tests.support.sessions.rows import NOW, after, session_row
from tests.support.studies.fixed_terms import provided

pytestmark = pytest.mark.django_db
STUDY = terms.Terms(
    label="A tour",
    linear=0.2,
    assist="off",
    actions=("photo",),
    controllers=("keyboard",),
    control_way="mqtt",
    turn_seconds=300.0,
    grace_seconds=120.0,
    interface="plain",
    leaving_completes=False,
    study={"slug": "tour"},
)


@pytest.fixture
def provider():
    with provided() as double:
        yield double


@pytest.fixture
def giraff():
    return online_robot(max_linear=0.3, max_angular=0.5)


def take(
    robot: Robot, user: User, peer: str = "peer-1", *, at: float = 0.0, **message
) -> store.Taken:
    return store.take(robot, user, peer, now=after(at), **message)


def test_terms_are_fixed_once_and_are_part_of_each_lease(provider, giraff, ana):
    provider.terms = STUDY
    granted = take(giraff, ana)
    assert terms.of(Session.objects.get()) == granted.terms == STUDY
    lease = granted.lease
    assert (lease.limits.linear, lease.limits.angular, lease.assist) == (0.2, 0.5, "off")
    assert (lease.methods, lease.ways, lease.actions) == (("keyboard",), ("mqtt",), ("photo",))
    provider.terms = terms.FREE
    Session.objects.update(state="driving")
    again = take(giraff, ana, "peer-2", at=1, session=granted.session, takeover=True)
    assert (again.terms, again.lease.methods) == (STUDY, ("keyboard",))


def test_session_manager_renews_a_lease_with_its_terms(provider, giraff, ana):
    provider.terms = STUDY
    take(giraff, ana)
    keeper = Scheduler()
    keeper.begin()
    assert keeper.renew(after(1))
    leases = [
        msgspec.json.decode(outbound.payload, type=m.Lease)
        for outbound in keeper.outbox
        if outbound.topic.endswith("/lease") and outbound.payload
    ]
    assert [(lease.methods, lease.limits.linear) for lease in leases] == [(("keyboard",), 0.2)]


def test_terms_do_not_raise_the_limits_of_a_robot(provider, giraff, ana):
    provider.terms = terms.Terms(linear=0.9)
    assert take(giraff, ana).lease.limits.linear == 0.3


def test_free_session_has_no_terms(provider, giraff, ana):
    granted = take(giraff, ana)
    assert (granted.terms, granted.shown, Session.objects.get().terms) == (terms.FREE, {}, {})
    assert (granted.lease.methods, granted.lease.ways, granted.lease.actions) == (None, None, None)


def test_session_that_must_not_begin_ends_with_the_reason(provider, giraff, ana):
    provider.refusal = "full"
    assert take(giraff, ana) == store.Refused(reason="full", session=str(Session.objects.get().pk))
    row = Session.objects.get()
    assert (row.state, row.outcome, row.outcome_reason) == ("ended", "cancelled", "full")
    assert Lease.objects.get().session is None
    assert msgspec.convert({"reason": "full"}, protocol.Refused)


def test_reason_against_a_session_does_not_stop_a_driver_from_returning(provider, giraff, ana, ben):
    def ask(user: User, **more) -> store.Taken:
        new = {"session": None, "old_peer": None, "takeover": False, "device": {}}
        return queries.take(giraff, user, f"peer-{user}", now=after(1), **new | more)

    granted = take(giraff, ana, "peer-ana")
    provider.reason = "closed"
    assert ask(ben) == store.Refused(reason="closed")
    assert not Session.objects.filter(visitor=ben).exists()
    assert ask(ana).session == granted.session


def half_granted(robot: Robot, visitor: User) -> Session:
    """Store a lease of a session that still waits: the web process died before the grant."""
    session = session_row(robot, visitor, queued_at=NOW, seen_at=NOW)
    Lease.objects.create(robot=robot, epoch=1, session=session, peer="p1", changed_at=NOW)
    return session


def test_session_manager_fixes_missing_terms_before_it_publishes_the_lease(provider, giraff, ana):
    provider.terms = STUDY
    session = half_granted(giraff, ana)
    keeper = Scheduler()
    keeper.renew(NOW)
    assert not keeper.outbox
    assert tick(giraff, RobotLink(since=NOW.timestamp()), after(1)) == (
        SetState(str(session.pk), "connecting"),
    )
    session.refresh_from_db()
    assert (session.state, terms.of(session)) == ("connecting", STUDY)


def test_refused_session_of_a_dead_process_ends_with_the_reason(provider, giraff, ana):
    provider.refusal = "closed"
    session = half_granted(giraff, ana)
    assert tick(giraff, RobotLink(since=NOW.timestamp()), after(1)) == ()
    session.refresh_from_db()
    assert (session.state, session.outcome_reason) == ("ended", "closed")


# --- time -----------------------------------------------------------------------------------------


def test_turn_and_grace_of_the_terms_apply(provider, giraff, ana, ben):
    provider.terms = STUDY
    session = take(giraff, ana).session
    Session.objects.update(state="reconnecting", lost_at=after(1), driving_at=NOW, granted_at=NOW)
    link = RobotLink(
        since=NOW.timestamp() - 100,
        last_received_at=after(400).timestamp(),
        state_at=after(400).timestamp(),
        silence=60.0,
    )
    assert tick(giraff, link, after(120)) == ()
    assert tick(giraff, link, after(121.5)) == (
        Ended(session=session, outcome="connection_lost", reason="visitor_silent"),
    )


def test_turn_of_the_terms_ends_only_if_others_wait(provider, giraff, ana, ben):
    provider.terms = STUDY
    session = take(giraff, ana).session
    Session.objects.update(state="driving", driving_at=NOW)
    link = RobotLink(
        since=NOW.timestamp(),
        **dict.fromkeys(("last_received_at", "state_at", "active_at"), after(299).timestamp()),
        session=session,
        epoch=1,
        silence=0.1,
    )
    assert tick(giraff, link, after(299)) == ()
    take(giraff, ben, "peer-ben", at=100)
    Session.objects.filter(visitor=ben).update(seen_at=after(299))
    acts = tick(giraff, link, after(150))
    assert [act.ends_at for act in acts if type(act).__name__ == "TurnLimited"] == [
        pytest.approx(after(300).timestamp())
    ]


# --- assistance and leaving -----------------------------------------------------------------------


def test_fixed_level_of_assistance_cannot_be_changed(provider, giraff, ana):
    provider.terms = STUDY
    session = take(giraff, ana).session
    assert queries.choose_assist(session, "steer", peer="peer-1", now=after(1)) == "fixed"
    assert Session.objects.get().assist == ""


def test_free_level_of_assistance_keeps_the_other_terms(provider, giraff, ana):
    provider.terms = terms.Terms(controllers=("keyboard",))
    session = take(giraff, ana).session
    lease = queries.choose_assist(session, "steer", peer="peer-1", now=after(1))
    assert (lease.assist, lease.methods) == ("steer", ("keyboard",))
    assert queries.choose_assist(session, "off", peer="another", now=after(1)) == "not_driver"


class TestFirstDrive:
    """Visitors who have never driven begin with a robot that stops at obstacles."""

    @pytest.fixture
    def giraff(self, giraff):
        giraff.presence.factsheet = {"capabilities": ["assist"]}
        giraff.presence.save()
        return giraff

    def test_new_visitor_is_assisted_until_they_choose(self, giraff, ana):
        taken = take(giraff, ana)
        assert taken.lease.assist == "slow"
        queries.choose_assist(taken.session, "off", peer="peer-1", now=after(1))
        assert take(giraff, ana).lease.assist == "off"

    def test_page_shows_the_level_that_the_drive_will_begin_with(self, giraff, ana):
        assert page_config(giraff, ana)["assist"] == take(giraff, ana).lease.assist == "slow"

    def test_page_shows_the_owners_level_where_that_applies(self, giraff, ana):
        Robot.objects.update(assist="steer")
        giraff.refresh_from_db()
        assert page_config(giraff, ana)["assist"] == "steer"

    def test_visitor_who_has_driven_before_gets_the_robots_own_level(self, giraff, ana):
        Session.objects.create(
            robot=giraff, visitor=ana, state="completed", queued_at=NOW, first_motion_at=NOW
        )
        assert take(giraff, ana).lease.assist is None

    @pytest.mark.parametrize(("chosen", "next_time"), [("", "slow"), ("steer", "steer")])
    def test_next_drive_begins_with_the_level_of_the_last(self, giraff, ana, chosen, next_time):
        session = take(giraff, ana).session
        if chosen:
            queries.choose_assist(session, chosen, peer="peer-1", now=after(1))
        Session.objects.update(first_motion_at=after(2))
        store.leave(session, peer="peer-1", now=after(9))
        Lease.objects.all().delete()
        assert take(giraff, ana).lease.assist == next_time

    def test_lease_has_no_level_if_the_robot_cannot_assist_or_assists_anyway(
        self, giraff, ana, ben
    ):
        Robot.objects.update(assist="steer")
        assert take(giraff, ana).lease.assist is None
        update_robots(assist="off", factsheet={"capabilities": []})
        Session.objects.all().delete()
        assert take(Robot.objects.get(), ben).lease.assist is None

    def test_study_sets_the_level_of_its_participants(self, provider, giraff, ana):
        provider.terms = terms.Terms(study={"condition": "A"})
        assert take(giraff, ana).lease.assist is None


@pytest.mark.parametrize(
    ("fixed", "outcome"), [(STUDY, "cancelled"), (terms.Terms(label="Practice"), "completed")]
)
def test_leaving_completes_a_drive_only_if_its_terms_require_no_more(
    provider, giraff, ana, fixed, outcome
):
    provider.terms = fixed
    session = take(giraff, ana).session
    Session.objects.update(first_motion_at=after(1))
    assert store.leave(session, peer="peer-1", now=after(9))
    assert Session.objects.get().outcome == outcome


# --- the page -------------------------------------------------------------------------------------


@pytest.mark.django_db(transaction=True)
async def test_page_gets_terms_and_task_whenever_it_takes_the_session(
    bridge, provider, giraff, ana
):
    provider.terms = STUDY
    provider.task = {"cue": "go_to_checkpoint", "number": 1, "x": 2.0, "y": 1.0}
    async with Page("giraff", ana) as page:
        await page.expect("hello")
        await page.say("session/take", protocol.Take())
        granted, task = await page.expect("session/granted"), await page.expect("session/task")
        await page.say("session/assist", protocol.Assist(level="steer"))
        assert await page.denied() == ("session/assist", "fixed")
    shown = granted.terms
    assert (shown.controllers, shown.control_way) == (("keyboard",), "mqtt")
    assert shown.interface == "plain"
    assert (task.session, task.cue) == (granted.session, "go_to_checkpoint")
    assert (task.number, task.window) == (1, "shut")
    assert {lease.assist for _, lease in bridge.leases} == {"off"}


def test_stored_task_becomes_a_notice_unless_it_is_malformed():
    task = protocol.task_of("s1", {"cue": "dock_now", "passed": [1, 2], "remaining": 30.5}, 5.0)
    assert (task.stamp, task.passed, task.remaining, task.outcome) == (5.0, (1, 2), 30.5, "")
    assert protocol.task_of("s1", {"passed": "all"}, 5.0) is None
