"""Connections of a web process to PostgreSQL."""

import time

import pytest

from tests.support.django_shell import DjangoShell
from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.programs.finished import site_environment
from tests.support.programs.postgres import running_postgres

pytestmark = pytest.mark.postgres
POLL = """
import asyncio
from asgiref.testing import ApplicationCommunicator
from telepresence_site.asgi import application

SCOPE = {
    "type": "http", "method": "GET", "path": "/robots.json", "query_string": b"",
    "headers": [(b"host", b"localhost")], "http_version": "1.1", "scheme": "http",
    "client": ("127.0.0.1", 1), "server": ("localhost", 80),
}

async def poll():
    page = ApplicationCommunicator(application, SCOPE)
    await page.send_input({"type": "http.request", "body": b"", "more_body": False})
    status = (await page.receive_output(30))["status"]
    await page.receive_output(30)
    await page.wait(30)
    return status

async def abandon(seconds):
    page = ApplicationCommunicator(application, SCOPE)
    await page.send_input({"type": "http.request", "body": b"", "more_body": False})
    await asyncio.sleep(seconds)
    page.future.cancel()

async def poll_often():
    found = {await poll()}
    for number in range(ABANDONED):
        await abandon(0.001 * number)
    for _ in range(25):
        found |= set(await asyncio.gather(*(poll() for _ in range(4))))
    print(found)

asyncio.run(poll_often())
"""
ASK = "from robots.models import Robot; print(Robot.objects.count())"


@pytest.fixture
def server(tmp_path):
    with running_postgres() as server:
        settings = {"HTTP_ONLY": "1", "ALLOWED_HOSTS": "localhost"}
        environment = site_environment(tmp_path, DATABASE_URL=server.url, **settings)
        shell = DjangoShell(ROOT, environment)
        try:
            yield server, shell
        finally:
            shell.close()


def test_aborted_requests_keep_no_connection(server):
    postgres, shell = server
    assert shell.ask("ABANDONED = 60\n" + POLL).strip() == "{200}"
    open_now = "SELECT count(*) FROM pg_stat_activity WHERE datname = 'postgres'"
    deadline = time.monotonic() + patient(20.0)
    while (left := postgres.ask(open_now)[0][0]) > 5 and time.monotonic() < deadline:
        time.sleep(0.1)
    assert left <= 5


def test_database_that_is_available_again_is_used_at_once(server):
    postgres, shell = server
    assert shell.ask(ASK).strip() == "0"
    postgres.stop()
    began = time.monotonic()
    with pytest.raises(AssertionError, match="OperationalError"):
        shell.ask(ASK)
    with pytest.raises(AssertionError, match="OperationalError"):
        shell.ask(f"from django.db import connection; connection.close(); {ASK}")
    assert time.monotonic() - began < patient(14.0)
    postgres.start()
    assert shell.ask(f"from django.db import connection; connection.close(); {ASK}").strip() == "0"
