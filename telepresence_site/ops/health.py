"""Whether this web process can do its work now, and with it the parts that it cannot do without.

`/healthz` says that the process reaches database and broker (a supervisor restarts what does not).
`/readyz` says whether visitors should be sent here, and looks at everything: 200, or 503 with a
word for every part; of the disk also while there is still room. Neither says anything that is not
everybody's business.
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

log = structlog.stdlib.get_logger(__name__)
PATIENCE_SECONDS = 1.0
# A disk that is nearly full is told in time, and turns nobody away; nor does a channel layer that
# is away: pages only hear later of what staff do (sessions/page_channel.py).
WELL, LOW, SLOW, SILENT = "ok", "low", "slow", "silent"
BEHIND = LIMIT // 4  # items that wait for the database; a busy site has a few hundred


class DiskReader:
    """Reads how much room the disk has, in a thread: a disk that dies may never answer. Until it
    does, it holds that one thread and nothing else.
    """

    def __init__(self) -> None:
        self._reading: asyncio.Future[int] | None = None

    async def read(self) -> tuple[str, int | None]:
        """Return how the disk is in a word, and its free bytes; None of a `silent` one."""
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
    """Tell a supervisor whether this process reaches the database and the broker: 200, or 503 with
    what is missing.

    The state of the disk is reported as well, but never as 503: no restart makes room.
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
    """Answer with a word for every part."""
    database, manager = await database_sync_to_async(_of_the_database)(timezone.now())
    broker = await bridge.current().wait_connected(PATIENCE_SECONDS)
    parts = {
        "database": database,
        "broker": WELL if broker else "away",
        "channel_layer": WELL if await page_channel.is_well() else SLOW,
        "session_manager": manager,
        "disk": (await disk.read())[0],
    }
    ready = all(word in {WELL, LOW, SLOW} for word in parts.values())
    if any(word != WELL for word in parts.values()):
        log.warning("not_ready", parts={part: word for part, word in parts.items() if word != WELL})
    return JsonResponse({"ready": ready, **parts}, status=200 if ready else 503)


def _of_the_database(now: datetime.datetime) -> tuple[str, str]:
    try:
        rows = list(ManagerBeat.objects.filter(name__startswith=NAME))
    except (DatabaseError, InterfaceError) as error:
        log.warning("database_away", reason=str(error))
        return "away", "unknown"
    return WELL, managers_state(rows, now)


def managers_state(rows: Sequence[ManagerBeat], now: datetime.datetime) -> str:
    """Return `ok`, or the worst of what is wrong with the session managers that beat: the others
    serve the robots of one that does not.
    """
    states = {manager_state(row, now) for row in rows}
    order = ("without_broker", "behind", WELL, "silent", "none")
    return next((state for state in order if state in states), "none")


def manager_state(row: ManagerBeat | None, now: datetime.datetime) -> str:
    """Return `ok`, or what is wrong with one session manager: `none`, `silent`, `without_broker` or
    `behind`.
    """
    if row is None or not row.holder:
        return "none"
    if (now - row.beat_at).total_seconds() > STALE_SECONDS:
        return "silent"
    if not row.report.get("connected"):
        return "without_broker"
    return "behind" if row.report.get("waiting", 0) > BEHIND else WELL
