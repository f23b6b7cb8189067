"""The whole system on one machine, as processes, for tests that break parts of it: broker, session
manager, web server, robots.
"""

import collections
import contextlib
import fcntl
import functools
import itertools
import json
import os
import random
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, TypeVar

from telepresence_site.serving import APPLICATION, DAPHNE
from tests.support.agents.truth import Onlooker
from tests.support.analysis.kept_folder import kept_folder
from tests.support.collected import collected_files
from tests.support.django_shell import DjangoShell
from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.programs.finished import run

T = TypeVar("T")
LOOPBACK = "127.0.0.1"
DEMO_TOKEN = "tests-only"
DATABASE = "telepresence.sqlite3"
PRESENCE = "FROM robots_robotpresence JOIN robots_robot ON robots_robot.id = robot_id"
NO_BROKER = "mqtt://127.0.0.1:1"  # in the credentials that each site begins with
# What the tables are made from: our migrations, and those of what is installed.
MIGRATIONS = [
    *ROOT.glob("*/migrations/*.py"),
    *ROOT.glob("requirements*.lock"),
    ROOT / "telepresence_site" / "settings.py",
]
# Below those that the system gives to whoever asks for any: one of these would be somebody else's
# before the program listens that it is for.
LOWEST_PORT, PORTS = 20_000, 12_000
APART = 7  # some programs take the port above theirs as well


def _numbers() -> Iterator[int]:
    """Numbers of ports, each a long time before it comes again."""
    begun = random.SystemRandom().randrange(PORTS)
    return (LOWEST_PORT + (begun + APART * number) % PORTS for number in itertools.count())


_NUMBERS = _numbers()
# Held as long as a test could need it, and no more files than a process may have open.
_TAKEN: collections.deque[IO[str]] = collections.deque(maxlen=200)


def free_port() -> int:
    """Return a port on which nobody listens, and which no other test of this computer is told."""
    folder = Path(tempfile.gettempdir()) / "telepresence-ports"
    folder.mkdir(mode=0o777, exist_ok=True)
    for port in _NUMBERS:
        taken = (folder / str(port)).open("w")
        with contextlib.suppress(OSError), socket.socket() as probe:
            fcntl.flock(taken, fcntl.LOCK_EX | fcntl.LOCK_NB)
            probe.bind(("", port))
            _TAKEN.append(taken)
            return port
        taken.close()
    raise AssertionError("there is always another")


def wait_for(
    condition: Callable[[], T], within: float, what: str, state: Callable[[], object] = str
) -> T:
    """Return the first truthy value of `condition()`, or fail saying what never came, and how
    things are by then.
    """
    deadline = time.monotonic() + patient(within)
    while not (value := condition()):
        assert time.monotonic() < deadline, f"{what} did not come within {within} s {state()}"
        time.sleep(0.05)
    return value


@functools.cache
def empty_database() -> Path:
    """Return an SQLite database with all tables and nothing in them, made once for the migrations
    as they are: to copy it takes no time.
    """
    return kept_folder("sqlite", MIGRATIONS, _migrate) / DATABASE


def _migrate(folder: Path) -> None:
    Site(folder).run("manage.py", "migrate", "-v", "0")


@functools.cache
def seeded_var() -> Path:
    """Return what a site of tests begins with: the demo's people, robots, plan and credentials."""
    folders = ("accounts", "robots", "telepresence_site")
    sources = [path for name in folders for path in (ROOT / name).rglob("*") if path.is_file()]
    sources = [path for path in sources if "__pycache__" not in path.parts]
    return kept_folder("seeded", [*MIGRATIONS, *sources], _seed)


def _seed(folder: Path) -> None:
    shutil.copyfile(empty_database(), folder / DATABASE)
    # A robot that goes home after every visit is a test of its own; in all others the next
    # visitor need not wait for it.
    code = (
        f"import django; django.setup(); from telepresence_site.demo.seed import seed;"
        f"seed({NO_BROKER!r}); from robots.models import Robot;"
        "Robot.objects.update(returns_home=False)"
    )
    Site(folder).run("-c", code)


