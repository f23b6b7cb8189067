"""Keeps the robot stopped after a stop by someone other than the driver, until the driver releases
the controls; otherwise a key that is still held down would move the robot.

The kernel (kernel.py) has at most one hold, and ends it when one of these releases it:

- a zero velocity of the driver that the kernel accepts (`Kernel.velocity`);
- one second without another velocity, while heartbeats arrive on the transport of the driver's
  velocities (`take_heartbeat`). Without heartbeats, silence may be a network failure and does not
  count;
- the lease of another driver (`take_lease`). A lease that lapses does not release, because the same
  driver may get it back with the key still held down;
- a person, while there is no lease (`Kernel.clear_estop`).
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

    def take_lease(self, grant: LeaseGrant, *, is_new: bool) -> bool:
        """Note a new lease, and return whether it releases: it does for another driver than the
        stopped one. Without an earlier lease only an `is_new` one does, because one that was
        renewed may be of a driver who holds a key.
        """
        known, self.grant = self.grant, grant
        return is_new if known is None else known != grant

    def take_velocity(self, transport: Way, now: float) -> None:
        """Note a velocity of the driver other than zero, which need not be accepted."""
        self.transport, self.since = transport, now

    def take_heartbeat(self, transport: Way, now: float) -> bool:
        """Note a heartbeat of the driver, and return whether it releases: whether no velocity other
        than zero has come for QUIET_RELEASES. After a gap, that time begins again.
        """
        if self.transport not in {None, transport}:
            return False
        if now - self.last_received_at > HEARTBEAT_GAP:
            self.since = now
        self.last_received_at = now
        return now - self.since >= QUIET_RELEASES
