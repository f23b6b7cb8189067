"""Draws frames into shared memory while there are viewers, in a thread: numpy releases the GIL."""

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import structlog

from robots.api.geometry import Pose2D
from robots.simulator.physics.drive import advance
from robots.simulator.physics.realtime import CameraView
from robots.simulator.render.frame_ring import FrameWriter

if TYPE_CHECKING:  # its import takes seconds: only processes with a camera pay for it
    from robots.simulator.render.camera import SceneCamera

LONGEST_FRAME = 0.5  # seconds
LONGEST_GUESS = 0.05  # seconds that a pose is carried on beyond the last step

log = structlog.stdlib.get_logger(__name__)


def pose_at(view: CameraView, stamp: float) -> Pose2D:
    """Return the pose a moment after a view: without it, frames judder with the steps."""
    return advance(view.pose, view.motion, min(max(stamp - view.stamp, 0.0), LONGEST_GUESS))


class CameraThread:
    """Draws while there are viewers; `make` builds the renderer in the thread, in a second.

    `ready` is called with each frame's number and capture stamp (Unix seconds).
    """

    def __init__(
        self,
        make: Callable[[], "SceneCamera"],
        ring: FrameWriter,
        fps: float,
        view: Callable[[], CameraView],
        ready: Callable[[int, float], None],
    ) -> None:
        self._make = make
        self._ring = ring
        self._period = 1.0 / fps
        self._view = view
        self._ready = ready
        self._watched = threading.Event()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def watch(self, *, watched: bool) -> None:
        if watched:
            self._watched.set()
        else:
            self._watched.clear()

    def close(self) -> None:
        """End the thread; waits for the current frame, not for the building of the scene."""
        self._ended.set()
        self._watched.set()
        self._thread.join(timeout=LONGEST_FRAME)

    def _run(self) -> None:
        begun = time.monotonic()
        renderer = self._make()
        log.info("camera_ready", seconds=round(time.monotonic() - begun, 3))
        due = time.monotonic()
        while self._watched.wait() and not self._ended.is_set():
            self._draw(renderer)
            due = max(due + self._period, time.monotonic() - self._period)
            self._ended.wait(max(0.0, due - time.monotonic()))

    def _draw(self, renderer: "SceneCamera") -> None:
        image = self._ring.begin()
        stamp = time.time()
        view = self._view()
        renderer.render(pose_at(view, stamp), view.tilt, view.doors, view.people, image)
        self._ready(self._ring.commit(), stamp)
