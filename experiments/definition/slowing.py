"""What a robot's safety limits make of the network of a condition: from half of an age that it
accepts it slows down (robots/api/age_limits.py), so that a study of delay would measure these
limits as well.
"""

from dataclasses import dataclass

from experiments.definition.schema import Impairment, Network
from robots.api.age_limits import fading

# s: what commands and pictures need without any impairment on a good network: half a tick of the
# robot's control loop and the way; camera, encoder, page and half of its frame
REAL_COMMANDS, REAL_PICTURES = 0.015, 0.06
STEPS = 41  # in which a jitter is looked at
ROUNDING = 1e-9


@dataclass(frozen=True)
class SafetyPrediction:
    """What the limits leave of a drive: the mean `share` of full speed of the commands that are
    accepted, and the share that is `refused`.
    """

    share: float
    refused: float

    @property
    def is_slowed(self) -> bool:
        """Tell whether anything is left to be seen of the limits."""
        return self.share < 1.0 - ROUNDING or self.refused > ROUNDING


def predicted(network: Network, command_age: float, frame_age: float) -> SafetyPrediction:
    """Return what is left of a drive over a network by a robot that accepts such ages, in seconds.

    A jitter of J spreads a delay evenly from J below to J above (robots/agent/lab).
    """
    shares: list[float] = []
    refused = 0
    for there in _delays(network.control):
        for back in _delays(network.video):
            command, frame = there + REAL_COMMANDS, there + back + REAL_PICTURES
            if command >= command_age or frame >= frame_age:
                refused += 1
            else:
                shares.append(min(fading(command, command_age), fading(frame, frame_age)))
    share = sum(shares) / len(shares) if shares else 0.0
    return SafetyPrediction(share, refused / (refused + len(shares)))


def longest_video_delay(network: Network, frame_age: float) -> float:
    """Return how much the video alone can be delayed before a robot slows down, in seconds."""
    return max(0.0, frame_age / 2.0 - REAL_PICTURES - latest(network.control))


def latest(impairment: Impairment | None) -> float:
    """Return for how long a packet is held at most by what is put on a network, but for its bit
    rate.
    """
    return 0.0 if impairment is None else impairment.delay + impairment.jitter


def _delays(impairment: Impairment | None) -> list[float]:
    if impairment is None:
        return [0.0]
    if not impairment.jitter:
        return [impairment.delay]
    return [
        max(0.0, impairment.delay + impairment.jitter * (2.0 * step / (STEPS - 1) - 1.0))
        for step in range(STEPS)
    ]
