"""How much a page may say: token buckets, pure, `now` in monotonic seconds."""

from robots.api.bucket import Bucket


class Allowance:
    """The buckets of one page.

    Driving sends 20 commands a second and a heartbeat five times, a stop is repeated 20 times a
    second, and a WebRTC offer is followed by a burst of candidates: the limits leave room for each.
    Dots on a shared picture are worth little and cost a way through the broker each, so they have
    the tightest, and as many as the robot takes. Stops have a bucket of their own, so that nothing
    else a page says can use it up. Photos are kept for good, half a megabyte each, so they have one
    too, and so has what the page says for the record: its network once a second, signs of the
    visitor as often while the server asks for one, and what changes, much of it at once when a
    drive begins. What is refused, for whatever reason, fills the measure of a flood.
    """

    def __init__(self) -> None:
        self._velocity = Bucket(rate=60.0, burst=60.0)
        self._stop = Bucket(rate=60.0, burst=60.0)
        self._other = Bucket(rate=30.0, burst=60.0)
        self._point = Bucket(rate=20.0, burst=10.0)
        self._photo = Bucket(rate=0.5, burst=10.0)
        self._report = Bucket(rate=3.0, burst=60.0)
        self._refusals = Bucket(rate=50.0, burst=500.0)

    def velocity(self, now: float) -> bool:
        """Tell whether one more velocity may pass."""
        return self._velocity.spend(now)

    def stop(self, now: float) -> bool:
        """Tell whether one more stop or e-stop may pass."""
        return self._stop.spend(now)

    def other(self, now: float) -> bool:
        """Tell whether one more frame of any other kind may pass."""
        return self._other.spend(now)

    def point(self, now: float) -> bool:
        """Tell whether one more dot may pass."""
        return self._point.spend(now)

    def photo(self, now: float) -> bool:
        """Tell whether one more photo may be asked for."""
        return self._photo.spend(now)

    def report(self, now: float) -> bool:
        """Tell whether one more word for the record may pass."""
        return self._report.spend(now)

    def floods(self, now: float) -> bool:
        """Count one refused frame, and tell whether there are so many that the
        connection must end.
        """
        return not self._refusals.spend(now)
