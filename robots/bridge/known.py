"""A web process's copy of a robot's last messages: pure; `now` is monotonic seconds.

Presence and permission are decided by it, so that no message waits for the database.
"""

import math
from dataclasses import dataclass
from typing import Any

from robots.api.messages import Connection, Factsheet, Lease, State

# A heartbeat that arrives this long after an OFFLINE shows that the robot is online; an earlier one
# may have been sent before.
DOUBT_SECONDS = 3.0


def refutation(
    boot: str, offline_at: float | None, beat_at: float, stamp: float
) -> Connection | None:
    """Return an ONLINE for a robot that was reported offline at `offline_at` (None: it was not) and
    sent a heartbeat at `beat_at`; None while that may have been its last one.

    A broker may deliver a will late, or again after newer messages of the robot: NATS does, when a
    node was lost, or a connection before the will could be confirmed over it.
    """
    if offline_at is None or beat_at - offline_at < DOUBT_SECONDS:
        return None
    return Connection(boot=boot, state="ONLINE", stamp=stamp)


@dataclass
class KnownRobot:
    """Newest connection, factsheet, state and lease of a robot.

    `online_boot` is the boot of the last ONLINE. `lease` is None without a driver, and was received
    at `renewed_at`; `epoch`, `renewal` and `stamp` are the newest seen and outlive it, so that a
    late copy of an older lease is ignored. `last_received_at` is when the robot itself last sent a
    message, `needed_since` when this process began to request its full rate; before that, silence
    means nothing. `offline_at` is when OFFLINE was received, None while the robot is online.
    """

    name: str
    connection: Connection | None = None
    online_boot: str = ""
    factsheet: Factsheet | None = None
    state: State | None = None
    lease: Lease | None = None
    epoch: int = -1
    renewal: int = -1
    stamp: float = -1.0
    renewed_at: float = -1e18
    last_received_at: float = -1e18
    needed_since: float = math.inf
    offline_at: float | None = None

    @property
    def online(self) -> bool | None:
        """Tell whether the robot is connected; None before its first message about it."""
        return None if self.connection is None else self.connection.state == "ONLINE"

    def is_silent(self, now: float, seconds: float) -> bool:
        """Tell whether a robot that is connected and needed has sent nothing for `seconds`."""
        return bool(self.online) and now - max(self.last_received_at, self.needed_since) >= seconds

    def take(self, suffix: str, message: Any, now: float) -> bool:
        """Note a message; False when it is out of date, and must not be passed on."""
        if suffix != "lease":
            self.last_received_at = now
        match message:
            case Connection():
                return self._take_connection(message, now)
            case Factsheet():
                self.factsheet = message
            case State():
                self.state = message
            case Lease() | None if suffix == "lease":
                return self.take_lease(message, now)
        return True

    def _take_connection(self, connection: Connection, now: float) -> bool:
        if connection.state == "ONLINE":
            self.online_boot, self.offline_at = connection.boot, None
        elif self.online_boot and connection.boot != self.online_boot:
            # The will of a half-open connection, which may follow its successor by seconds.
            return False
        else:
            self.offline_at = now
        self.connection = connection
        return True

    def refutation(self, now: float, stamp: float) -> Connection | None:
        """Return an ONLINE if the robot was reported offline and sends a heartbeat now."""
        if self.connection is None:
            return None
        return refutation(self.connection.boot, self.offline_at, now, stamp)

    def take_lease(self, lease: Lease | None, now: float, *, certain: bool = False) -> bool:
        """Note a lease, or with None that there is no driver; False for a copy that is older than
        the known one.

        `certain`: it is from the database and not from the broker, where copies overtake each
        other.
        """
        if lease is not None and not certain and self._is_late(lease, now):
            return False
        if lease is not None:
            self.epoch, self.renewal = lease.epoch, lease.renewal
            self.stamp, self.renewed_at = lease.stamp, now
        self.lease = lease
        return True

    def _is_late(self, lease: Lease, now: float) -> bool:
        if (lease.epoch, lease.renewal) >= (self.epoch, self.renewal):
            return False
        # A lower epoch with a newer stamp, without a driver: the server's counter has restarted.
        return (
            lease.epoch >= self.epoch or self.lease_at(now) is not None or lease.stamp <= self.stamp
        )

    def lease_at(self, now: float) -> Lease | None:
        """Return the lease while it is renewed; a retained copy counts for its ttl at most."""
        if self.lease is None or now - self.renewed_at >= self.lease.ttl:
            return None
        return self.lease
