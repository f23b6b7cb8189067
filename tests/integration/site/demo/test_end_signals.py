"""Ctrl-C ends every command, also when it was started in the background, with all its children."""

import contextlib
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.support.patience import patient
from tests.support.sessions.site import LOOPBACK, Site, free_port, wait_for

pytestmark = [pytest.mark.long, pytest.mark.nightly]

DRAFT = (
    "from django.utils import timezone; from experiments import publishing; from"
    " experiments.definition.shipped import shipped;publishing.store(shipped()['exploration'],"
    " timezone.now())"
)


@contextlib.contextmanager
def background() -> Iterator[None]:
    """Start processes as the background of a shell does: with SIGINT ignored (POSIX, Shell Command
    Language, 2.11).
    """
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def silent() -> Iterator[socket.socket]:
    """A server that accepts connections and sends nothing."""
    with socket.create_server((LOOPBACK, 0)) as server:
        yield server


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, silent: socket.socket) -> Iterator[Site]:
    """A site with all commands, started together in the background."""
    site = Site(tmp_path_factory.mktemp("site"), settings={"PRACTICE_ROBOTS": "1"})
    try:
        site.prepare()
        site.django(DRAFT)
        with background():
            for name, (arguments, _) in commands(site.var, silent).items():
                site.start(name, arguments)
            site.start_broker()
        yield site
    finally:
        site.stop_all()


def commands(var: Path, silent: socket.socket) -> dict[str, tuple[list[str], str]]:
    """Return (arguments, what its log contains when it runs) by name."""
    silent_server = f"{LOOPBACK}:{silent.getsockname()[1]}"
    credentials = ["--credentials", str(var / "credentials" / "rhodon.toml"), "--var", str(var)]
    return {
        "run_session_manager": (["manage.py", "run_session_manager"], "session_manager_connected"),
        "run_practice": (["manage.py", "run_practice"], "practice ready"),
        "run_robot": (["manage.py", "run_robot", "giraff"], "simulator_connected"),
        "robots.agent": (["-m", "robots.agent", "rhodon", *credentials], "simulator_connected"),
        "robots.simulator": (
            ["-m", "robots.simulator", "--listen", f"{LOOPBACK}:{free_port()}"],
            '"address"',
        ),
        "mosquitto_files": (
            ["manage.py", "mosquitto_files", str(var), "--watch"],
            "mosquitto_files_written",
        ),
        "run_bots": (
            ["manage.py", "run_bots", "exploration", "--url", f"http://{silent_server}"],
            "",
        ),
        "rehearse_study": (["manage.py", "rehearse_study", "exploration"], ""),
    }


def family(site: Site, name: str) -> list[psutil.Process]:
    first = psutil.Process(site.processes[name].pid)
    return [first, *first.children(recursive=True)]


def runs(site: Site, name: str, words: str) -> bool:
    """Tell whether a command works: by its log, or else by its children and connections."""
    assert site.processes[name].poll() is None, site.log(name)
    if name == "rehearse_study":
        return any("run_broker" in process.cmdline() for process in family(site, name))
    if name == "run_bots":
        return any(
            link.status == psutil.CONN_ESTABLISHED
            for link in psutil.Process(site.processes[name].pid).net_connections()
        )
    return words in site.log(name)


def ends(site: Site, name: str, signals: int = 1) -> int:
    """Send Ctrl-C, also repeatedly as impatient users do, and return the exit code."""
    members, process = family(site, name), site.processes.pop(name)
    for _ in range(signals):
        process.send_signal(signal.SIGINT)
        with contextlib.suppress(Exception):
            process.wait(0.2)
    code = process.wait(patient(15))
    assert psutil.wait_procs(members, timeout=patient(10))[1] == []
    return code


ENDED = {"run_bots": -signal.SIGINT, "rehearse_study": 1}  # they did not finish


@pytest.mark.parametrize("name", commands(Path(), socket.socket()) | {"broker": ()})
def test_ctrl_c_ends_a_command_that_was_started_in_the_background(site, silent, name):
    words = commands(site.var, silent)[name][1] if name != "broker" else "broker listening"
    wait_for(lambda: runs(site, name, words), 60, f"{name} at work")
    code = ends(site, name, signals=2 if name == "rehearse_study" else 1)
    assert code == ENDED.get(name, 0), site.log(name)
    assert "Traceback" not in site.log(name)
    assert code <= 0 or "Stopped before the" in site.log(name)


def test_immediate_second_ctrl_c_leaves_no_simulator_running(site):
    with background():
        site.start("again", ["manage.py", "run_robot", "giraff", "--option", "seed=2"])
    wait_for(lambda: len(family(site, "again")) > 1, 30, "a simulator")
    ends(site, "again", signals=2)
