"""The demo from its first line to its last: check, migrate, seed, start everything, say where it is, and end it all."""

import os
import secrets
import shutil
import signal
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from django.conf import settings
from django.core.management import call_command
from django.db import connection
from django.utils import timezone

from experiments.publishing import NotPublishableError
from robots.models import Robot
from sessions.models import ManagerBeat
from telepresence_site.demo import lan
from telepresence_site.demo.children import Children, Part, StartFailed
from telepresence_site.demo.ports import LOOPBACK, answers, free_port, listening
from telepresence_site.demo.seed import RESEARCHER, ROBOTS, seed
from telepresence_site.demo.study import publish_study
from telepresence_site.serving import APPLICATION, DAPHNE

COMPANY = {"giraff": ["--option", "people=1"]}  # each robot lives in a simulated office of its own; somebody walks about in Giraff's


class DemoError(Exception):
    """The demo cannot go on; the message is one sentence."""


@dataclass(frozen=True)
class Options:
    """What the command line asked for."""

    port: int
    lan: bool
    reset: bool


@contextmanager
def step(name: str) -> Iterator[None]:
    """Print a step's name, and how long it took."""
    started = time.monotonic()
    print(f"  {name:<44}", end="", flush=True)
    try:
        yield
    except BaseException:
        print(" failed")
        raise
    print(f" {time.monotonic() - started:5.1f} s", flush=True)


