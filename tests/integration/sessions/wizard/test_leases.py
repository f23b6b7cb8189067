"""Who operates a session, in the database."""

import pytest
from django.utils import timezone

from accounts.models import User
from sessions.leases import store
from sessions.leases.terms import Terms
from sessions.models import Lease, Session
from sessions.wizard import leases
from tests.support.studies.fixed_terms import provided

pytestmark = pytest.mark.django_db
NOW = timezone.now()


@pytest.fixture
def terms():
    with provided() as double:
        double.terms = Terms(driver="wizard")
        yield double


@pytest.fixture
def session(giraff, terms):
    ada = User.objects.create(username="ada", display_name="Ada")
    return store.take(giraff, ada, "peer", now=NOW).session


@pytest.fixture
def eve():
    return User.objects.create(username="eve")


def test_newest_page_of_a_user_operates_with_a_new_epoch(session, eve):
    first = leases.take(session, eve, "one", NOW)
    second = leases.take(session, eve, "two", NOW)
    assert (first.driver, second.driver) == ("one", "two")
    assert second.wizard_epoch == first.wizard_epoch + 1
    assert leases.release(session, "one", NOW) is None
    released = leases.release(session, "two", NOW)
    assert released.driver is None
    assert released.wizard_epoch == second.wizard_epoch + 1
    assert leases.release(session, "two", NOW) is None


def test_session_in_which_the_visitor_drives_cannot_be_operated(giraff, eve, terms):
    terms.terms = None
    ada = User.objects.create(username="ada")
    session = store.take(giraff, ada, "peer", now=NOW).session
    assert leases.session_at(giraff) is None
    assert leases.take(session, eve, "one", NOW) == "refused"


def test_ended_session_cannot_be_operated(giraff, session, eve):
    assert str(leases.session_at(giraff).pk) == session
    store.end(session, Session.Outcome.COMPLETED, "left", NOW)
    assert leases.session_at(giraff) is None
    assert leases.take(session, eve, "one", NOW) == "ended"


def test_later_of_two_simultaneous_takeovers_is_refused_as_occupied(session, eve, monkeypatch):
    adam, read, pending = User.objects.create(username="adam"), leases._lease_of, [True]

    def slowly(key):
        found = read(key)
        if pending:
            pending.clear()
            leases.take(session, adam, "quicker", NOW)
        return found

    monkeypatch.setattr(leases, "_lease_of", slowly)
    assert leases.take(session, eve, "one", NOW) == "occupied"
    assert Lease.objects.get().wizard_peer == "quicker"


def test_takeover_fails_if_the_lease_changes_during_each_attempt(session, eve, monkeypatch):
    monkeypatch.setattr(leases, "ATTEMPTS", 3)
    monkeypatch.setattr(leases, "_change", lambda *_: False)
    assert leases.take(session, eve, "one", NOW) == "ended"
    assert Lease.objects.get().wizard_peer == ""
