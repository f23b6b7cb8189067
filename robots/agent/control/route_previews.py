"""Answers a driver who asks where a `goto` would lead.

Nothing moves and nothing is recorded. A refused or excessive question has no answer, and the page
asks again; of several that wait, the newest is answered.
"""

from collections.abc import Callable, Coroutine
from typing import Any

from robots.agent.control.supervised_adapter import AdapterLink
from robots.agent.robot_interface import AdapterError
from robots.agent.safety.permissions import CommandSender, forbidden, mismatch
from robots.agent.timing import TimeSource
from robots.api.bucket import Bucket
from robots.api.messages import Lease, RoutePreview, RouteRequest
from robots.process.logs import reason_of

RATE, BURST = 5.0, 5.0  # questions a second, and at once


class RoutePreviews:
    """Plans one route at a time; `send` takes a suffix and a message."""

    def __init__(
        self,
        adapter: AdapterLink,
        send: Callable[[str, RoutePreview], None],
        times: TimeSource,
        spawn: Callable[[Coroutine[Any, Any, None]], None],
    ) -> None:
        self._adapter, self._send, self._times, self._spawn = adapter, send, times, spawn
        self._bucket = Bucket(RATE, BURST)
        self._waiting: RouteRequest | None = None
        self._plans = False

    def take(self, request: RouteRequest, sender: CommandSender, lease: Lease | None) -> None:
        """Take a question of the driver whose lease is the live one."""
        if mismatch(request.session, request.epoch, sender, lease) is not None or lease is None:
            return
        if forbidden(lease, sender) or not self._bucket.spend(self._times.now()):
            return
        self._waiting = request
        if not self._plans:
            self._plans = True
            self._spawn(self._answer())

    async def _answer(self) -> None:
        try:
            while (request := self._waiting) is not None:
                self._waiting = None
                try:
                    points, reason = await self._adapter.preview(request.x, request.y)
                except AdapterError as error:
                    points, reason = (), reason_of(error)[:300]
                self._send(
                    "route",
                    RoutePreview(
                        stamp=self._times.unix(),
                        request_id=request.request_id,
                        points=points,
                        reason=reason,
                    ),
                )
        finally:
            self._plans = False
