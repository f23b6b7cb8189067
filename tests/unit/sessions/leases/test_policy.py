"""Who may drive, decided on snapshots."""

import hypothesis.strategies as st
import pytest
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from sessions.leases.policy import Grant, Resume, Wait
from sessions.protocol import Offered, Refused
from tests.support.examples import examples
from tests.support.sessions.lease_world import RULES, World


@pytest.fixture
def world() -> World:
    return World()


@pytest.fixture
def session(world):
    """Ana's session, whose page is the peer `first`."""
    world.take("ana", peer="first")
    return world.session_of("ana").id


def take(world, *visitors):
    for visitor in visitors:
        world.take(visitor)


def test_a_second_visitor_waits_with_a_place_and_minutes(world):
    world.take("ana")
    assert world.take("ben") == Wait(None, 1, 1.0)
    assert world.take("cem") == Wait(None, 2, 2.0)


def test_asking_again_keeps_the_place(world):
    take(world, "ana", "ben", "cem")
    assert world.take("ben").place == 1
    assert len(world.sessions) == 3


def test_the_same_page_resumes_with_its_old_peer_and_keeps_the_epoch(world, session):
    assert world.take("ana", peer="second", session=session, old_peer="first") == Resume(session)
    assert world.hold.epoch == 1


def test_a_double_click_is_not_a_second_tab(world):
    world.take("ana", peer="page")
    assert isinstance(world.take("ana", peer="page"), Resume)


def test_a_wrong_old_peer_is_not_resumed(world, session):
    assert world.take("ana", peer="second", session=session, old_peer="guess") == Refused(
        reason="elsewhere", session=session
    )


def test_a_second_tab_is_refused_until_it_takes_over_with_a_new_epoch(world, session):
    assert world.take("ana", peer="second") == Refused(reason="elsewhere", session=session)
    assert world.take("ana", peer="second", takeover=True).returning
    assert (world.hold.epoch, world.hold.peer) == (2, "second")


def test_a_reloaded_page_returns_to_its_session_with_a_new_epoch(world, session):
    world.change(session, state="driving", seen_at=None)  # the old page closed its socket
    grant = world.take("ana", peer="second", session=session)
    assert grant == Grant(session, "reconnecting", returning=True)
    assert world.hold.epoch == 2


def test_a_tab_that_copied_the_session_of_an_open_one_is_refused(world, session):
    world.change(session, state="driving")
    assert world.take("ana", peer="second", session=session) == Refused(
        reason="elsewhere", session=session
    )


def test_a_second_tab_cannot_take_a_drive_that_uses_only_the_data_channel(world, session):
    world.change(session, state="driving", seen_at=None)
    assert world.take("ana", peer="second") == Refused(reason="elsewhere", session=session)


def test_a_lost_visitor_returns_from_any_page(world, session):
    world.change(session, state="reconnecting", lost_at=world.now)
    assert world.take("ana", peer="phone").returning


def test_a_session_that_is_over_is_not_resumed(world):
    world.take("ana")
    session = world.session_of("ana").id
    world.end(session, "completed", "left")
    assert world.take("ana", session=session, old_peer="peer-of-ana") == Refused(
        reason="ended", session=session
    )
    assert world.take("ben", session=session) == Refused(reason="ended", session=session)


@pytest.mark.parametrize(
    ("online", "enabled", "reason"),
    [(False, True, "offline"), (True, False, "disabled"), (False, False, "disabled")],
)
def test_an_absent_robot_is_not_granted(world, online, enabled, reason):
    world.online, world.enabled = online, enabled
    assert world.take("ana") == Refused(reason=reason)


def test_the_queue_is_kept_while_the_robot_is_offline(world):
    take(world, "ana", "ben")
    world.online = False
    assert isinstance(world.take("ben"), Wait)


def test_a_free_robot_is_for_the_first_in_the_queue(world):
    take(world, "ana", "ben")
    world.end(world.session_of("ana").id, "completed", "left")
    assert isinstance(world.take("cem"), Wait)
    assert isinstance(world.take("ben"), Grant)


def test_a_waiting_session_with_a_closed_page_keeps_its_place_and_blocks_no_other(world):
    take(world, "ana", "ben")
    world.change(world.session_of("ben").id, seen_at=None, lost_at=world.now)
    world.end(world.session_of("ana").id, "completed", "left")
    assert isinstance(world.take("cem"), Grant)
    assert world.take("ben").place == 1


def test_sessions_with_a_closed_page_do_not_count_for_those_behind_them(world):
    take(world, "ana", "ben")
    assert world.take("cem").place == 2
    world.change(world.session_of("ben").id, seen_at=None, lost_at=world.now)
    assert world.take("cem").place == 1
    world.change(world.session_of("ben").id, seen_at=world.now, lost_at=None)
    assert [world.take(who).place for who in ("ben", "cem")] == [1, 2]


