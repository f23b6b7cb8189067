"""A source that starts slowly, stalls, fails and recovers: its time limits and reported states."""

import time
from typing import Self

from robots.agent.media.capture.capture import Capture, CaptureLimits, CaptureState
from robots.agent.robot_interface import AdapterError
from tests.support.agents.simulators import eventually

QUICK = CaptureLimits(
    opening=60.0, stall=0.2, linger=0.0, read=0.02, first_retry=0.02, last_retry=0.02
)


class Scripted:
    """A source that sends while `gives`, and cannot be started with the reason `broken`."""

    def __init__(self, limits: CaptureLimits = QUICK) -> None:
        self.gives, self.broken = False, ""
        self.starts = self.reads = 0
        self.capture = Capture("camera", self, lambda: None, self._step, limits)

    def start(self) -> None:
        self.starts += 1
        if self.broken:
            raise AdapterError(self.broken)

    def stop(self) -> None:
        """Nothing to release."""

    def _step(self, timeout: float) -> bool:
        self.reads += 1
        time.sleep(timeout)
        return self.gives

    def __enter__(self) -> Self:
        self.capture.start()
        self.capture.want(1)
        return self

    def __exit__(self, *_raised: object) -> None:
        self.capture.close()


def test_source_may_start_more_slowly_than_it_may_stall():
    with Scripted() as source:
        assert eventually(lambda: source.reads > 3 * QUICK.stall / QUICK.read)
        assert (source.capture.state, source.starts) == (CaptureState("starting"), 1)
        source.gives = True
        assert eventually(lambda: source.capture.state == CaptureState("live"))
        source.gives = False
        assert eventually(
            lambda: source.capture.state.reason == "the camera sent no data for 0.2 s"
        )


def test_source_that_never_starts_is_retried():
    with Scripted(
        CaptureLimits(opening=0.1, stall=60.0, read=0.02, first_retry=0.02, last_retry=0.02)
    ) as source:
        assert eventually(lambda: source.starts > 2)
        assert source.capture.state.reason == "the camera sent no data for 0.1 s"


def test_reason_of_a_failure_is_kept_until_the_source_works_again():
    with Scripted() as source:
        source.gives = True
        assert eventually(lambda: source.capture.state.status == "live")
        source.gives, source.broken = False, "unplugged"
        assert eventually(lambda: source.capture.state == CaptureState("failed", "unplugged"))
        source.broken = ""
        assert eventually(lambda: source.capture.state == CaptureState("starting", "unplugged"))
        source.gives = True
        assert eventually(lambda: source.capture.state == CaptureState("live"))
