"""`manage.py stream_markers STUDY`: exchanges markers with the Lab Streaming Layer."""

import signal
import threading
import time
from argparse import ArgumentParser
from collections import deque
from importlib import import_module
from typing import Any

from django.core.management.base import BaseCommand, CommandError
from django.db import DatabaseError, InterfaceError, close_old_connections

from experiments.markers.incoming import ForeignMarker, record
from experiments.markers.outgoing import MarkerSource
from experiments.models import Study

POLL_INTERVAL_S = 0.1
DATABASE_PAUSE_S = 2.0
MAX_WAITING = 100_000  # markers that are kept while the database does not answer


class Command(BaseCommand):
    help = (
        "Publish the events of a study as markers of the Lab Streaming Layer, and record markers "
        "of other streams with its sessions. Needs the extra lsl."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        add = parser.add_argument
        add("study", help="name of the study")
        add("--name", default="", help="name of the stream; default: telepresence-STUDY")
        text = "name of a stream whose markers are recorded; may be repeated"
        add("--record", action="append", default=[], metavar="STREAM", help=text)

    def handle(self, *_args: Any, **options: Any) -> None:
        slug: str = options["study"]
        if not Study.objects.filter(slug=slug).exists():
            raise CommandError(f"There is no study {slug}.")
        lsl = _lsl()
        ended = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: ended.set())
        name = options["name"] or f"telepresence-{slug}"
        outlet = lsl.MarkerOutlet(name, f"telepresence:{slug}")
        inlets = [lsl.MarkerInlet(stream) for stream in options["record"]]
        loop = _Loop(slug, outlet, inlets, self._say)
        self._say(f"Stream {name} is open.")
        while not ended.is_set():
            ended.wait(loop.step(time.time()))

    def _say(self, text: str) -> None:
        self.stdout.write(text)
        self.stdout.flush()


def _lsl() -> Any:
    """Return the module that needs pylsl, an extra; without it or liblsl, raise CommandError."""
    try:
        return import_module("experiments.markers.lsl")
    except (ImportError, RuntimeError) as error:
        raise CommandError(
            f"This command needs pylsl with liblsl ({error}). Install it: "
            "python -m pip install pylsl"
        ) from error


class _Loop:
    """Runs a step ten times a second, and keeps the markers that could not be stored."""

    def __init__(self, slug: str, outlet: Any, inlets: list[Any], say: Any) -> None:
        self._slug, self._outlet, self._inlets, self._say = slug, outlet, inlets, say
        self._source = MarkerSource(slug, time.time())
        self._waiting: deque[ForeignMarker] = deque(maxlen=MAX_WAITING)
        self._has_database = True
        self._is_outside = False

    def step(self, now: float) -> float:
        """Publish and record the new markers; return the seconds until the next step."""
        polled = [inlet.poll() for inlet in self._inlets]
        self._waiting.extend(marker for markers, _news in polled for marker in markers)
        for news in (*(news for _markers, news in polled), self._outlet.news()):
            if news:
                self._say(news)
        try:
            self._use_database(now)
        except (DatabaseError, InterfaceError) as error:
            close_old_connections()
            if self._has_database:
                self._say(f"The database does not answer ({error}). Markers are kept.")
            self._has_database = False
            return DATABASE_PAUSE_S
        if not self._has_database:
            self._say("The database answers again.")
        self._has_database = True
        return POLL_INTERVAL_S

    def _use_database(self, now: float) -> None:
        for one in self._source.new(now):
            self._outlet.push(one.marker.text(), one.at)
        while self._waiting:
            is_outside = record(self._slug, self._waiting[0], now) == 0
            self._waiting.popleft()
            if is_outside and not self._is_outside:
                self._say("Markers outside sessions are not recorded.")
            self._is_outside = is_outside
