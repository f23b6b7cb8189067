"""The robot's last pose in a file, so that the next agent need not search the whole map for it.

The robot may have been moved since, so the pose is only a first guess, which the laser must
confirm. A file that cannot be read or written counts as missing.
"""

import asyncio
import contextlib
import json
import math
from pathlib import Path

import structlog

from robots.agent.timing import Cadence
from robots.api.geometry import Pose2D

PERIOD = 5.0  # seconds between two writes
READING_TIME = 1.0  # seconds that a connection waits for the disk
MOVED = 0.1  # metres, or radians, beyond which a pose is written

log = structlog.stdlib.get_logger(__name__)


class PoseMemory:
    """One file, replaced whole. `path` None remembers nothing."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._due = Cadence(PERIOD)
        self._kept: tuple[str, Pose2D] | None = None
        self._was_read = False
        self._writing: asyncio.Task[None] | None = None

    async def read(self) -> None:
        """Read the file once, in a thread, for a second at most: a disk may hang."""
        if self._path is not None and not self._was_read:
            self._was_read = True
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(READING_TIME):
                    self._kept = await asyncio.to_thread(_pose_in, self._path)

    def recall(self, map_id: str) -> Pose2D | None:
        """Return the last known pose of the robot in this map, None when unknown."""
        return self._kept[1] if self._kept is not None and self._kept[0] == map_id else None

    def note(self, map_id: str, pose: Pose2D, now: float) -> None:
        """Write a pose at most every 5 s, in a thread."""
        if self._path is None or self._writing is not None or not self._due.due(now):
            return
        if self._kept is not None and self._kept[0] == map_id:
            step = self._kept[1].inverse().compose(pose)
            if math.hypot(step.x, step.y) <= MOVED and abs(step.theta) <= MOVED:
                return
        self._kept = map_id, pose
        self._writing = asyncio.get_running_loop().create_task(
            asyncio.to_thread(self._write, map_id, pose)
        )
        self._writing.add_done_callback(self._written)

    async def close(self, map_id: str, pose: Pose2D | None) -> None:
        """Write the last pose, if it is known."""
        if self._writing is not None:
            await self._writing
        if self._path is not None and pose is not None:
            await asyncio.to_thread(self._write, map_id, pose)

    def _written(self, _: "asyncio.Task[None]") -> None:
        self._writing = None

    def _write(self, map_id: str, pose: Pose2D) -> None:
        assert self._path is not None
        unfinished = self._path.with_suffix(".new")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            content = json.dumps({"map_id": map_id, **pose._asdict()})
            unfinished.write_text(content, encoding="utf-8")
            unfinished.replace(self._path)
        except OSError as error:
            log.warning("pose_not_kept", reason=str(error))


def _pose_in(path: Path) -> tuple[str, Pose2D] | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        pose = Pose2D(*(float(content[name]) for name in ("x", "y", "theta")))
        return (str(content["map_id"]), pose) if all(map(math.isfinite, pose)) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
