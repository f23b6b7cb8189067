"""Keeps the robot stopped after a stop by someone other than the driver, until the driver releases
the controls; otherwise a key that is still held down would move the robot.

The driver releases by sending a zero velocity, or by sending no other velocity for one second while
heartbeats still arrive on the transport of the driver's velocities. Without heartbeats, silence may
be a network failure and does not count. The lease of another driver releases, too; a lease that
lapses does not, because the same driver may get it back with the key still held down.
"""

from dataclasses import dataclass, field

from robots.api.messages import Way

LeaseGrant = tuple[str | int, ...]  # what tells one driver's lease from the next one's
QUIET_RELEASES = 1.0  # s without a velocity other than zero
# s between two heartbeats, which come five times a second, from which something may have been lost
HEARTBEAT_GAP = 0.5


@dataclass
class DriveHold:
    """One stop that waits for its release. Times are monotonic, in seconds.

    `grant` is that of its lease, None without one; `transport` that of the driver's velocities.
    A stop `by_person` also holds without a lease: the robot then waits for a new driver, or for a
    person who releases it.
    """

    grant: LeaseGrant | None
    transport: Way | None
    since: float
    by_person: bool = False
    last_received_at: float = field(init=False)

    def __post_init__(self) -> None:
        self.last_received_at = self.since

    def is_released_with(self, grant: LeaseGrant, *, is_new: bool) -> bool:
        """Take a new lease and tell whether it releases: it does for another driver than the
        stopped one. Without an earlier lease only an `is_new` one does, because one that was
        renewed may be of a driver who holds a key.
        """
        known, self.grant = self.grant, grant
        return is_new if known is None else known != grant

    def pressed(self, transport: Way, now: float) -> None:
        """Take a velocity of the driver other than zero."""
        self.transport, self.since = transport, now

    def is_released_by(self, transport: Way, now: float) -> bool:
        """Take a heartbeat of the driver, and tell whether it ends a long enough silence."""
        if self.transport not in {None, transport}:
            return False
        if now - self.last_received_at > HEARTBEAT_GAP:
            self.since = now
        self.last_received_at = now
        return now - self.since >= QUIET_RELEASES