def require_free(host: str, port: int) -> None:
    """Raise DemoError when somebody listens there already."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except PermissionError as error:
            raise DemoError(f"Port {port} needs more rights than this user has: choose one above 1023, such as make demo PORT=8000.") from error
        except (OSError, OverflowError) as error:
            raise DemoError(
                f"Port {port} is in use: stop what listens there, or choose another one with make demo PORT={port % 64000 + 1}."
            ) from error


class Demo:
    """One run of the demo."""

    def __init__(self, options: Options) -> None:
        self.options = options
        self.hosts = lan.addresses() if options.lan else []
        if options.lan and not self.hosts:
            raise DemoError("No network address was found that other devices could reach: connect to a network, or leave LAN=1 out.")
        self.scheme, self.host = ("https", self.hosts[0]) if options.lan else ("http", LOOPBACK)
        self.token = secrets.token_urlsafe(12)
        self.mqtt_url = f"mqtt://{LOOPBACK}:{free_port()}"
        self.children = Children(settings.VAR_DIR / "log", self._environment())
        self.password = ""
        self.study = ""

    @property
    def address(self) -> str:
        """Where the site is."""
        return f"{self.scheme}://{self.host}:{self.options.port}"

    def _environment(self) -> dict[str, str]:
        changes = {
            "MQTT_URL": self.mqtt_url,
            "DEMO_TOKEN": self.token,
            "HTTP_ONLY": "" if self.options.lan else "1",
            "HSTS_SECONDS": "0",  # a self-made certificate must not be remembered
            "ALLOWED_HOSTS": ",".join([LOOPBACK, "localhost", *self.hosts]),
            "SOCKETS_PER_USER": str(settings.SOCKETS_PER_ADDRESS),  # whoever opens the link is the same visitor
            "PRACTICE_ROBOTS": str(settings.PRACTICE_ROBOTS or 1),
            "PYTHONUNBUFFERED": "1",
        }
        return {**os.environ, **changes}

    def prepare(self) -> None:
        """Bring database, static files and seed up to date."""
        require_free("0.0.0.0" if self.options.lan else LOOPBACK, self.options.port)  # noqa: S104 -- LAN=1 asks for it
        if self.options.reset:
            with step("start over"):
                self._reset()
        with step("database"):
            call_command("migrate", verbosity=0)
        with step("static files"):
            call_command("collectstatic", verbosity=0, interactive=False)
        with step("people, floor plan, robots"):
            self.password = seed(self.mqtt_url)
            # What an earlier run left behind is not news: without this a robot would look online before it is started.
            Robot.objects.update(connection="OFFLINE", boot="")

    def _reset(self) -> None:
        var: Path = settings.VAR_DIR
        connection.close()
        if settings.DATABASES["default"]["ENGINE"] != "django.db.backends.sqlite3":
            raise DemoError("RESET=1 empties the built-in database only: DATABASE_URL names another one, which is left alone.")
        for name in ("telepresence.sqlite3", "telepresence.sqlite3-wal", "telepresence.sqlite3-shm"):
            (var / name).unlink(missing_ok=True)
        for name in ("broker", "credentials", "log", "static", "media", "agent"):
            shutil.rmtree(var / name, ignore_errors=True)

    def start(self) -> None:
        """Start every process, and publish the study when the robots have said what they are."""
        began = timezone.now()
        mqtt_port = int(self.mqtt_url.rpartition(":")[2])
        manage = str(settings.BASE_DIR / "manage.py")
        parts = [
            Part("broker", [manage, "run_broker", "--host", LOOPBACK, "--port", str(mqtt_port)], lambda: listening(mqtt_port)),
            Part("session manager", [manage, "run_session_manager"], lambda: ManagerBeat.objects.filter(beat_at__gte=began).exists()),
            Part("web server", self._daphne(), self._web_answers),
        ]
        for name, title, *_ in ROBOTS:
            run_robot = [manage, "run_robot", name, *COMPANY.get(name, [])]
            parts.append(Part(f"simulated {title}", run_robot, lambda name=name: self._robot_is_online(name)))
        self.children.start_together(parts, step=step)
        self.children.start("practice", [manage, "run_practice"])  # its robots come when somebody waits
        with step("a study, ready to take part in"):
            self._publish()

    def _publish(self) -> None:
        try:
            self.study = publish_study(timezone.now())
        except NotPublishableError as error:
            raise DemoError(f"The demo's study cannot be published: {error}") from error

    def _daphne(self) -> list[str]:
        if not self.options.lan:
            return [*DAPHNE, "-b", LOOPBACK, "-p", str(self.options.port), APPLICATION]
        key, certificate = lan.certificate(settings.VAR_DIR / "secrets", self.hosts)
        endpoint = f"ssl:{self.options.port}:privateKey={key}:certKey={certificate}:interface=0.0.0.0"
        return [*DAPHNE, "-e", endpoint, APPLICATION]

    def _web_answers(self) -> bool:
        if self.options.lan:  # the certificate is nobody's to check here; that the port answers is enough
            return listening(self.options.port)
        return answers(self.address)

    def _robot_is_online(self, name: str) -> bool:
        robot = Robot.objects.get(name=name)
        return robot.factsheet is not None and robot.is_online(timezone.now())

    def say_where(self) -> None:
        """Print the links."""
        link = f"{self.address}/demo/{self.token}/giraff/"
        print(f"\n  Drive Giraff now:  {link}\n", flush=True)
        if self.options.lan:
            lan.qr_code(link)
            print("\n  The certificate is self-made: the browser will ask once whether to go on.\n")
        print(f"  Everybody else:    {self.address}/")
        print(f"  Take part:         {self.address}/studies/{self.study}/   (the paper's study)")
        print(f"  Researcher:        {self.address}/admin/   name {RESEARCHER}   password {self.password}")
        print(f"\n  Logs: {self.children.log_dir}    Ctrl-C ends everything.\n", flush=True)

    def watch(self) -> None:
        """Wait until a child ends by itself.

        Raises:
            DemoError: one did, which no child of the demo should.
        """
        while (child := self.children.ended()) is None:
            time.sleep(0.5)
        raise DemoError(f"The {child.name} ended: {child.last_words()} (its log: {child.log})")


def run(options: Options) -> int:
    """Run the demo until Ctrl-C or SIGTERM and return the exit code."""
    demo = None
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        demo = Demo(options)
        demo.prepare()
        demo.start()
        demo.say_where()
        demo.watch()
    except KeyboardInterrupt:
        print("\n  Stopping …", flush=True)
        return 0 if demo is not None and demo.password else 130
    except (DemoError, StartFailed) as error:
        print(f"\n{error}", file=sys.stderr)
        return 1
    finally:
        # A second Ctrl-C must not interrupt the ending.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if demo is not None:
            demo.children.stop()
    return 0


def _interrupt(_number: int, _frame: object) -> None:
    raise KeyboardInterrupt
