"""The effect of a robot's safety limits under the network of a condition: from half of the accepted
age of commands and frames on, the robot slows down (robots/api/age_limits.py), so that a study of
delay would measure these limits as well.
"""

from dataclasses import dataclass
from itertools import product

from experiments.definition.schema import Impairment, Network
from robots.api.age_limits import fading

# Ages in s without impairment on a good network. Commands: half a tick of the control loop, and the
# network. Frames: camera, encoder, page and half a frame.
REAL_COMMANDS, REAL_PICTURES = 0.015, 0.06
STEPS = 41  # samples of a jitter
ROUNDING = 1e-9


@dataclass(frozen=True)
class SafetyPrediction:
    """The mean `share` of full speed of accepted commands, and the share of `refused` ones."""

    share: float
    refused: float

    @property
    def is_slowed(self) -> bool:
        return self.share < 1.0 - ROUNDING or self.refused > ROUNDING


def predicted(network: Network, command_age: float, frame_age: float) -> SafetyPrediction:
    """Return the speed that a robot with these limits on age, in s, keeps on a network. A jitter J
    spreads a delay evenly from J below to J above (robots/agent/lab).
    """
    ages = [
        (there + REAL_COMMANDS, there + back + REAL_PICTURES)
        for there, back in product(_delays(network.control), _delays(network.video))
    ]
    accepted = [one for one in ages if one[0] < command_age and one[1] < frame_age]
    shares = [min(fading(late, command_age), fading(old, frame_age)) for late, old in accepted]
    share = sum(shares) / len(shares) if shares else 0.0
    return SafetyPrediction(share, (len(ages) - len(shares)) / len(ages))


def longest_video_delay(frame_age: float) -> float:
    """Return the longest delay of the video, in s, at which a robot does not slow down."""
    return max(0.0, frame_age / 2.0 - REAL_PICTURES)


def latest(impairment: Impairment | None) -> float:
    """Return the longest delay of a packet in s, without waiting for the bit rate."""
    return 0.0 if impairment is None else impairment.delay + impairment.jitter


def _delays(impairment: Impairment | None) -> list[float]:
    if impairment is None or not impairment.jitter:
        return [latest(impairment)]
    spread = (2.0 * step / (STEPS - 1) - 1.0 for step in range(STEPS))
    return [max(0.0, impairment.delay + impairment.jitter * share) for share in spread]
