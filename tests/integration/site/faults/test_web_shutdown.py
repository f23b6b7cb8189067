"""A web process that is terminated while it answers."""

import contextlib
import http.client
import signal
import sqlite3
import threading

import psutil
import pytest

from tests.support.patience import patient
from tests.support.sessions.site import DATABASE, DEMO_TOKEN, LOOPBACK, Site, wait_for

pytestmark = pytest.mark.nightly

ASKING = 6  # requests at once


def test_web_process_ends_although_a_request_waits_for_the_database(tmp_path):
    site = Site(tmp_path / "var")
    try:
        site.prepare()
        site.start_servers()
        process = site.processes["web"]
        connection = sqlite3.connect(site.var / DATABASE, isolation_level=None)
        with contextlib.closing(connection) as database:
            database.execute("BEGIN IMMEDIATE")
            threads = psutil.Process(process.pid).num_threads
            idle = threads()
            for _ in range(ASKING):
                threading.Thread(target=_enter, args=[site.web_port], daemon=True).start()
            wait_for(lambda: threads() >= idle + ASKING // 2, 20, "threads that answer")
            process.send_signal(signal.SIGTERM)
            assert process.wait(patient(15)) == 0
    finally:
        site.stop_all()


def _enter(port: int) -> None:
    """Request a page that writes into the database."""
    with contextlib.suppress(OSError, http.client.HTTPException):
        connection = http.client.HTTPConnection(LOOPBACK, port, timeout=60)
        connection.request("GET", f"/demo/{DEMO_TOKEN}/giraff/")
        connection.getresponse().read()
