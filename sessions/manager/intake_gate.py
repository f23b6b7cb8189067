"""Selects the messages that a session manager processes: those of its own robots."""

from collections.abc import Callable

import aiomqtt

from robots.api import topics
from sessions.manager.ingest import Intake
from sessions.shards.foreign_messages import ForeignMessages
from sessions.shards.ownership import Ownership, ShardChanges


class IntakeGate:
    """Passes the messages of this process's robots on to its Intake, and keeps those of others for
    a while in case the robots become ours.
    """

    def __init__(self, intake: Intake, ownership: Ownership, clock: Callable[[], float]) -> None:
        self._intake, self._ownership, self._clock = intake, ownership, clock
        self._changes = ShardChanges(ownership)
        self._foreign: ForeignMessages[tuple[aiomqtt.Message, float]] = ForeignMessages(ownership)

    def receive(self, message: aiomqtt.Message) -> None:
        """Take a message of the broker."""
        topic = str(message.topic)
        is_whole = self._ownership.is_whole or topic.startswith(f"{topics.SERVER}/")
        parsed = None if is_whole else topics.parse(topic)
        if parsed is None or self._ownership.owns(parsed[0]):
            self._intake.receive(message)
        else:
            now = self._clock()
            self._foreign.keep(parsed[0], (message, now), now, len(bytes(message.payload or b"")))

    def follow(self) -> None:
        """Forget robots that were ours, and take kept messages of those that have become ours."""
        if self._changes:
            _, lost = self._changes.take(list(self._intake.liveness))
            for robot in lost:
                del self._intake.liveness[robot]
        for message, received_at in self._foreign.claim(self._clock()):
            self._intake.receive(message, received_at)
