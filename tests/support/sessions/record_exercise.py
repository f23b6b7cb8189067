"""A recorder on the database of DATABASE_URL, told by its parent when to go on: `python -m
tests.support.sessions.record_exercise`.
"""

import json
import logging
import os
import sys
import time

import django

from tests.support import words

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "tests.settings")
django.setup()

from django.utils import timezone

from accounts.models import User
from robots.api import codec
from robots.models import Robot
from sessions.models import Session, StateChunk
from sessions.recording.items import StateItem
from sessions.recording.recorder import Recorder

NUL = b',"said":"a\\u0000b"}'
# Not UTF-8, inside a field that nobody knows and therefore nobody decodes.
BROKEN = b',"said":"\xff\xfe"}'


def item(session: Session, seq: int, tail: bytes = b"}") -> StateItem:
    state = words.state(seq, boot="b", session=str(session.pk), epoch=1)
    return StateItem("giraff", state, codec.encode(state)[:-1] + tail, time.time(), None)


def say(**words: object) -> None:
    print(json.dumps(words), flush=True)


def main() -> None:
    logging.disable(logging.CRITICAL)
    robot, visitors = (
        Robot.objects.create(name="giraff", title="g"),
        [User.objects.create(username=name) for name in ("ana", "ben")],
    )
    kept, deleted = (
        Session.objects.create(
            robot=robot, visitor=visitor, live_key=visitor.username, queued_at=timezone.now()
        )
        for visitor in visitors
    )
    recorder = Recorder(lambda *_: None)
    recorder.start()
    for seq in range(1, 101):
        recorder.put(item(kept, seq, NUL if seq % 10 == 0 else b"}"))
        recorder.put(item(deleted, seq + 1000))
    while StateChunk.objects.filter(session=kept).count() < 20:
        time.sleep(0.05)
    deleted.delete()
    say(at="half")
    sys.stdin.readline()  # the database is away from here on
    for seq in range(101, 201):
        recorder.put(item(kept, seq))
    recorder.put(item(kept, 204, BROKEN))
    say(at="away")
    sys.stdin.readline()  # and back
    stopped = recorder.stop(30)
    django.db.connection.close()
    states = [
        state
        for chunk in StateChunk.objects.filter(session=kept).order_by("first_seq")
        for state in chunk.states
    ]
    say(
        stopped=stopped,
        seqs=[state["seq"] for state in states],
        said=states[9]["said"],
        chunks=StateChunk.objects.count(),
        refused=recorder.counts["refused"],
    )


if __name__ == "__main__":
    main()
