"""A run of the demo: check, migrate, seed, start everything, print the links, and end it all."""

import datetime
import os
import secrets
import shutil
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from django.conf import settings
from django.core.management import call_command
from django.db import DatabaseError, InterfaceError, connection
from django.utils import timezone

from experiments.publishing import NotPublishableError
from robots.models import Robot, RobotPresence
from robots.process.ending import ignore_end_signals, interrupted_by_signals
from sessions.models import ManagerBeat
from telepresence_site.children import Child, Children
from telepresence_site.demo import lan
from telepresence_site.demo.ports import LOOPBACK, answers, free_port, listening
from telepresence_site.demo.seed import RESEARCHER, ROBOTS, seed
from telepresence_site.demo.study import publish_study
from telepresence_site.demo.supervision import DemoPart, PartLostError, ServiceSupervisor
from telepresence_site.practice.supervisor import READY
from telepresence_site.serving import APPLICATION, DAPHNE

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# Each robot has a simulated office of its own; a person walks about in Giraff's.
MOVING_THINGS = {"giraff": ["--option", "people=1"]}
DELETED_BY_RESET = ("broker", "credentials", "log", "static", "media", "agent", "mail", "sandboxes")
START_SECONDS = 30.0  # that each part may need after the one before it is ready
WATCH_SECONDS = 0.2


class DemoError(Exception):
    """The demo cannot go on; the message is one sentence."""


@dataclass(frozen=True)
class Options:
    port: int
    lan: bool
    reset: bool


class Terminal:
    """Prints steps, each with its duration on the same line, and sentences on own lines."""

    def __init__(self) -> None:
        self._is_open = False  # a step's line

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Print a step's name, and how long it took."""
        started = time.monotonic()
        self._begin(name)
        try:
            yield
        except BaseException:
            self._end("failed")
            raise
        if not self._is_open:
            self._begin(name)
        self._end(f"{time.monotonic() - started:5.1f} s")

    def tell(self, sentence: str) -> None:
        if self._is_open:
            self._end("…")
        print(f"  {sentence}", flush=True)

    def _begin(self, name: str) -> None:
        self._is_open = True
        print(f"  {name:<44}", end="", flush=True)

    def _end(self, result: str) -> None:
        self._is_open = False
        print(f" {result}", flush=True)


def require_free(host: str, port: int) -> None:
    """Raise DemoError when the port cannot be listened on."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except PermissionError as error:
            raise DemoError(
                f"Port {port} needs more rights than this user has: choose one above 1023, such as"
                " --port 8000 (in a clone, make demo PORT=8000)."
            ) from error
        except (OSError, OverflowError) as error:
            other = port % 64000 + 1
            raise DemoError(
                f"Port {port} is in use: stop the program that uses it, or choose "
                f"another one with --port {other} (in a clone, make demo PORT={other})."
            ) from error


@contextmanager
def only_demo_in(folder: Path) -> Iterator[None]:
    """Raise DemoError when another demo uses the data in a folder: their session managers would
    share its robots although each has a broker of its own. Windows, without such locks, allows it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "demo.lock").open("a") as file:
        try:
            if fcntl is not None:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise DemoError(
                f"A demo is already running with the data in {folder}: press Ctrl-C where it runs, "
                "or start another one with VAR_DIR=/tmp/demo and another port."
            ) from error
        yield


