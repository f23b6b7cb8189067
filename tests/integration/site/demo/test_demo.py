"""`manage.py demo`: a link that drives, clear endings, and no process left behind."""

import contextlib
import fcntl
import re
import signal
import socket
import sqlite3
import sys
import urllib.request
from html import unescape
from pathlib import Path

import psutil
import pytest

from tests.support.browsers.running_demo import demo
from tests.support.patience import patient
from tests.support.programs.finished import run, site_environment
from tests.support.sessions.site import DATABASE, LOOPBACK, free_port

pytestmark = pytest.mark.long


def users_of(var: Path) -> list[tuple[str, str]]:
    with contextlib.closing(sqlite3.connect(var / DATABASE, timeout=20)) as connection:
        rows = connection.execute("SELECT username, id FROM accounts_user ORDER BY username")
        return rows.fetchall()


@pytest.mark.nightly
def test_busy_port_is_named_in_one_sentence(tmp_path):
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        taken.listen()
        port = taken.getsockname()[1]
        with demo(tmp_path, "--port", str(port)) as running:
            assert running.process.wait(patient(30.0)) == 1
    assert f"Port {port} is in use" in running.said().strip().splitlines()[-1]


@pytest.mark.nightly
def test_second_demo_with_the_same_data_is_refused_in_one_sentence(tmp_path):
    with (tmp_path / "demo.lock").open("a") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with demo(tmp_path, "--port", str(free_port())) as running:
            assert running.process.wait(patient(30.0)) == 1
    assert "A demo is already running" in running.said().strip().splitlines()[-1]


def test_demo_runs_on_a_system_without_file_locks(tmp_path):
    program = (
        "import sys; sys.modules['fcntl'] = None\n"  # as on Windows, importing it fails
        "import django; django.setup()\n"
        "from pathlib import Path; from telepresence_site.demo.run import only_demo_in\n"
        "with only_demo_in(Path(sys.argv[1])): print('runs')"
    )
    environment = site_environment(tmp_path, HTTP_ONLY="1")
    done = run(sys.executable, "-c", program, str(tmp_path), env=environment)
    assert (done.stdout, done.returncode) == ("runs\n", 0), done.stderr


@pytest.mark.parametrize("port", ["0", "65536", "eighty"])
def test_malformed_port_is_refused_in_one_sentence(tmp_path, port):
    with demo(tmp_path, "--port", port) as running:
        assert running.process.wait(patient(30.0)) != 0
    assert "PORT must be a number" in running.said()


ENDINGS = [
    pytest.param(signal.SIGINT, True, id="Ctrl-C in the background"),
    pytest.param(signal.SIGTERM, False, id="SIGTERM", marks=pytest.mark.soak),
]


@pytest.mark.parametrize(("number", "background"), ENDINGS)
def test_demo_opens_the_robot_ends_all_processes_and_keeps_its_data(tmp_path, number, background):
    port = free_port()
    with demo(tmp_path, "--port", str(port), background=background) as running:
        jar = urllib.request.HTTPCookieProcessor()
        page = urllib.request.build_opener(jar).open(running.link(), timeout=patient(20))
        assert page.status == 200
        assert page.url.endswith("/robots/giraff/?go=1")
        assert "researcher" in running.said()
        running.waits_to_say("Logs:", 10)
        study = re.search(r"Take part:\s+(\S+)", running.said())
        stranger = urllib.request.build_opener()
        front = unescape(stranger.open(study.group(1), timeout=patient(20)).read().decode())
        assert "Explore an office with a robot" in front
        assert "You don't need an account or a name." in front
        family = running.family()
        assert len(family) >= 5
        running.process.send_signal(number)
        running.waits_to_say("Stopping", 10)
        assert running.end(number) == 0, "a second signal does no harm"
        _, alive = psutil.wait_procs(family, timeout=40)
        assert alive == []
    people = users_of(tmp_path)
    with demo(tmp_path, "--port", str(port)) as again:
        again.link()
        assert users_of(tmp_path) == people


@pytest.mark.nightly
def test_children_of_a_killed_demo_end(tmp_path):
    with demo(tmp_path, "--port", str(free_port())) as running:
        running.link()
        family = running.family()
        running.end(signal.SIGKILL)
        _, alive = psutil.wait_procs(family, timeout=40)
        assert alive == []


@pytest.mark.nightly
def test_starting_over_deletes_the_data_of_earlier_runs(tmp_path):
    port = str(free_port())
    with demo(tmp_path, "--port", port) as running:
        running.link()
    before = dict(users_of(tmp_path))
    message = tmp_path / "mail" / "to-anna.log"
    message.parent.mkdir(exist_ok=True)
    message.write_text("Subject: your turn")
    with demo(tmp_path, "--port", port, "--reset") as running:
        running.link()
    assert not message.exists()
    after = dict(users_of(tmp_path))
    assert before.keys() == after.keys()
    assert before["visitor"] != after["visitor"]
