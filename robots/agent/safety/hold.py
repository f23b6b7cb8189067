"""After somebody else's stop the robot stays stopped until its driver has let go, lest a held key
moves it by surprise.

Letting go is a zero velocity of that driver, the end of that driver's lease, or a second without a
velocity other than zero. That second counts only while the driver's heartbeats arrive on the
transport of the driver's velocities: silence of a network is nobody's decision.
"""

from dataclasses import dataclass, field

from robots.api.messages import Way

LeaseGrant = tuple[str | int, ...]  # what tells one driver's lease from the next one's
QUIET_RELEASES = 1.0  # s without a velocity other than zero
# s between two heartbeats, which come five times a second, from which something may have been lost
HEARTBEAT_GAP = 0.5


@dataclass
class DriveHold:
    """One stop that waits. `grant` is that of the lease under which it came, `way`
    the transport of the driver's velocities.

    All times are monotonic, in seconds.
    """

    grant: LeaseGrant | None
    way: Way | None
    since: float
    last_received_at: float = field(init=False)

    def __post_init__(self) -> None:
        self.last_received_at = self.since

    def is_released_with(self, grant: LeaseGrant | None) -> bool:
        """Take a newly granted lease, and tell whether it is that of another driver: then nobody
        holds a key any more.
        """
        known, self.grant = self.grant, grant
        return known is not None and known != grant

    def is_nobodys(self, now: float) -> bool:
        """Tell whether it is over for want of a lease: without one nobody drives,
        whatever is held.
        """
        return now - self.since >= QUIET_RELEASES

    def pressed(self, way: Way, now: float) -> None:
        """The driver has sent a velocity other than zero."""
        self.way, self.since = way, now

    def is_released_by(self, way: Way, now: float) -> bool:
        """Take a heartbeat of the driver, and tell whether it ends a silence that
        was long enough.
        """
        if self.way not in {None, way}:
            return False
        if now - self.last_received_at > HEARTBEAT_GAP:
            self.since = now
        self.last_received_at = now
        return now - self.since >= QUIET_RELEASES
