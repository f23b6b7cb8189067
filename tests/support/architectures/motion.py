"""How a simulated robot comes to rest after an event."""

import math
import threading
import time

from tests.support.patience import patient

REST = 1e-3  # m/s and rad/s: a robot at rest may still turn or roll so fast in a sample
STEP = 0.01  # s between two samples
STEADY = 20  # samples at rest, after which the robot counts as stopped


class Motion:
    """Samples in a thread, from now on, how far the robot of a world moves."""

    def __init__(self, world):
        self.world, self.began = world, time.monotonic()
        self._samples = []  # (seconds since the event, metres, moves)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self):
        last = self.world.truth
        while not self._over.wait(STEP):
            now, motion = self.world.truth, self.world.sim.motion
            moves = abs(motion.linear) > REST or abs(motion.angular) > REST
            self._samples.append((time.monotonic() - self.began, last.distance(now), moves))
            last = now

    def until_rest(self, seconds=0.0):
        """Sample for so many seconds more; return the metres and seconds until the robot was at
        rest (infinite if it never was), and the metres afterwards.
        """
        time.sleep(seconds)
        self._over.set()
        self._thread.join()
        still = (
            at
            for index, (at, _, _) in enumerate(self._samples)
            if not any(moves for *_, moves in self._samples[index : index + STEADY])
        )
        rest = next(still, math.inf)
        before = sum(metres for at, metres, _ in self._samples if at <= rest)
        return before, rest, sum(metres for at, metres, _ in self._samples if at > rest)


def assert_rest(label, found, within, *, later=0.03, said=""):
    """Print a row of the table, and assert that the robot came to rest in time and stayed there."""
    metres, seconds, afterwards = found
    print(
        f"\n{label:58} {metres:5.2f} m  at rest after {seconds:5.2f} s, then {afterwards:5.3f} m "
        f" {said}"
    )
    assert seconds <= patient(within)
    assert metres <= 0.55 * patient(within)
    assert afterwards <= later
