"""A DATABASE_URL of several PostgreSQL servers, and the time limit of a silent one."""

import pytest

from telepresence_site import postgresql
from telepresence_site.postgresql.base import QUIET_SECONDS, ServerOrder, watch


def test_several_hosts_are_tried_in_their_order_for_the_one_that_may_write():
    found = postgresql.database(
        "postgres://ana:p%40ss@db-1,db-2:5433,[fd00::3]:5434/name?sslmode=verify-full"
    )
    assert (found["USER"], found["PASSWORD"], found["NAME"]) == ("ana", "p@ss", "name")
    assert found["HOST"] == "db-1,db-2,fd00::3"
    assert found["PORT"] == "5432,5433,5434"
    assert found["OPTIONS"] == {
        "target_session_attrs": "read-write",
        "connect_timeout": 3,
        "sslmode": "verify-full",
    }


def test_options_in_the_url_override_the_defaults():
    url = "postgres://ana@db-1,db-2/name?target_session_attrs=primary&connect_timeout=5"
    assert postgresql.database(url)["OPTIONS"] == {
        "target_session_attrs": "primary",
        "connect_timeout": "5",
    }


@pytest.mark.parametrize(
    "url",
    ["postgres:///name", "postgres://ana@db-1:5432/name", "sqlite:////a,b", "mongodb://a,b/name"],
)
def test_one_server_and_other_databases_are_not_several(url):
    assert not postgresql.is_address(url)


@pytest.mark.parametrize("hosts", ["db-1,", "db-1:x,db-2", "[fd00::1,db-2"])
def test_malformed_hosts_are_refused(hosts):
    with pytest.raises(ValueError, match="DATABASE_URL"):
        postgresql.database(f"postgres://ana@{hosts}/name")


class Statement:
    """A statement of psycopg that is answered at a given time (s); each wait takes 0.1 s."""

    def __init__(self, answered_at):
        self.now, self.answered_at, self.checked_at = 0.0, answered_at, []

    def run(self, check):
        def waiting():
            while not (yield "read"):
                pass
            return "answer"

        def checking():
            self.checked_at.append(self.now)
            check()

        watched = watch(waiting(), checking, lambda: self.now)
        assert next(watched) == "read"
        try:
            while True:
                self.now += 0.1
                assert watched.send(self.now >= self.answered_at) == "read"
        except StopIteration as end:
            return end.value


def test_a_quick_answer_is_passed_on_without_a_check():
    quick = Statement(QUIET_SECONDS / 2)
    assert quick.run(lambda: None) == "answer"
    assert quick.checked_at == []


def test_a_slow_statement_of_a_live_server_is_awaited():
    slow = Statement(3.5 * QUIET_SECONDS)
    assert slow.run(lambda: None) == "answer"
    assert len(slow.checked_at) == 3


def test_a_dead_server_is_given_up():
    def fail():
        raise ConnectionError

    silent = Statement(1e9)
    with pytest.raises(ConnectionError):
        silent.run(fail)
    assert silent.now == pytest.approx(QUIET_SECONDS, abs=0.2)


def test_the_primary_is_tried_first_and_a_silent_server_last():
    order, one, two, three = ServerOrder(), ("db-1", "1"), ("db-2", "1"), ("db-3", "1")
    assert order.sort([one, two, three]) == [one, two, three]
    order.answered(two)
    assert order.sort([one, two, three]) == [two, one, three]
    order.was_silent(two)
    assert order.sort([one, two, three]) == [one, three, two]
    order.answered(three)
    assert order.sort([one, two, three]) == [three, one, two]
    order.answered(two)
    assert order.sort([one, two, three]) == [two, one, three]