def test_an_offered_turn_is_reserved(world):
    take(world, "ana", "ben", "cem")
    world.end(world.session_of("ana").id, "completed", "left")
    assert world.tick() == (Offered(session=world.session_of("ben").id, seconds=RULES.start),)
    assert isinstance(world.take("cem"), Wait)
    assert isinstance(world.take("dan"), Wait)
    assert isinstance(world.take("ben"), Grant)


VISITORS = st.sampled_from(["ana", "ben", "cem", "dan"])


class Visitors(RuleBasedStateMachine):
    """Visitors ask, leave, lose their network and return in any order, while time passes."""

    def __init__(self) -> None:
        super().__init__()
        self.world = World()
        self.open: set[str] = set()

    @rule(visitor=VISITORS, takeover=st.booleans(), tab=st.sampled_from(["a", "b"]))
    def asks(self, visitor, takeover, tab):
        now = self.world.now
        queue = self.world.scene.queue
        order = [one.visitor for one in queue if one.visitor == visitor or one.page_open(now)]
        holder = self.world.scene.holder
        decision = self.world.take(visitor, peer=f"{visitor}-{tab}", takeover=takeover)
        self.open.add(visitor)
        if isinstance(decision, Grant) and not decision.returning:
            assert holder is None
            ahead = order[: order.index(visitor)] if visitor in order else order
            assert all(self.world.session_of(name).offered_at is not None for name in ahead)

    @precondition(lambda self: self.world.scene.holder is not None)
    @rule()
    def driver_connects(self):
        self.world.connected.add(self.world.scene.holder.visitor)

    @rule(visitor=VISITORS)
    def loses_the_network(self, visitor):
        self.world.connected.discard(visitor)

    @rule(visitor=VISITORS)
    def closes_the_page(self, visitor):
        self.open.discard(visitor)
        session = self.world.session_of(visitor)
        if session is not None:
            lost_at = self.world.now if session.state == "waiting" else session.lost_at
            self.world.change(session.id, seen_at=None, lost_at=lost_at)

    @rule(visitor=VISITORS)
    def leaves(self, visitor):
        session = self.world.session_of(visitor)
        if session is not None:
            self.world.end(session.id, "completed", "left")

    @rule(online=st.booleans())
    def robot_connects_or_disconnects(self, online):
        if self.world.online and not online:
            self.world.offline_since = self.world.now
        self.world.online = online

    @rule(seconds=st.floats(0.1, 30.0))
    def time_passes(self, seconds):
        self.world.now += seconds
        self.world.pages_say_they_are_open(self.open)
        self.world.tick()

    @invariant()
    def there_is_one_driver_at_most(self):
        drivers = [one for one in self.world.sessions.values() if one.state != "waiting"]
        assert len(drivers) <= 1
        assert all(session.id == self.world.hold.session for session in drivers)

    @invariant()
    def every_grant_has_an_epoch_of_its_own(self):
        epochs = [epoch for epoch, _ in self.world.grants]
        assert epochs == sorted(set(epochs))

    @invariant()
    def a_visitor_has_one_session_at_most(self):
        visitors = [session.visitor for session in self.world.sessions.values()]
        assert len(visitors) == len(set(visitors))

    @invariant()
    def at_most_one_turn_is_offered_and_none_during_a_drive(self):
        since = self.world.now - RULES.start
        offered = [one.offered_at for one in self.world.scene.queue if one.offered_at is not None]
        offers = [at for at in offered if at > since]
        assert len(offers) <= 1
        assert not (offers and self.world.scene.holder)

    def teardown(self):
        """A visitor who waits, and takes the turn when it is offered, gets the robot within one
        turn for each visitor ahead.
        """
        self.world.online = True
        patient = [session.visitor for session in self.world.scene.queue]
        self.open |= set(patient)
        turn = RULES.turn + RULES.warning + RULES.start + RULES.grace
        bound = self.world.now + (len(self.world.sessions) + 1) * turn
        while patient and self.world.now < bound:
            self.world.now += 1.0
            self.world.pages_say_they_are_open(self.open)
            self.world.connected |= {session.visitor for session in self.world.sessions.values()}
            self.world.tick()
            for visitor in list(patient):
                session = self.world.session_of(visitor)
                if session is None or not isinstance(self.world.take(visitor), Wait):
                    patient.remove(visitor)
        assert not patient, "these visitors were never served"


TestVisitors = Visitors.TestCase
TestVisitors.settings = examples(75, thorough=3000, stateful_step_count=40)