class Demo:
    def __init__(self, options: Options) -> None:
        self.options = options
        self.hosts = lan.addresses() if options.lan else []
        if options.lan and not self.hosts:
            raise DemoError(
                "No network address was found that other devices can reach: connect "
                "to a network, or leave out LAN=1."
            )
        self.scheme, self.host = ("https", self.hosts[0]) if options.lan else ("http", LOOPBACK)
        self.token = secrets.token_urlsafe(12)
        self.mqtt_url = f"mqtt://{LOOPBACK}:{free_port()}"
        self.terminal = Terminal()
        self.children = Children(settings.VAR_DIR / "log", self._environment())
        self.supervisor = ServiceSupervisor(self.children, self.terminal.tell)
        self.password = ""
        self.study = ""

    @property
    def address(self) -> str:
        return f"{self.scheme}://{self.host}:{self.options.port}"

    def _environment(self) -> dict[str, str]:
        changes = {
            "MQTT_URL": self.mqtt_url,
            "DEMO_TOKEN": self.token,
            "HTTP_ONLY": "" if self.options.lan else "1",
            "HSTS_SECONDS": "0",  # browsers must not remember a self-signed certificate
            "ALLOWED_HOSTS": ",".join([LOOPBACK, "localhost", *self.hosts]),
            # everyone who opens the link is the same visitor
            "SOCKETS_PER_USER": str(settings.SOCKETS_PER_ADDRESS),
            "PRACTICE_ROBOTS": str(settings.PRACTICE_ROBOTS or 1),
            "PYTHONUNBUFFERED": "1",
        }
        return {**os.environ, **changes}

    def prepare(self) -> None:
        """Bring database, static files and seed up to date."""
        host = "0.0.0.0" if self.options.lan else LOOPBACK  # noqa: S104 -- LAN=1 asks for it
        require_free(host, self.options.port)
        if self.options.reset:
            with self.terminal.step("start over"):
                self._reset()
        with self.terminal.step("database"):
            call_command("migrate", verbosity=0, skip_checks=False)
        with self.terminal.step("static files"):
            call_command("collectstatic", verbosity=0, interactive=False)
        with self.terminal.step("people, floor plan, robots"):
            self.password = seed(self.mqtt_url)
            # Otherwise a robot that an earlier run left online would count as started.
            RobotPresence.objects.update(connection="OFFLINE", boot="")

    def _reset(self) -> None:
        var: Path = settings.VAR_DIR
        connection.close()
        if settings.DATABASES["default"]["ENGINE"] != "django.db.backends.sqlite3":
            raise DemoError(
                "RESET=1 empties the built-in database only, but DATABASE_URL names "
                "another one: leave out RESET=1 or DATABASE_URL."
            )
        for suffix in ("", "-wal", "-shm"):
            (var / f"telepresence.sqlite3{suffix}").unlink(missing_ok=True)
        for name in DELETED_BY_RESET:
            shutil.rmtree(var / name, ignore_errors=True)

    def start(self) -> None:
        """Start every process, and publish the study when the robots have reported."""
        manage = str(settings.BASE_DIR / "manage.py")
        mqtt_port = self.mqtt_url.rpartition(":")[2]
        run_broker = [manage, "run_broker", "--host", LOOPBACK, "--port", mqtt_port]
        run_manager, run_practice = [manage, "run_session_manager"], [manage, "run_practice"]
        essential = {
            "broker": (run_broker, lambda child: "broker listening" in child.output()),
            "session manager": (run_manager, _has_manager_beat),
            "web server": (self._daphne(), lambda _child: self._web_answers()),
        }
        robots = [
            DemoPart(
                f"simulated {title}",
                [manage, "run_robot", name, *MOVING_THINGS.get(name, [])],
                lambda child, name=name: _robot_is_online(name, child.started_at),
            )
            for name, title, *_ in ROBOTS
        ]
        # starts robots only when a visitor waits
        practice = DemoPart(
            "practice supervisor",
            run_practice,
            lambda child: READY in child.output(),
            has_notices=True,
        )
        parts = [DemoPart(name, *how, is_essential=True) for name, how in essential.items()]
        self.supervisor.start(
            [*parts, *robots, practice], within=START_SECONDS, step=self.terminal.step
        )
        with self.terminal.step("a study, ready to take part in"):
            self._publish()

    def _publish(self) -> None:
        try:
            self.study = publish_study(timezone.now())
        except (NotPublishableError, DatabaseError, InterfaceError) as error:
            self.terminal.tell(f"The demo's study cannot be published yet: {error}")

    def _daphne(self) -> list[str]:
        if not self.options.lan:
            return [*DAPHNE, "-b", LOOPBACK, "-p", str(self.options.port), APPLICATION]
        key, certificate = lan.certificate(settings.VAR_DIR / "secrets", self.hosts)
        endpoint = (
            f"ssl:{self.options.port}:privateKey={key}:certKey={certificate}:interface=0.0.0.0"
        )
        return [*DAPHNE, "-e", endpoint, APPLICATION]

    def _web_answers(self) -> bool:
        # the self-signed certificate cannot be verified, so an open port must be enough
        return listening(self.options.port) if self.options.lan else answers(self.address)

    def say_where(self) -> None:
        link = f"{self.address}/demo/{self.token}/giraff/"
        print(f"\n  Drive Giraff now:  {link}\n", flush=True)
        if self.options.lan:
            lan.qr_code(link)
            print(
                "\n  The certificate is self-signed: your browser asks once whether to continue.\n"
            )
        print(f"  Everybody else:    {self.address}/")
        if self.study:
            self._say_where_to_take_part()
        print(
            f"  Researcher:        {self.address}/admin/   name {RESEARCHER}   password"
            f" {self.password}"
        )
        print(f"\n  Logs: {self.children.log_dir}    Ctrl-C ends everything.\n", flush=True)

    def _say_where_to_take_part(self) -> None:
        link = f"{self.address}/studies/{self.study}/"
        print(f"  Take part:         {link}   (the paper's study; without an account)", flush=True)

    def watch(self) -> None:
        """Restart what ends, for ever.

        Raises:
            PartLostError: broker, session manager or web server ended too often.
        """
        while True:
            if self.supervisor.look() and not self.study:
                self._publish()
                if self.study:
                    self._say_where_to_take_part()
            time.sleep(WATCH_SECONDS)


def _in_database(question: Callable[[], bool]) -> bool:
    """Ask the database; False while it does not answer."""
    try:
        return question()
    except (DatabaseError, InterfaceError):
        connection.close()
        return False


def _has_manager_beat(child: Child) -> bool:
    return _in_database(ManagerBeat.objects.filter(beat_at__gte=child.started_at).exists)


def _robot_is_online(name: str, since: datetime.datetime) -> bool:
    """Tell whether a robot's agent that was started `since` then has sent its factsheet."""

    def is_online() -> bool:
        robot = Robot.objects.get(name=name)
        # the id begins with the time in ms, in hexadecimal (robots.agent.agent.new_boot)
        booted_at = int(robot.presence.boot.partition("-")[0] or "0", 16) / 1000.0
        return (
            robot.presence.factsheet is not None
            and booted_at >= since.timestamp() - 0.001
            and robot.is_online(timezone.now())
        )

    return _in_database(is_online)


def run(options: Options) -> int:
    """Run the demo until Ctrl-C or SIGTERM and return the exit code."""
    with interrupted_by_signals():
        try:
            with only_demo_in(settings.VAR_DIR):
                return _run(options)
        except DemoError as error:
            print(f"\n{error}", file=sys.stderr)
            return 1


def _run(options: Options) -> int:
    demo = None
    try:
        demo = Demo(options)
        demo.prepare()
        demo.start()
        demo.say_where()
        demo.watch()
    except KeyboardInterrupt:
        print("\n  Stopping …", flush=True)
        return 0 if demo is not None and demo.password else 130
    except PartLostError as error:
        print(f"\n{error}", file=sys.stderr)
        return 1
    finally:
        ignore_end_signals()
        if demo is not None:
            demo.children.stop()
    return 0
