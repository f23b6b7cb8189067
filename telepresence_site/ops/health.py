"""Whether this web process works, and the parts that it needs.

`/healthz` is for a supervisor, which restarts a process that does not reach database and broker.
`/readyz` is for a load balancer: it checks all parts, and answers with 200 if visitors should be
sent here, else 503, with a word for each part and the version. Both are public, and reveal nothing
else.
"""

import asyncio
import datetime
from collections.abc import Sequence

import structlog
from channels.db import database_sync_to_async
from django.conf import settings
from django.db import DatabaseError, InterfaceError
from django.http import HttpRequest, JsonResponse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from accounts.models import User
from robots.api.disk_space import DiskSpace
from robots.bridge import bridge
from sessions import page_channel
from sessions.models import STALE_SECONDS, ManagerBeat
from sessions.recording.recorder import LIMIT
from sessions.shards.rows import NAME
from telepresence import __version__

log = structlog.stdlib.get_logger(__name__)
PATIENCE_SECONDS = 1.0
# A disk that is nearly full is only reported, and so is a channel layer that is away: pages then
# learn later of what staff do (sessions/page_channel.py).
WELL, LOW, SLOW, SILENT = "ok", "low", "slow", "silent"
BEHIND = LIMIT // 4  # items that wait for the database; a busy site has a few hundred


class DiskReader:
    """Reads the free space of the disk in a thread: a failed disk may never answer, and then blocks
    only this thread.
    """

    def __init__(self) -> None:
        self._reading: asyncio.Future[int] | None = None

    async def read(self) -> tuple[str, int | None]:
        """Return the state of the disk, and its free bytes, None if it is `silent`."""
        loop = asyncio.get_running_loop()
        space = DiskSpace(settings.VAR_DIR, settings.DISK_LOW_MB)
        reading = self._reading
        if reading is None or reading.done() or reading.get_loop() is not loop:
            reading = self._reading = loop.run_in_executor(None, space.free)
        await asyncio.wait({reading}, timeout=PATIENCE_SECONDS)
        if not reading.done():
            return SILENT, None
        return space.word(reading.result()), reading.result()


disk = DiskReader()


@never_cache
@require_safe
async def healthz(_request: HttpRequest) -> JsonResponse:
    """Answer with 200 if this process reaches the database and the broker, else 503. The state of
    the disk never causes 503, because no restart frees space.
    """
    database = await database_sync_to_async(_database_answers)()
    broker = await bridge.current().wait_connected(PATIENCE_SECONDS)
    word, _free = await disk.read()
    return JsonResponse(
        {"database": database, "broker": broker, "disk": word},
        status=200 if database and broker else 503,
    )


def _database_answers() -> bool:
    try:
        User.objects.exists()
    except (DatabaseError, InterfaceError) as error:
        log.warning("database_away", reason=str(error))
        return False
    return True


@never_cache
@require_safe
async def readyz(_request: HttpRequest) -> JsonResponse:
    database, manager = await database_sync_to_async(_database_and_managers)(timezone.now())
    broker = await bridge.current().wait_connected(PATIENCE_SECONDS)
    parts = {
        "database": database,
        "broker": WELL if broker else "away",
        "channel_layer": WELL if await page_channel.is_well() else SLOW,
        "session_manager": manager,
        "disk": (await disk.read())[0],
    }
    ready = all(word in {WELL, LOW, SLOW} for word in parts.values())
    if wrong := {part: word for part, word in parts.items() if word != WELL}:
        log.warning("not_ready", parts=wrong)
    answer = {"ready": ready, "version": __version__, **parts}
    return JsonResponse(answer, status=200 if ready else 503)


def _database_and_managers(now: datetime.datetime) -> tuple[str, str]:
    try:
        rows = list(ManagerBeat.objects.filter(name__startswith=NAME))
    except (DatabaseError, InterfaceError) as error:
        log.warning("database_away", reason=str(error))
        return "away", "unknown"
    return WELL, managers_state(rows, now)


def managers_state(rows: Sequence[ManagerBeat], now: datetime.datetime) -> str:
    """Return `ok`, or the worst fault of the session managers that send heartbeats; these serve the
    robots of a silent one.
    """
    states = {manager_state(row, now) for row in rows}
    order = ("without_broker", "behind", WELL, "silent", "none")
    return next((state for state in order if state in states), "none")


def manager_state(row: ManagerBeat | None, now: datetime.datetime) -> str:
    """Return `ok`, or a session manager's fault: `none`, `silent`, `without_broker`, `behind`."""
    if row is None or not row.holder:
        return "none"
    if (now - row.beat_at).total_seconds() > STALE_SECONDS:
        return "silent"
    if not row.report.get("connected"):
        return "without_broker"
    return "behind" if row.report.get("waiting", 0) > BEHIND else WELL
