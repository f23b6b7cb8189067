"""What both adapters for OpenMORA share: its guard, its cancel, how actions start, and braking.

A subclass sends what it is given over MOOS (adapter.py) or MQTT (openmora_mqtt.py).
"""

import math
import time
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace

from msgspec import Struct

from robots.agent.adapters.common import remote_adapter
from robots.agent.adapters.common.pending_actions import (
    LONGEST_RELOCALIZATION,
    ExpectedArea,
    PendingAction,
)
from robots.agent.adapters.common.remote_adapter import RemoteAdapter, profile_of
from robots.agent.adapters.common.robot_profile import RobotProfile
from robots.agent.adapters.moos import openmora
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import ActionRefusedError
from robots.api.messages import Action, Capability, Goto, Pose, Relocalize, Velocity
from robots.api.reasons import ReasonCode

SLOWEST_GUARD = 2.0  # seconds, as for a watchdog
CANCEL_AGAIN = 0.1  # seconds between two cancels, at least
ARRIVED = 0.6  # metres from its goal at which a journey may end: OpenMORA's navigators allow 0.5
ERROR_SHOWN = 10.0  # seconds
# seconds in which the particle filter has taken note of an area: it computes once for ten scans
# while the robot is at rest
FILTERING = 1.0


class OpenMoraOptions(Struct, frozen=True, kw_only=True):
    """`tilt_sign` is -1 where the head counts upwards; `nodes` are names of places, with commas.

    `client_ack_interval` is the `max_client_ack_interval` of the robot's RobotControlManager in
    seconds, 0 where its `use_client_alive_ack` is off.

    To relocalize, the robot searches a square that reaches `relocalize_half_width` metres to each
    side, with so many `relocalize_particles`. The first should be the robot's own X_MIN … Y_MAX,
    the second is what OpenMORA uses when lost.
    """

    watchdog: float
    client_ack_interval: float = 0.0
    tilt_sign: float = 1.0
    nodes: str = ""
    relocalize_half_width: float = 1.0
    relocalize_particles: int = 20000


class OpenMoraAdapter(RemoteAdapter):
    """See robot_interface.Adapter. `name` is the robot in sentences."""

    name = "this robot"

    def __init__(
        self,
        robot: RobotProfile,
        options: OpenMoraOptions,
        adapter: str,
        rca: str,
        own: Sequence[Capability],
    ) -> None:
        # what ends OpenMORA's navigation when the agent is lost: its RobotControlManager, if that
        # expects an acknowledgement of ours often enough
        guarded = 0.0 < options.client_ack_interval <= SLOWEST_GUARD
        profile = profile_of(
            robot,
            rca,
            options.watchdog,
            own=tuple(own),
            control="guarded" if guarded else "unguarded",
            advice="set use_client_alive_ack = true and max_client_ack_interval = 0.5 for"
            " RobotControlManager in the mission file, and client_ack_interval = 0.5 in"
            f" [{adapter}] of the profile",
        )
        super().__init__(profile, robot.battery)
        # The broker or database answers for a robot that hangs, and would store more velocities.
        self.gate_params = replace(remote_adapter.GATE, orders=1)
        self._robot = robot
        self._options = options
        self._nodes = frozenset(name.strip() for name in options.nodes.split(",") if name.strip())
        self._place = ""
        self._error_at = 0.0
        self._cancelled_at = -math.inf  # monotonic

    @abstractmethod
    def _send_motion(self, velocity: Velocity) -> None:
        """Send a velocity, which sets the autonomous mode."""

    @abstractmethod
    def _send_cancel(self) -> None:
        """End navigation and docking, which sets the manual mode."""

    @abstractmethod
    async def _send_action(self, action: Action) -> None:
        """Send an action to a known place; raises as `_order`."""

    def _drive(self, velocity: Velocity) -> None:
        drive = self.pending_actions.drive
        is_cancelling = drive is not None and drive.first_cancelled_at is not None
        if velocity != ZERO or not is_cancelling:
            self._send_motion(velocity)
        elif time.monotonic() - self._cancelled_at > CANCEL_AGAIN:
            # it sets the autonomous mode, which the cancel behind it ends
            self._send_motion(ZERO)
            self._cancel_navigation()

    def _cancel_navigation(self) -> None:
        now = time.monotonic()
        if now - self._cancelled_at > CANCEL_AGAIN:
            self._cancelled_at = now
            self._send_cancel()

    async def _order(self, action: Action) -> PendingAction:
        match action:
            case Goto(x=None) | Goto(y=None) if action.place not in self._nodes:
                raise ActionRefusedError(ReasonCode.UNKNOWN_PLACE.of(action.place))
            case Relocalize(x=None) | Relocalize(y=None):
                raise ActionRefusedError(ReasonCode.NO_GOAL)
        await self._send_action(action)
        if not isinstance(action, Relocalize) or action.x is None or action.y is None:
            return self._pending(action)
        # a heading cannot be sent; the robot must report that it is in the area
        area = ExpectedArea(
            action.x, action.y, self._options.relocalize_half_width, settles=FILTERING
        )
        now = time.monotonic()
        deadline = now + LONGEST_RELOCALIZATION
        return PendingAction(action.action_id, "relocalize", now, deadline=deadline, area=area)

    def _area(self, x: float, y: float) -> str:
        options = self._options
        return openmora.area(x, y, options.relocalize_half_width, options.relocalize_particles)

    def _head_degrees(self, angle: float) -> float:
        return openmora.head_degrees(angle, self._robot, self._options.tilt_sign)

    def _located(self, pose: Pose | None, stamp: float) -> None:
        """Take the robot's pose, None while it is lost; `stamp` is in Unix time."""
        now = time.monotonic()
        if pose is None:
            self.readings.lost(now)
            self.readings.last_received_at = now  # it works, although it is lost
        else:
            self.readings.located(pose, self.readings.believed("pose", stamp, time.time()), now)

    def _report_error(self, text: str) -> None:
        self.readings.errors = (text,)
        self._error_at = time.monotonic()

    def _look(self, now: float) -> None:
        if self.readings.errors and now - self._error_at > ERROR_SHOWN:
            self.readings.errors = ()

    def _is_at_goal(self, pending: PendingAction) -> bool:
        if pending.goal is None:
            return self._place == pending.place
        pose = self.readings.pose
        return pose.localized and math.dist((pose.x, pose.y), pending.goal) < ARRIVED


def is_plan(pending: PendingAction) -> bool:
    """Whether OpenMORA's Executor carries an action out: all but a journey to a point."""
    return pending.kind != "goto" or bool(pending.place)
