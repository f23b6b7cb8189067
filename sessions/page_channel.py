"""Messages of Django code, in any web process, to open pages through the channel layer.

A page is in the group of its robot and in that of its visitor. It receives requests to check
whether it may stay, and notices of its session. Messages of robots and of the session manager take
the broker instead. If the layer loses a message, because Redis is away or the sender is a process
without it, the page's own check of the database has the same effect within a minute.
"""

import asyncio
from collections.abc import Callable, Collection
from typing import Any

import structlog
from asgiref.sync import async_to_sync
from channels.layers import get_channel_layer
from django.db import transaction

from sessions import protocol

try:
    from redis.exceptions import RedisError
except ImportError:  # an extra
    LAYER_ERRORS: tuple[type[Exception], ...] = (OSError, TimeoutError)
else:
    LAYER_ERRORS = (OSError, TimeoutError, RedisError)

log = structlog.stdlib.get_logger(__name__)

PATIENCE_SECONDS = 1.0
RETRY_SECONDS = 5.0
CHECK, NOTICE, WORDS = "check", "notice", "words"
_sending: set[asyncio.Future[bool]] = set()
Event = dict[str, Any]


def robot_group(name: str) -> str:
    """Return the group of a robot's pages."""
    return f"robot.{name}"


def screen_group(name: str) -> str:
    """Return the group of a robot's own displays."""
    return f"screen.{name}"


def visitor_group(user: Any) -> str:
    """Return the group of a visitor's pages, by the user's key."""
    return f"visitor.{user}"


def check_pages(group: str, *, session: str | None = None) -> None:
    """Have pages check whether they may stay, and the state of their session, as soon as the
    present transaction is committed; only the page of `session` when that is given.
    """
    hooks = (hook for _, hook, _ in transaction.get_connection().run_on_commit)
    checks = next((hook for hook in hooks if isinstance(hook, _Checks)), None)
    if checks is not None:
        checks.wanted.add((group, session))
    else:
        transaction.on_commit(_Checks({(group, session)}))


class _Checks:
    """The checks that a transaction asks for, sent together after its commit. A rollback to a
    savepoint drops them as Django drops other hooks, or sends some that change nothing.
    """

    def __init__(self, wanted: set[tuple[str, str | None]]) -> None:
        self.wanted = wanted

    def __call__(self) -> None:
        events = [(group, {"type": CHECK, "session": session}) for group, session in self.wanted]
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            async_to_sync(_tell_each)(events)
        else:  # as in a notebook, whose thread may not wait for its own event loop
            sending = asyncio.ensure_future(_tell_each(events))
            _sending.add(sending)
            sending.add_done_callback(_sending.discard)


def send_notice(robot: str, notice: protocol.Notice) -> bool:
    """Send a notice to the page of its session; False when the layer is away."""
    frame = protocol.notice_frame(notice)
    event = {"type": NOTICE, "session": notice.session, "frame": frame}
    return async_to_sync(tell)(robot_group(robot), event)


async def send_words(robot: str, session: str, frame: str) -> None:
    """Send a chat message of a waiting session to its page and to the robot's displays."""
    event = {"type": WORDS, "session": session, "frame": frame}
    for group in (robot_group(robot), screen_group(robot)):
        await tell(group, event)


async def tell(group: str, event: Event) -> bool:
    """Send an event to a group; False when the layer is away."""
    return await _tell_each([(group, event)])


async def _tell_each(events: Collection[tuple[str, Event]]) -> bool:
    """Send each event to its group, all of them at once and within PATIENCE_SECONDS; False when the
    layer is away for any, which does not keep the others back.
    """
    sendings = (get_channel_layer().group_send(group, event) for group, event in events)
    try:
        async with asyncio.timeout(PATIENCE_SECONDS):
            for error in await asyncio.gather(*sendings, return_exceptions=True):
                if error is not None:
                    raise error
    except LAYER_ERRORS as error:
        groups = sorted({group for group, _ in events})
        log.warning("channel_layer_away", groups=groups, reason=type(error).__name__)
        return False
    return True


async def listen(groups: tuple[str, ...], handle: Callable[[Event], None]) -> None:
    """Pass every event of these groups to `handle`; retry while the layer is away."""
    layer = get_channel_layer()
    while True:
        channel = ""
        try:
            channel = await layer.new_channel()
            for group in groups:
                await layer.group_add(group, channel)
            while True:
                _hand(handle, await layer.receive(channel))
        except LAYER_ERRORS as error:
            log.warning("channel_layer_away", reason=type(error).__name__)
        finally:
            if channel:
                await _leave(groups, channel)
        await asyncio.sleep(RETRY_SECONDS)


def _hand(handle: Callable[[Event], None], event: Event) -> None:
    try:
        handle(event)
    except Exception:  # the page must receive later events
        log.exception("event_failed", kind=event.get("type"))


async def _leave(groups: tuple[str, ...], channel: str) -> None:
    try:
        for group in groups:
            await get_channel_layer().group_discard(group, channel)
    except LAYER_ERRORS:
        return  # it has forgotten the channel already


async def is_well() -> bool:
    """Tell whether an event of a group arrives."""
    arrived = asyncio.Event()
    group = f"probe.{id(arrived)}"
    listening = asyncio.create_task(listen((group,), lambda _event: arrived.set()))
    try:
        async with asyncio.timeout(PATIENCE_SECONDS):
            while not arrived.is_set():  # until the listener is there
                if not await tell(group, {"type": CHECK}):
                    return False
                await asyncio.sleep(0.01)
    except TimeoutError:
        return False
    finally:
        listening.cancel()
        # it leaves its group, for which a layer that is away may keep it waiting
        await asyncio.wait({listening}, timeout=PATIENCE_SECONDS)
    return True
