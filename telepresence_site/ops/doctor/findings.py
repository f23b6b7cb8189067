"""The checks of this machine, and the list of all checks."""

import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

from django.conf import settings
from django.core import checks
from django.db import DatabaseError, InterfaceError, connection
from django.db.migrations.executor import MigrationExecutor
from django.utils import timezone
from django.utils.translation import gettext as _

from robots.api.disk_space import MIB, DiskSpace
from sessions.models import ManagerBeat
from sessions.shards.rows import NAME
from telepresence_site.checks import SETTINGS
from telepresence_site.ops.fresh_site import is_fresh, setup_code
from telepresence_site.ops.health import WELL, managers_state

State = Literal["ok", "warning", "error"]
CLOCK = ("timedatectl", "show", "--property=NTPSynchronized", "--value")
CLOCK_SECONDS = 3.0


@dataclass(frozen=True)
class Finding:
    """The state of one part, and what to do if it is not `ok`."""

    part: str
    state: State
    detail: str
    advice: str = ""


Check = Callable[[], Iterator[Finding]]


def examine(here: Sequence[Check], elsewhere: Sequence[Check]) -> list[Finding]:
    """Return the findings of all checks; those that ask other computers run at the same time."""
    with ThreadPoolExecutor(max_workers=max(1, len(elsewhere))) as pool:
        waiting = [pool.submit(_all, check) for check in elsewhere]
        found = [finding for check in here for finding in check()]
        return found + [finding for one in waiting for finding in one.result()]


def _all(check: Check) -> list[Finding]:
    return list(check())


def database() -> Iterator[Finding]:
    part = _("Database")
    try:
        executor = MigrationExecutor(connection)
        missing = executor.migration_plan(executor.loader.graph.leaf_nodes())
    except (DatabaseError, InterfaceError) as error:
        advice = _("Start the database, and check DATABASE_URL.")
        yield Finding(part, "error", _("It does not answer: %(why)s") % {"why": error}, advice)
        return
    if missing:
        detail = _("%(n)d changes of the tables are not applied.") % {"n": len(missing)}
        yield Finding(part, "error", detail, _("Run manage.py migrate."))
        return
    kind = {"sqlite": "SQLite", "postgresql": "PostgreSQL"}.get(connection.vendor, "MongoDB")
    yield Finding(part, "ok", _("%(kind)s answers.") % {"kind": kind})


def administrator() -> Iterator[Finding]:
    """That a fresh site has no administrator, and how to create one."""
    try:
        if not is_fresh():
            return
    except (DatabaseError, InterfaceError):
        return  # the finding about the database says so
    advice = _("Open the site, and enter the code %(code)s.") % {"code": setup_code()}
    yield Finding(_("Administrator"), "warning", _("There is no account yet."), advice)


def session_manager() -> Iterator[Finding]:
    part = _("Session manager")
    advice = _("Start manage.py run_session_manager. Without it, nobody can drive.")
    try:
        rows = list(ManagerBeat.objects.filter(name__startswith=NAME))
    except (DatabaseError, InterfaceError):
        return  # the finding about the database says so
    word = managers_state(rows, timezone.now())
    faults = {
        "none": (_("It has never run."), advice),
        "silent": (_("It has stopped."), advice),
        "without_broker": (_("It can't reach the broker."), _("Check MQTT_URL and the broker.")),
        "behind": (
            _("It writes recordings more slowly than they arrive."),
            _("Check the database's disk, or record less."),
        ),
    }
    if word == WELL:
        yield Finding(part, "ok", _("It is running."))
    else:
        yield Finding(part, "error", *faults[word])


def storage() -> Iterator[Finding]:
    part = _("Storage")
    space = DiskSpace(settings.VAR_DIR, settings.DISK_LOW_MB)
    words = {"free": space.free() // MIB, "folder": settings.VAR_DIR}
    detail = _("%(free)d MB are free in %(folder)s.") % words
    state: State = {"ok": "ok", "low": "warning", "full": "error"}[space.state()]  # type: ignore[assignment]
    yield Finding(part, state, detail, "" if state == "ok" else _("Free some space."))


def clock() -> Iterator[Finding]:
    """Whether this computer's clock is synchronized, as systemd reports it. Log-in codes, TURN
    passwords and recordings need the right time.
    """
    part, advice = _("Clock"), _("Install and start a time service, such as systemd-timesyncd.")
    answer = ""
    if shutil.which(CLOCK[0]):
        try:
            done = subprocess.run(
                CLOCK, capture_output=True, text=True, timeout=CLOCK_SECONDS, check=False
            )
            answer = done.stdout.strip()
        except (OSError, subprocess.TimeoutExpired):
            answer = ""
    if answer == "yes":
        yield Finding(part, "ok", _("It is synchronized."))
    elif answer == "no":
        yield Finding(part, "error", _("It is not synchronized."), advice)
    else:
        now = timezone.now().strftime("%Y-%m-%d %H:%M:%S")
        detail = _("It says %(now)s UTC. Whether it is synchronized is unknown.") % {"now": now}
        yield Finding(part, "warning", detail, _("Compare it with a correct clock."))


def configuration() -> Iterator[Finding]:
    """What `manage.py check --deploy` finds in the settings."""
    found = checks.run_checks(
        tags=[SETTINGS, checks.Tags.security], include_deployment_checks=not settings.HTTP_ONLY
    )
    for message in found:
        if message.is_silenced() or message.level < checks.WARNING:
            continue
        state: State = "error" if message.is_serious() else "warning"
        yield Finding(_("Settings"), state, f"{message.msg} ({message.id})", message.hint or "")
    if not found:
        yield Finding(_("Settings"), "ok", _("No problem found."))
