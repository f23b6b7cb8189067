"""The connection to a ROS system, as RosAdapter uses it: rospy or rclpy in a child process, or
rosbridge.

Messages are JSON objects (messages.py); types are written as in ROS 1 (`nav_msgs/Odometry`).
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from robots.agent.adapters.ros.graph import Graph
from robots.agent.robot_interface import ActionRefusedError, AdapterError
from robots.api.messages import ActionState

OURS = "telepresence-"  # with which the ids of our goals begin, as in ros1_node.py
ANSWER_TIME = 10.0  # seconds that a service has to answer
# in action_msgs/GoalStatus
GOAL_ENDED: dict[int, ActionState] = {4: "FINISHED", 5: "CANCELLED", 6: "FAILED"}

Handler = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Subscription:
    """A topic to subscribe to, its type, and the handler of its messages.

    `latched`: the last message is wanted as well. `either`: publishers of either durability are
    received. `sensor`: messages may be lost. `period`: the least time between two messages, in s.
    `essential`: without the package of its type the connection ends, because driving would not be
    safe; the lack of another one is reported as a problem.
    """

    topic: str
    kind: str
    handler: Handler
    latched: bool = False
    either: bool = False
    sensor: bool = False
    period: float = 0.0
    essential: bool = False


class Goals(Protocol):
    """Receives the progress of goals."""

    def accepted(self, goal: str) -> None:
        """The robot executes it."""

    def ended(self, goal: str, status: ActionState, reason: str) -> None:
        """The robot has reported its terminal status."""

    def failed(self, goal: str, reason: str) -> None:
        """It failed, but may still run, and must be cancelled."""

    def server_ended(self) -> None:
        """The action server has ended, and with it all goals."""

    def docking_cancelled(self) -> None:
        """The guard has cancelled the docking, because the agent had not responded."""


class Bus(Protocol):
    """A connection to a ROS system; only awaited calls may block. After a loss, each call raises
    AdapterError.
    """

    version: int
    place: str
    # whether `ask` asks the subscribers of velocities; otherwise a reading proves that they respond
    answers: bool
    # whether a guard on the RCA's side stops the robot when the agent is lost
    guards: bool
    advice: str  # the start of a sentence: how to get one
    connect_time: float | None  # seconds, None for the default

    @property
    def problems(self) -> tuple[str, ...]:
        """Problems of the connection itself or of the ROS master, a sentence each, the gravest
        first.
        """

    async def open(self, lost: Callable[[str], None], goals: Goals) -> None:
        """Connect, and cancel the goals of an earlier connection; `lost` is called with the reason
        when the connection ends. Raises AdapterError, OSError or TimeoutError.
        """

    def tell_guard(self, **message: Any) -> None:
        """Send the guard what to guard (`op` "guard", once, right after `open`), or that a docking
        has ended (`op` "docking_ended").
        """

    async def shut(self) -> None:
        """Disconnect; a guard stops the robot first."""

    def subscribe(self, subscription: Subscription) -> None: ...

    def advertise(
        self, topic: str, kind: str, *, drives: bool = False, latch: bool = False
    ) -> None:
        """Advertise a topic, or replace its type; `drives` are velocities, `latch` keeps the last
        message for later subscribers.
        """

    async def ask(self) -> None:
        """Wait until the subscribers of velocities have answered a probe."""

    def cut(self) -> None:
        """Discard what has not been sent yet; at once."""

    def listeners(self, topic: str) -> int | None:
        """Return how many subscribers of our type a topic that drives has; None when unknown."""

    async def graph(self, driving: str, received: Iterable[str]) -> Graph | None:
        """Return the peers of topics, at least of `driving` and of those `received`; None when
        unknown.
        """

    def publish(self, topic: str, message: dict[str, Any], *, newest: bool = False) -> None:
        """Send; with `newest`, only the last one counts, and only while it is fresh."""

    async def call(
        self,
        service: str,
        kind: str,
        arguments: dict[str, Any] | None = None,
        *,
        within: float = ANSWER_TIME,
    ) -> tuple[bool, str]:
        """Call a service and return its success and message; `within` is in seconds. Raises
        ActionRefusedError when it does not exist, else AdapterError.
        """


class ActionBus(Bus, Protocol):
    """A bus that carries the actions of ROS 2."""

    def send_goal(self, action: str, kind: str, goal: dict[str, Any], name: str) -> None:
        """Send a goal under a name of ours."""

    async def cancel_goal(self, action: str, name: str) -> bool:
        """Cancel a goal; return True when it certainly does not run and never will."""


class UnansweredError(AdapterError):
    """A call of a service had no answer: the service may still obey it."""


def result_of(service: str, values: Any, *, problem: Any, is_absent: bool) -> tuple[bool, str]:
    """Return the success and message of a service's answer; raises as `Bus.call` without values."""
    if not isinstance(values, dict):
        kind_of_error = ActionRefusedError if is_absent else AdapterError
        raise kind_of_error(f"{service} cannot be called: {problem}")
    return bool(values.get("success")), str(values.get("message", ""))
