"""How soon a viewer gets a key frame after its queue was emptied."""

import asyncio
from types import SimpleNamespace

import pytest

from robots.agent.media.codecs.encoder import Picture
from robots.agent.media.webrtc import frame_queue as outbox
from robots.agent.media.webrtc.frame_queue import ONCE, FrameQueue
from robots.agent.media.webrtc.sender_queue import DEPTH


class Viewer:
    """A queue with the clock of the test; `asked` are the reasons for key frames."""

    def __init__(self) -> None:
        self.now, self.number, self.asked = 100.0, 0, []
        self.box = FrameQueue(self.asked.append, before=lambda _: None, delivered=lambda _: None)

    def put(self, *, key: bool = False) -> None:
        self.number += 1
        self.box.put(Picture((b"x",), key, self.number, float(self.number)))

    async def connect(self) -> "asyncio.Task[outbox.Outgoing]":
        first = asyncio.ensure_future(self.box.take())
        await asyncio.sleep(0)
        return first

    def hold_up(self) -> None:
        """Queue more pictures than fit before one is sent."""
        for number in range(DEPTH + 1):
            self.put(key=number == 0)


@pytest.fixture
def viewer(monkeypatch: pytest.MonkeyPatch) -> Viewer:
    made = Viewer()
    monkeypatch.setattr(outbox, "time", SimpleNamespace(monotonic=lambda: made.now))
    return made


async def test_hold_up_before_the_first_frame_gets_a_key_frame_at_once(viewer: Viewer) -> None:
    first = await viewer.connect()
    viewer.put()
    assert viewer.asked == ["joined"]
    viewer.hold_up()
    assert viewer.asked == ["joined", "joined"]
    viewer.put(key=True)
    assert (await first).timestamp == viewer.number


async def test_rare_hold_up_gets_a_key_frame_soon_a_constant_one_waits(viewer: Viewer) -> None:
    first = await viewer.connect()
    viewer.put(key=True)
    await first
    for _ in range(3):
        viewer.hold_up()
        viewer.now += 0.5 * ONCE
    viewer.now += ONCE
    viewer.hold_up()
    assert viewer.asked == ["joined", "lost", "behind", "behind", "lost"]
