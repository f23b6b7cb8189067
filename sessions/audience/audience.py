"""The audience of one robot's drives in one web process: notifies its pages of changes of the
board, and the other web processes through the channel layer.
"""

import asyncio
import contextlib
import secrets
import time
from typing import Protocol

import msgspec
import structlog
from channels.db import database_sync_to_async
from django.db import DatabaseError, InterfaceError

from robots.bridge.bridge import Bridge
from robots.bridge.delivery import ReceivedMessage
from sessions import page_channel
from sessions.audience.board import Asked, Board, BoardUpdate, RaisedHand, sanitize
from sessions.leases import store
from sessions.protocol import AskQuestion, LowerHands, MarkQuestion, RaiseHand, ToAudience

log = structlog.stdlib.get_logger(__name__)

BOARD = "board"
BEAT_SECONDS = 5.0
PAUSE_SECONDS = 0.5  # between two updates of pages and processes: many hands go up at once
LINGER_SECONDS = 60.0  # without a page, for pages that reconnect
_decoder = msgspec.json.Decoder(BoardUpdate)


class AudienceMember(Protocol):
    """A page that is notified of the audience."""

    def audience_changed(self) -> None:
        """Handle a change of the board."""


class Audience:
    """Lives on the loop of the process's pages, and LINGER_SECONDS longer."""

    def __init__(self, robot: str, bridge: Bridge) -> None:
        self._robot, self._bridge = robot, bridge
        self.board = Board(secrets.token_hex(8))
        self._group = f"audience.{robot}"
        self._members: set[AudienceMember] = set()
        self._begun: str | None = None  # the session of the board, which is closed in a study
        self._left_at = time.monotonic()
        self._changed = asyncio.Event()
        self._known = bridge.listen(robot, self, needs=False)
        self._hearing = asyncio.ensure_future(page_channel.listen((self._group,), self._hear))
        self._running = asyncio.ensure_future(self._run())
        self._running.add_done_callback(self._ended)

    def join(self, member: AudienceMember) -> None:
        """Add a page."""
        self._members.add(member)
        self._changed.set()

    def part(self, member: AudienceMember) -> None:
        """Remove a page, and take down its hand."""
        self._members.discard(member)
        self._left_at = time.monotonic()
        self.leave(member)

    def leave(self, member: AudienceMember) -> None:
        """Take down the hand of a page that stops watching."""
        before = self.board.version
        self.board.leave(member)
        self._note(before)

    def take(self, message: ToAudience, member: AudienceMember, user: str, who: str) -> str:
        """Carry out a permitted request of a page; return why it is refused, or nothing."""
        before, key, now = self.board.version, secrets.token_hex(8), time.time()
        match message:
            case RaiseHand(raised=True):
                reason = self.board.raise_hand(member, RaisedHand(key, user, who, now))
            case RaiseHand():
                reason = self.board.lower_hand(user)
            case AskQuestion(text=text):
                reason = self.board.ask(Asked(key, user, who, sanitize(text), now))
            case MarkQuestion(question=question, state=state):
                reason = self.board.mark(question, state)
            case LowerHands():
                reason = self.board.lower_all()
        self._note(before)
        return reason

    def handle_message(self, inbound: ReceivedMessage) -> None:
        """Begin a new board when the session changes."""
        if inbound.suffix == "lease" and self._session() != self._begun:
            self._changed.set()

    def _session(self) -> str | None:
        lease = self._known.lease
        return lease.session if lease is not None and lease.kind == "visitor" else None

    def _note(self, before: int) -> None:
        if self.board.version != before:
            self._changed.set()

    def _hear(self, event: page_channel.Event) -> None:
        before = self.board.version
        try:
            behind = self.board.merge(_decoder.decode(event["frame"]), time.monotonic())
        except msgspec.DecodeError as error:  # of a web process of another version
            log.warning("board_rejected", robot=self._robot, reason=str(error))
            return
        if behind or self.board.version != before:
            self._changed.set()

    # --- regular work -----------------------------------------------------------------------------

    async def _run(self) -> None:
        try:
            while self._members or self._lingers():
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(BEAT_SECONDS):
                        await self._changed.wait()
                self._changed.clear()
                await self._notify()
                await asyncio.sleep(PAUSE_SECONDS)
        finally:
            del _audiences[self._robot]
            self._hearing.cancel()
            self._bridge.ignore(self._robot, self)

    async def _notify(self) -> None:
        try:
            await self._begin()
        except (DatabaseError, InterfaceError) as error:
            log.warning("audience_closed", robot=self._robot, reason=str(error))
        self.board.expire(time.monotonic())
        for member in tuple(self._members):
            member.audience_changed()
        update = self.board.update()
        if update is not None:
            frame = msgspec.json.encode(update).decode()
            await page_channel.tell(self._group, {"type": BOARD, "frame": frame})

    def _lingers(self) -> bool:
        since = time.monotonic() - self._left_at
        return self._changed.is_set() or (self._session() is not None and since < LINGER_SECONDS)

    async def _begin(self) -> None:
        """Begin a new board with every session; in a study it stays closed."""
        session = self._session()
        if session == self._begun:
            return
        self._begun = None
        self.board.begin(None)
        study = session is not None and await database_sync_to_async(store.is_study)(session)
        self._begun = session
        self.board.begin(None if study else session)

    def _ended(self, task: asyncio.Task[None]) -> None:
        """Log an error of ours."""
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("audience_failed", robot=self._robot, exc_info=error)


_audiences: dict[str, Audience] = {}


def audience_of(robot: str, bridge: Bridge) -> Audience:
    """Return the audience of a robot in this process."""
    found = _audiences.get(robot)
    if found is None:
        found = _audiences[robot] = Audience(robot, bridge)
    return found
