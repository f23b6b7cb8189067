"""The offset of a robot's clock from ours, from the heartbeats that it echoes (RFC 5905, 8).

The offset of the exchange with the least round trip among the last ones is the best estimate:
whatever delays a message makes the round trip longer, and only an uneven delay makes the offset
wrong, by at most half of the excess.
"""

from collections import deque

from robots.api.messages import Heartbeat

EXCHANGES = 10


class ClockOffset:
    """The estimate for one run of a robot's agent. All stamps in Unix seconds."""

    def __init__(self, peer: str) -> None:
        self._peer = peer
        # (round trip, offset)
        self._exchanges: deque[tuple[float, float]] = deque(maxlen=EXCHANGES)
        # The last echo; compared by equality, because a restarted server counts from 0 again.
        self._newest = -1

    def on_heartbeat(self, beat: Heartbeat, received: float) -> bool:
        """Take a heartbeat that arrived at `received`; False when it has no new echo."""
        is_new = False
        for echo in beat.echoes:
            if echo.peer == self._peer and echo.n != self._newest:
                self._newest, is_new = echo.n, True
                round_trip = (received - echo.stamp) - (beat.stamp - echo.received)
                offset = ((echo.received - echo.stamp) + (beat.stamp - received)) / 2.0
                if round_trip >= 0.0:
                    self._exchanges.append((round_trip, offset))
        return is_new

    @property
    def seconds(self) -> float | None:
        """Robot's clock minus ours; None before the first echo."""
        return min(self._exchanges)[1] if self._exchanges else None

    @property
    def round_trip(self) -> float | None:
        """The round trip of the exchange that `seconds` is from."""
        return min(self._exchanges)[0] if self._exchanges else None
