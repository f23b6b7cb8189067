"""Which controller moves the base, and every event that changes it.

The kernel is in exactly one state. `TRANSITIONS` names every change; an event that is not listed
for a state leaves it unchanged.
"""

from enum import Enum


class Controller(Enum):
    NONE = "none"  # the robot was measured at rest; no velocities are sent
    DRIVER = "driver"  # the driver's velocities, and the zeros after them until rest
    SETTLING = "settling"  # zeros until rest; driver and navigation wait for it
    NAVIGATION = "navigation"  # navigation's velocities, which pass through the kernel
    RCA = "rca"  # the RCA moves the base by itself; the kernel watches


class Change(Enum):
    DRIVEN = "driven"  # a velocity is sent for the driver, or a stop for an idle robot
    AT_REST = "at rest"  # the robot has been measured at rest for long enough
    MOVES_UNBIDDEN = "moves unbidden"  # it was measured moving although nothing may move it
    DRIVER_CHANGED = "driver changed"
    HANDED_OVER = "handed over"  # the RCA's navigation may begin
    PASSED_ON = "passed on"  # navigation asks the kernel for a velocity
    NAVIGATION_LEFT = "navigation left"  # it ended, failed or was cancelled


TRANSITIONS: dict[Controller, dict[Change, Controller]] = {
    Controller.NONE: {
        Change.DRIVEN: Controller.DRIVER,
        Change.MOVES_UNBIDDEN: Controller.SETTLING,
        Change.HANDED_OVER: Controller.RCA,
        Change.PASSED_ON: Controller.NAVIGATION,
    },
    Controller.DRIVER: {
        Change.AT_REST: Controller.NONE,
        Change.DRIVER_CHANGED: Controller.SETTLING,
        Change.MOVES_UNBIDDEN: Controller.SETTLING,
    },
    Controller.SETTLING: {
        Change.AT_REST: Controller.NONE,
    },
    Controller.NAVIGATION: {
        Change.NAVIGATION_LEFT: Controller.DRIVER,
    },
    Controller.RCA: {
        Change.PASSED_ON: Controller.NAVIGATION,
        Change.NAVIGATION_LEFT: Controller.SETTLING,
    },
}


def after(controller: Controller, event: Change) -> Controller:
    return TRANSITIONS[controller].get(event, controller)
