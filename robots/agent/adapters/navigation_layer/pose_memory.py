"""Where the robot stood when the agent ended, so that the next one need not look for it on the
whole map.

Somebody may have moved it meanwhile: what is remembered is a beginning, which the laser confirms or
not. A memory that cannot be read or written is none.
"""

import asyncio
import json
import math
from pathlib import Path

import structlog

from robots.agent.timing import Cadence
from robots.api.geometry import Pose2D

PERIOD = 5.0  # seconds between two writes
MOVED = 0.1  # metres, or radians, less than which are not worth one

log = structlog.stdlib.get_logger(__name__)


class PoseMemory:
    """One file, replaced whole. `path` None remembers nothing."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._due = Cadence(PERIOD)
        self._kept: tuple[str, Pose2D] | None = None
        self._writing: asyncio.Task[None] | None = None

    def recall(self, map_id: str) -> Pose2D | None:
        """Return where the robot stood last in this map, None when unknown. Blocks for a disk."""
        try:
            content = json.loads(self._path.read_text(encoding="utf-8")) if self._path else None
            pose = (
                Pose2D(*(float(content[name]) for name in ("x", "y", "theta")))
                if content and content["map_id"] == map_id
                else None
            )
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return pose if pose is not None and all(map(math.isfinite, pose)) else None

    def note(self, map_id: str, pose: Pose2D, now: float) -> None:
        """Remember a pose, now and then and beside the loop."""
        if (
            self._path is None
            or self._writing is not None
            or not self._due.due(now)
            or not self._is_news(map_id, pose)
        ):
            return
        self._kept = map_id, pose
        self._writing = asyncio.get_running_loop().create_task(
            asyncio.to_thread(self._write, map_id, pose)
        )
        self._writing.add_done_callback(self._written)

    async def close(self, map_id: str, pose: Pose2D | None) -> None:
        """Remember the last pose, when it is known."""
        if self._writing is not None:
            await self._writing
        if self._path is not None and pose is not None:
            await asyncio.to_thread(self._write, map_id, pose)

    def _is_news(self, map_id: str, pose: Pose2D) -> bool:
        if self._kept is None or self._kept[0] != map_id:
            return True
        step = self._kept[1].inverse().compose(pose)
        return math.hypot(step.x, step.y) > MOVED or abs(step.theta) > MOVED

    def _written(self, _: "asyncio.Task[None]") -> None:
        self._writing = None

    def _write(self, map_id: str, pose: Pose2D) -> None:
        assert self._path is not None
        unfinished = self._path.with_suffix(".new")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            unfinished.write_text(
                json.dumps({"map_id": map_id, **pose._asdict()}), encoding="utf-8"
            )
            unfinished.replace(self._path)
        except OSError as error:
            log.warning("pose_not_kept", reason=str(error))
