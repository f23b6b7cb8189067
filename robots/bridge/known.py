"""What a web process knows of one robot, from the robot's own words: pure, `now` is monotonic
seconds.

Presence and permission are answered from here, so that no message waits for the database.
"""

import math
from dataclasses import dataclass
from typing import Any

from robots.api.messages import Connection, Factsheet, Lease, State

# seconds from the word that a robot has gone after which a heartbeat shows that it has not: the
# last ones of one that went may come after it
DOUBT_SECONDS = 3.0


def refutation(boot: str, gone_at: float | None, beat_at: float, stamp: float) -> Connection | None:
    """Return what a robot would say that is said to have gone (at `gone_at`, None when it is not)
    and whose heart beat at `beat_at`; None while that may be the last of one that went.

    A broker may deliver a will late, or again after what the robot has said since: NATS does, when
    a node was lost, or a connection before the will could be confirmed over it.
    """
    if gone_at is None or beat_at - gone_at < DOUBT_SECONDS:
        return None
    return Connection(boot=boot, state="ONLINE", stamp=stamp)


@dataclass
class KnownRobot:
    """Connection, factsheet, last state and lease of a robot, newest wins.

    `online_boot` is the boot of the last ONLINE. `lease` is the newest one, None when nobody
    drives, heard at `renewed_at`; `epoch`, `renewal` and `stamp` are the newest seen and outlive
    it, so that a late copy of an older lease does not come back. `last_received_at` is when the
    robot itself last said anything, `needed_since` when this process began to ask for its full
    rate; before that its silence means nothing. `gone_at` is when it was said to have gone, None
    while it is there.
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
    gone_at: float | None = None

    @property
    def online(self) -> bool | None:
        """Tell whether the robot says that it is connected; None before it has said anything."""
        return None if self.connection is None else self.connection.state == "ONLINE"

    def is_silent(self, now: float, seconds: float) -> bool:
        """Tell whether a robot that is connected and needed has said nothing for so long."""
        return bool(self.online) and now - max(self.last_received_at, self.needed_since) >= seconds

    def take(self, suffix: str, message: Any, now: float) -> bool:
        """Note what the robot or a server said; False when it was out of date and must not be
        passed on.
        """
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
            self.online_boot, self.gone_at = connection.boot, None
        elif self.online_boot and connection.boot != self.online_boot:
            # The will of a half-open connection, seconds after the next one is up.
            return False
        else:
            self.gone_at = now
        self.connection = connection
        return True

    def refutation(self, now: float, stamp: float) -> Connection | None:
        """Return what the robot would say whose heart beats now, when it is said to have gone;
        `stamp` is of the heartbeat.
        """
        if self.connection is None:
            return None
        return refutation(self.connection.boot, self.gone_at, now, stamp)

    def take_lease(self, lease: Lease | None, now: float, *, certain: bool = False) -> bool:
        """Note a lease or, with None, that nobody drives; False for a copy that is older than what
        is known.

        `certain`: it comes from the database and not over the broker, where copies overtake each
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
        # A lower epoch with a newer stamp, when nobody drives: the server's counter began anew.
        return (
            lease.epoch >= self.epoch or self.lease_at(now) is not None or lease.stamp <= self.stamp
        )

    def lease_at(self, now: float) -> Lease | None:
        """Return the lease while it is being renewed; a stored copy of a dead one counts for its
        ttl at most.
        """
        return (
            self.lease
            if self.lease is not None and now - self.renewed_at < self.lease.ttl
            else None
        )