@dataclass
class Site:
    """Everything that `manage.py demo` runs, each part of it in the test's hands."""

    var: Path
    web_port: int = field(default_factory=free_port)
    mqtt_port: int = field(default_factory=free_port)
    bind: str = LOOPBACK
    settings: dict[str, str] = field(default_factory=dict)
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)
    commands: dict[str, list[str]] = field(default_factory=dict)
    django_shell: DjangoShell | None = None

    @property
    def url(self) -> str:
        return f"http://{LOOPBACK}:{self.web_port}"

    @property
    def mqtt_url(self) -> str:
        return f"mqtt://{LOOPBACK}:{self.mqtt_port}"

    @property
    def environment(self) -> dict[str, str]:
        kept = {name: value for name, value in os.environ.items() if name != "DATABASE_URL"}
        ours = {
            "VAR_DIR": str(self.var),
            "MQTT_URL": self.mqtt_url,
            "HTTP_ONLY": "1",
            "DEMO_TOKEN": DEMO_TOKEN,
            "PYTHONUNBUFFERED": "1",
            "DJANGO_SETTINGS_MODULE": "telepresence_site.settings",
            "LOG_LEVEL": "INFO",
        }
        return {**kept, **ours, **self.settings}

    # --- the database, as seen from outside ---

    def prepare(self) -> None:
        shutil.copytree(seeded_var(), self.var, dirs_exist_ok=True)
        for path in (self.var / "credentials").iterdir():
            path.write_text(path.read_text().replace(NO_BROKER, self.mqtt_url))
        (self.var / "static").symlink_to(collected_files())

    def run(self, *arguments: str, within: float = 120.0) -> str:
        """Run Python, and return what it prints."""
        done = run(sys.executable, *arguments, env=self.environment, timeout=within)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def django(self, code: str) -> str:
        """Run Python with Django set up, and return what it prints."""
        self.django_shell = self.django_shell or DjangoShell(ROOT, self.environment)
        return self.django_shell.ask(code)

    def rows(self, sql: str, *values: Any) -> list[tuple[Any, ...]]:
        with contextlib.closing(sqlite3.connect(self.var / DATABASE, timeout=20)) as connection:
            return connection.execute(sql, values).fetchall()

    def states(self, session: str) -> list[dict[str, Any]]:
        """Every recorded state of a session, in order."""
        chunks = self.rows(
            "SELECT states FROM telepresence_sessions_statechunk WHERE session_id = ? ORDER BY"
            " first_stamp",
            session.replace("-", ""),
        )
        return [state for (states,) in chunks for state in json.loads(states)]

    def sessions(self) -> list[tuple[Any, ...]]:
        """(id, visitor, state, outcome) of every session, oldest first."""
        return self.rows(
            "SELECT s.id, u.username, s.state, s.outcome FROM telepresence_sessions_session s"
            " JOIN accounts_user u ON u.id = s.visitor_id ORDER BY s.queued_at"
        )

    def renewal(self, robot: str) -> int:
        """How often the lease of a robot has been renewed."""
        sql = (
            "SELECT l.renewal FROM telepresence_sessions_lease l JOIN robots_robot r ON r.id ="
            " l.robot_id WHERE r.name = ?"
        )
        return int(self.rows(sql, robot)[0][0])

    def sign_in(self, name: str) -> str:
        """Make a visitor if there is none of this name, and return the value of a session cookie
        that is signed in.
        """
        return self.django(
            "from accounts.models import User; from tests.support.browsers.pages import cookie_of;"
            f" print(cookie_of(User.objects.get_or_create(username={name!r})[0]))"
        ).strip()

    # --- its processes ---

    def start(self, name: str, arguments: list[str] | None = None) -> None:
        """Start a part; its output goes to a log in var/log."""
        if arguments is not None:
            self.commands[name] = arguments
        (self.var / "log").mkdir(parents=True, exist_ok=True)
        with (self.var / "log" / f"{name}.log").open("ab") as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, *self.commands[name]],
                cwd=ROOT,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    def log(self, name: str) -> str:
        return (self.var / "log" / f"{name}.log").read_text(errors="replace")

    def send(self, name: str, number: int) -> None:
        self.processes[name].send_signal(number)

    def stop(self, name: str, number: int = signal.SIGTERM) -> None:
        process = self.processes.pop(name)
        if process.poll() is None:
            process.send_signal(number)
            process.send_signal(signal.SIGCONT)
        try:
            process.wait(patient(15))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise AssertionError(f"{name} did not end: {self.log(name)[-2000:]}") from None

    def succeed(self, name: str, waits: str) -> None:
        """Start another of a part, wait until its log says that it waits, and kill the first: a
        busy computer takes long to start one.
        """
        first = self.processes.pop(name)
        self.start(name)
        wait_for(lambda: waits in self.log(name), 30, f"a second {name}")
        first.kill()
        first.wait()

    def stop_all(self) -> None:
        problems = []
        for name in reversed(list(self.processes)):
            try:
                self.stop(name)
            except AssertionError as problem:
                problems.append(str(problem))
        if self.django_shell is not None:
            self.django_shell.close()
            self.django_shell = None
        assert not problems, problems

    def start_servers(self) -> None:
        """Start all three at once: whoever is there before the broker tries again."""
        self._begin_broker()
        self.start("session-manager", ["manage.py", "run_session_manager"])
        self.start_web()
        wait_for(lambda: self.web_answers("readyz"), 30, "a server with all its parts")

    def start_web(self) -> None:
        self.start("web", [*DAPHNE, "-b", self.bind, "-p", str(self.web_port), APPLICATION])

    def start_broker(self) -> None:
        self._begin_broker()
        wait_for(lambda: self.listening(self.mqtt_port), 20, "the broker")

    def _begin_broker(self) -> None:
        self.start(
            "broker", ["manage.py", "run_broker", "--host", LOOPBACK, "--port", str(self.mqtt_port)]
        )

    def start_robot(self, name: str, *simulator: str, agent: tuple[str, ...] = ()) -> Onlooker:
        """Start a simulated robot and its agent, each with these arguments in a process of its own,
        and return who sees the truth of it.

        Its camera has six pictures a second unless they say otherwise: more costs a computer
        without a graphics card a core for each browser.
        """
        port = free_port()
        words = f"-m robots.simulator --profile {name} --listen {LOOPBACK}:{port} --fps 6".split()
        self.start(f"{name}-simulator", [*words, *simulator])
        words = f"manage.py run_robot {name} --option address={LOOPBACK}:{port} --var".split()
        self.start(name, [*words, str(self.var), *agent])
        wait_for(lambda: self.robot_is_online(name), 30, f"{name} online")
        # it has touched the contacts for long enough: before, a study would have its participant
        # wait
        if "dock" in simulator:
            wait_for(lambda: self.robot_is_docked(name), 10, f"{name} docked")
        return Onlooker(port)

    @contextlib.contextmanager
    def robot(self, name: str, *simulator: str) -> Iterator[Onlooker]:
        """As `start_robot`, and end it afterwards, if the test has not."""
        onlooker = self.start_robot(name, *simulator)
        yield onlooker
        for part in (name, f"{name}-simulator"):
            if part in self.processes:
                self.stop(part)
        wait_for(lambda: not self.robot_is_online(name), 20, "the robot's end")

    def listening(self, port: int) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex((LOOPBACK, port)) == 0

    def web_answers(self, path: str = "healthz") -> bool:
        try:
            with urllib.request.urlopen(f"{self.url}/{path}", timeout=2) as answer:
                return answer.status == 200
        except (urllib.error.URLError, OSError):
            return False

    def robot_is_online(self, name: str) -> bool:
        """Whether its agent is there, reaches the robot itself, and was heard of just now: after
        the session manager was away for long, visitors are refused until then.
        """
        reached = (
            "connection = 'ONLINE' AND report LIKE '{%' AND report NOT LIKE '%adapter_lost: %'"
            " AND julianday('now') - julianday(last_seen_at) < 10.0 / 86400.0"
        )
        return bool(self.rows(f"SELECT 1 {PRESENCE} WHERE name = ? AND {reached}", name))

    def robot_is_docked(self, name: str) -> bool:
        """Whether the robot says that it is docked."""
        docked = "json_extract(report, '$.docked')"
        return bool(self.rows(f"SELECT 1 {PRESENCE} WHERE name = ? AND {docked}", name))


@contextlib.contextmanager
def running_site(var: Path, bind: str = LOOPBACK, **settings: str) -> Iterator[Site]:
    """A site with its servers up and no robot; everything is ended afterwards."""
    site = Site(var, bind=bind, settings=settings)
    try:
        site.prepare()
        site.start_servers()
        yield site
    finally:
        site.stop_all()
