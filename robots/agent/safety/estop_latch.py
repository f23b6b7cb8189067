"""The e-stop latch: once set it holds, across restarts of the agent, until an authorized person
clears it.
"""

from dataclasses import dataclass

from robots.api.messages import ClearEStop

BUTTON = "button"
SCREEN = "screen"
UNREADABLE = "unreadable"


@dataclass(frozen=True)
class EStopLatch:
    """A pressed e-stop: `source` is the sender's role or `button` for the robot's own; `stamp` is
    Unix time.
    """

    source: str
    stamp: float
    user: str = ""
    detail: str = ""

    @property
    def label(self) -> str:
        """Source and user, for people."""
        return f"{self.source}:{self.user}" if self.user else self.source


def stricter(held: EStopLatch | None, new: EStopLatch) -> EStopLatch:
    """Return the latch that counts after two: the robot's own button, else the first."""
    if held is None or (new.source == BUTTON and held.source != BUTTON):
        return new
    return held


def refusal(latch: EStopLatch | None, action: ClearEStop, *, button_pressed: bool) -> str | None:
    """Return in one word why this clear_estop, whose role and user are valid, does not open the
    latch.
    """
    if button_pressed:
        return "button_pressed"
    if latch is not None and latch.source == BUTTON and action.role != "owner":
        return "owner_only"
    if action.role == SCREEN and (latch is None or latch.source != SCREEN):
        return "not_yours"  # the screen clears only what the screen has pressed
    return None
