"""When a robot is idle, and how often it then sends its state.

A robot is needed while it has a lease, while a page is connected to it, and for INTEREST_SECONDS
after each message to it, usually `command/heartbeat`: servers send this for every page that is open
at the robot. Otherwise the robot is idle. `is_news` defines which changes it reports at once; the
reference of the Robot API has the same for agents in other languages.
"""

import math

from robots.api.messages import Pose, State

IDLE_STATE_SECONDS = 30.0  # between two states of an idle robot without a change
# After so long without a message, a robot without a last will is offline. It is here because it
# follows from the period above: one state may be lost.
ONLINE_SECONDS = 45.0
INTEREST_SECONDS = 5.0  # for which one heartbeat keeps a robot at its full rate
INTEREST_PERIOD_SECONDS = 1.0  # between two heartbeats of a web process with a page at the robot
WATCHER = "watcher"  # the peer of these heartbeats, which no robot echoes
CHARGE_STEP = 0.02
DISTANCE_STEP_M = 0.25
ANGLE_STEP_RAD = math.radians(15.0)
TILT_STEP_RAD = 0.03

_COMPARED = (
    *("session", "docked", "charger_contact", "mode", "assist", "safety", "errors"),
    *("viewers", "call", "screens", "knockable", "knock", "camera_status"),
)


def is_news(before: State, after: State) -> bool:
    """Tell whether a person or the server would act on what has changed since `before`."""
    return (
        any(getattr(before, name) != getattr(after, name) for name in _COMPARED)
        or after.contacts > 0
        or before.battery.charging != after.battery.charging
        or _differs(before.battery.charge, after.battery.charge, CHARGE_STEP)
        or _differs(before.tilt, after.tilt, TILT_STEP_RAD)
        or _has_moved(before.pose, after.pose)
    )


def _differs(before: float | None, after: float | None, step: float) -> bool:
    if before is None or after is None:
        return before is not after
    return abs(after - before) >= step


def _has_moved(before: Pose, after: Pose) -> bool:
    turned = math.remainder(after.theta - before.theta, math.tau)
    return (
        before.localized != after.localized
        or math.hypot(after.x - before.x, after.y - before.y) >= DISTANCE_STEP_M
        or abs(turned) >= ANGLE_STEP_RAD
    )
