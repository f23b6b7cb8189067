"""Frames to send to one viewer: a short queue without gaps.

When the queue or the socket fills up, the queue is emptied and starts again with a key frame: late
frames are worthless to a driver, and a decoder that misses a delta frame shows garbage until the
next key frame.
"""

from collections import deque

from robots.agent.media.codecs.encoder import Picture

DEPTH = 3  # pictures, 100 ms at 30 Hz
# bytes in the socket's own buffer: 0.4 s at 1.2 Mbit/s; only a relay over TCP gets there
MAX_BACKLOG = 64 * 1024
_REMIND = 30  # pictures skipped before asking for a key frame again


class ViewerQueue:
    """Frames for one viewer, oldest first, from a key frame on, which the opener requests."""

    def __init__(self) -> None:
        self._pictures: deque[Picture] = deque()
        self._started = False
        self._skipped = 1  # frames before the first key frame ask for no second one
        self.restarts = 0

    def __len__(self) -> int:
        return len(self._pictures)

    def put(self, picture: Picture, backlog: int = 0) -> bool:
        """Queue a frame, given the socket's backlog; True when a key frame is needed."""
        if self._started and (len(self._pictures) >= DEPTH or backlog > MAX_BACKLOG):
            self._restart()
        if self._started or (picture.key and backlog <= MAX_BACKLOG):
            self._started, self._skipped = True, 0
            self._pictures.append(picture)
            return False
        self._skipped += 1
        return self._skipped % _REMIND == 1

    def take(self) -> Picture | None:
        """Remove and return the oldest picture, or None."""
        return self._pictures.popleft() if self._pictures else None

    def _restart(self) -> None:
        self._pictures.clear()
        self._started, self._skipped = False, 0
        self.restarts += 1
