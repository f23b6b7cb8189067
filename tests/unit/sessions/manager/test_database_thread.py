"""The thread in which a session manager waits for its database."""

import threading
import time

import pytest
from django.db import InterfaceError, OperationalError

from sessions.manager import database_thread as module
from sessions.manager.database_thread import DatabaseThread
from sessions.manager.health import ManagerHealth


class Connection:
    def __init__(self):
        self.closed_in = []

    def close(self):
        self.closed_in.append(threading.current_thread().name)


@pytest.fixture
def connection(monkeypatch):
    double = Connection()
    monkeypatch.setattr(module, "connection", double)
    return double


@pytest.fixture
def health():
    return ManagerHealth()


@pytest.fixture
async def thread(health):
    made = DatabaseThread("database", health)
    yield made
    await made.close()


def refuses(error):
    def step():
        raise error

    return step


@pytest.mark.parametrize("error", [OperationalError("gone"), InterfaceError("closed")])
async def test_a_refused_step_is_reported_and_the_next_one_gets_a_new_connection(
    thread, health, connection, error
):
    assert await thread.attempt(refuses(error), refused="later") == "later"
    assert health.faults(time.monotonic(), "ok") == ("database",)
    assert connection.closed_in == ["database_0"], "the thread's own"
    assert await thread.attempt(lambda: "done", refused="later") == "done"
    assert len(connection.closed_in) == 1


async def test_on_a_full_disk_the_connection_is_kept_for_there_is_no_room_for_another(
    thread, health, connection
):
    full = OperationalError("database or disk is full")
    assert await thread.attempt(refuses(full)) is None
    assert health.faults(time.monotonic(), "ok") == ("disk_full",)
    assert connection.closed_in == []


async def test_an_error_that_is_not_the_databases_is_raised(thread, health, connection):
    with pytest.raises(ZeroDivisionError):
        await thread.attempt(refuses(ZeroDivisionError()))
    assert health.faults(time.monotonic(), "ok") == ()


async def test_the_end_waits_for_the_step_that_runs_and_closes_the_connection(health, connection):
    made, done = DatabaseThread("database", health), []
    step = made.run(lambda: done.append(len(connection.closed_in)))
    closing = made.close()
    await step
    await closing
    assert done == [0]
    assert connection.closed_in == ["database_0"]
