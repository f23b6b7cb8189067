"""What the nodes of ROS 1 and ROS 2 share: the connection to the agent, and what their guards
know of the robot.

It runs in the Python of either ROS and so imports nothing of ours and is written for Python 3.6.
"""

import array
import base64
import collections
import json
import math
import os
import socket
import sys
import threading
import time
import traceback
from typing import Any

SILENCE = 0.3  # s without another velocity, after which a moving robot is stopped
OLDEST = 0.25  # s after which a velocity that waited for this process is dropped
HEARTBEAT = 0.5  # s without a line from the agent, after which the guard stops the robot
CANCEL_AGAIN = 0.5  # s between two cancels
MOST_CANCELS = 10  # of a docking that wait for an answer at a time
SETTLED_WITHIN = 6.0  # s in which the cancels before a docking have to be answered
STILL_FOR = 0.3  # s of measured standstill, after which the robot is at rest
HEARING = 3.0  # s for a subscriber to be found by a message that waits for it
BACKLOG = 500  # lines of readings that wait for the agent
ANSWERED_WITHIN = 300.0  # s in which a service that docks may answer, and start the robot


class Link:
    """The connection to the agent. `say` never blocks, and drops readings that wait for long."""

    def __init__(self, connection: Any) -> None:
        self.connection = connection
        self.lines: Any = collections.deque()
        self.changed = threading.Condition()

    def say(self, **message: Any) -> None:
        line = (json.dumps(message) + "\n").encode()
        with self.changed:
            if message["op"] != "publish" or len(self.lines) < BACKLOG:
                self.lines.append(line)
                self.changed.notify_all()

    def write(self) -> None:
        while True:
            with self.changed:
                self.changed.wait_for(lambda: self.lines)
                line = self.lines[0]
            try:
                self.connection.sendall(line)
            except OSError:  # the agent is gone, which the reader notices
                self.lines = collections.deque(maxlen=0)
                return
            with self.changed:
                self.lines.popleft()
                self.changed.notify_all()

    def drain(self, seconds: float) -> None:
        """Wait until all lines are written, at most so long."""
        with self.changed:
            self.changed.wait_for(lambda: not self.lines, timeout=seconds)


class Standstill:
    """Whether odometry proves that the robot is at rest.

    A message that is published again, with the same stamp, does not count; a stamp of zero is none.
    """

    def __init__(self) -> None:
        self.linear, self.angular = 0.02, 0.05  # m/s and rad/s: no faster is at rest
        self.measured_at = time.monotonic()
        self.still_since = math.inf
        self.stamp: Any = None

    def measure(self, odometry: Any, now: float) -> None:
        stamp = plain(odometry.header.stamp)
        if any(stamp.values()) and stamp == self.stamp:
            return
        self.stamp, self.measured_at = stamp, now
        twist = odometry.twist.twist
        still = (
            math.hypot(twist.linear.x, twist.linear.y) <= self.linear
            and abs(twist.angular.z) <= self.angular
        )
        self.still_since = min(self.still_since, now) if still else math.inf

    @property
    def is_proved(self) -> bool:
        return self.measured_at - self.still_since >= STILL_FOR


class DockingCalls:
    """Whether a docking or undocking may move the robot.

    It may from the call of its service until the agent reports its end, the service refuses, or the
    cancel service has answered. A cancel that was sent before the call was answered proves nothing:
    the robot may start afterwards.

    No service that docks is called while a cancel is under way, as after connecting: ROS keeps no
    order between two services, and a cancel that arrives second would end the docking unnoticed.
    """

    def __init__(self) -> None:
        self.services: Any = ()
        self.cancel_service = ""
        self.is_left = False  # one of an earlier run may, or one whose cancel was not answered
        self.is_called = False  # one of this run may
        self.number = 0
        self.cancels = 0  # how many are under way
        self.changed = threading.Condition()  # each call and each cancel has a thread
        self.unanswered: Any = {}  # when each call was made that has no answer, by its number

    @property
    def is_active(self) -> bool:
        return self.is_left or self.is_called

    def begin(self, services: Any, cancel_service: str) -> None:
        """Set the services; an earlier run may have left a docking."""
        self.services, self.cancel_service = services, cancel_service
        self.is_left = bool(cancel_service)

    def called(self, service: str) -> int:
        """Note a call; return its number, 0 for a service that does not dock."""
        if service not in self.services or not self.cancel_service:
            return 0
        with self.changed:
            self.number += 1
            self.unanswered[self.number] = time.monotonic()
            self.is_called = True
            return self.number

    def settled(self, within: float) -> bool:
        """Wait until an earlier docking has ended and no cancel is under way, at most so many
        seconds; return whether that is so.
        """
        with self.changed:
            return self.changed.wait_for(lambda: not self.is_left and not self.cancels, within)

    def answered(self, number: int, answer: Any) -> None:
        """Note the answer of a call: `values`, or a `problem` that is `absent` without a server."""
        refused = answer.get("absent") or answer.get("values", {}).get("success") is False
        with self.changed:
            self.unanswered.pop(number, None)
            if number and number == self.number and refused:
                self.is_called = False

    def cancelling(self, *, own: bool) -> Any:
        """Note a cancel that is sent now, with `own` also of a docking of this run; return the
        first argument of `cancelled`, None when there is nothing to cancel.
        """
        oldest = time.monotonic() - ANSWERED_WITHIN
        with self.changed:
            if not (self.is_left or (own and self.is_called)) or self.cancels >= MOST_CANCELS:
                return None
            self.cancels += 1
            return -1 if any(at > oldest for at in self.unanswered.values()) else self.number

    def cancelled(self, number: int, answer: Any) -> None:
        """Note the answer of a cancel, as in `answered`; without one, it may still arrive."""
        is_over = "values" in answer or "absent" in answer
        with self.changed:
            self.cancels -= 1
            self.is_left = not is_over
            if is_over and number == self.number:
                self.is_called = False
            self.changed.notify_all()


class MissingTypeError(Exception):
    """The package of a type `package/Name` is not installed; the message is one sentence."""

    @classmethod
    def of(cls, kind: str, why: str = "") -> "MissingTypeError":
        package = kind.partition("/")[0]
        distribution = os.environ.get("ROS_DISTRO", "")
        remedy = "ros-" + distribution + "-" + package.replace("_", "-") if distribution else "it"
        return cls(
            kind
            + " is not available: the ROS package "
            + package
            + " is not installed for "
            + sys.executable
            + (" (" + why + ")" if why else "")
            + "; install "
            + remedy
        )


class GuardedNode:
    """One connection to the agent; a subclass has a method `do_…` for each order."""

    def __init__(self, connection: Any) -> None:
        self.link = Link(connection)
        self.say = self.link.say
        self.standstill, self.docking = Standstill(), DockingCalls()
        self.docking_cancelled_at = -math.inf
        self.publishers: Any = {}
        self.problems: Any = {}  # sentences for the robot's owner, by topic
        self.beaten_at = time.monotonic()
        # (topic of velocities, its subscribers) as reported last, and as they are
        self.counted: Any = None

    def start(self, *works: Any) -> None:
        """Run each in a thread of its own, beside the one that writes to the agent."""
        for work in (self.link.write, *works):
            threading.Thread(target=work, daemon=True).start()

    def obey_orders(self) -> None:
        """Obey the agent until its connection ends."""
        try:
            for line in self.link.connection.makefile("r", encoding="utf-8"):
                self.beaten_at = time.monotonic()
                self.obey(json.loads(line))
        except (OSError, ValueError):
            pass  # counts as the end of the connection

    def obey(self, order: Any) -> None:
        try:
            getattr(self, "do_" + order.pop("op"))(**order)
        except MissingTypeError as error:
            self.say(op="lost", reason=str(error))
        except Exception:  # one bad order must not end the guard
            traceback.print_exc()

    def attempt(self, work: Any) -> Any:
        """Return the result of `work`, None when it fails."""
        try:
            return work()
        except Exception:  # whatever fails, guarding continues
            traceback.print_exc()
            return None

    def do_beat(self) -> None:
        pass

    def do_subscribe(self, topic: str, kind: str, *, essential: bool, **settings: Any) -> None:
        """Subscribe to a topic. Without its type, an essential one ends the connection, and any
        other is reported.
        """
        try:
            self.subscribe(topic, kind, **settings)
        except MissingTypeError as error:
            why = topic + " is not received, because " + str(error)
            if essential:
                raise MissingTypeError(why) from error
            self.problem(topic, why)

    def subscribe(self, topic: str, kind: str, *, period: float, latched: bool) -> None:
        raise NotImplementedError

    def problem(self, key: str, sentence: str) -> None:
        """Report a problem of the robot's set-up, or ("") its end."""
        if self.problems.get(key, "") != sentence:
            self.problems[key] = sentence
            self.say(op="problems", sentences=[each for each in self.problems.values() if each])

    def do_docking_ended(self) -> None:
        self.docking.is_called = False

    def do_call(self, number: int, service: str, kind: str, arguments: Any) -> None:
        docking = self.docking.called(service)

        def call() -> None:
            try:
                if docking and not self.docking.settled(SETTLED_WITHIN):
                    why = self.docking.cancel_service + " does not answer"
                    answer = {"problem": why, "absent": True}
                else:
                    answer = self.answer_of(service, kind, arguments, docking=docking)
            except Exception as error:  # the agent, and the docking, need an answer to every call
                traceback.print_exc()
                answer = {"problem": str(error) or type(error).__name__}
            self.docking.answered(docking, answer)
            self.say(op="response", number=number, **answer)

        threading.Thread(target=call, daemon=True).start()

    def answer_of(self, service: str, kind: str, arguments: Any, *, docking: int = 0) -> Any:
        """Call a service and return its `values`, or a `problem` that is `absent` without a server;
        with a number of `docking`, only while the agent is connected.
        """
        raise NotImplementedError

    def cancel_docking(self, *, own: bool) -> None:
        """Call the cancel service every CANCEL_AGAIN until an earlier docking has ended, with `own`
        also one of this run. The agent learns of that: the robot reports no such end.

        An earlier cancel may still be answered, and so is not abandoned for the next one.
        """
        now = time.monotonic()
        if now - self.docking_cancelled_at <= CANCEL_AGAIN:
            return
        number = self.docking.cancelling(own=own)
        if number is not None:
            self.docking_cancelled_at = now
            if own:
                self.say(op="docking_cancelled")
            threading.Thread(target=self.call_cancel_dock, args=(number,), daemon=True).start()

    def call_cancel_dock(self, number: int) -> None:
        answer: Any = {}
        try:
            answer = self.answer_of(self.docking.cancel_service, "std_srvs/Trigger", {})
        finally:
            self.docking.cancelled(number, answer)

    def do_guard(self, **settings: Any) -> None:
        self.standstill.linear, self.standstill.angular = settings["linear"], settings["angular"]
        self.docking.begin(settings["docks"], settings["cancel_dock"])

    def report_listeners(self, topic: str, count: int) -> None:
        """Report how many nodes receive velocities, when that has changed."""
        if (topic, count) != self.counted:
            self.counted = topic, count
            self.say(op="listeners", topic=topic, count=count)


def connect() -> Any:
    """Return the connection to the agent, whose port is the first argument and whose password is
    the first line of standard input.
    """
    connection = socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=5.0)
    connection.settimeout(None)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.sendall(sys.stdin.readline().encode())
    return connection


def refuse(connection: Any, reason: str) -> int:
    connection.sendall((json.dumps({"op": "lost", "reason": reason}) + "\n").encode())
    return 1


def plain(value: Any) -> Any:
    """Return a message of either ROS as JSON: bytes as base64, numbers that JSON lacks as None."""
    names = getattr(
        value, "get_fields_and_field_types", lambda: getattr(value, "__slots__", None)
    )()
    if names is not None:
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, array.array) and value.typecode == "B":
        value = value.tobytes()
    if isinstance(value, (bytes, bytearray)):
        return base64.b64encode(value).decode()
    if hasattr(value, "tolist"):  # array.array and numpy.ndarray
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def filled(message: Any, content: Any, type_of: Any) -> Any:
    """Return a message of either ROS with the fields of an object; `type_of` returns the class of a
    message by its type.
    """
    if hasattr(message, "get_fields_and_field_types"):
        kinds = message.get_fields_and_field_types()
    else:  # a time of ROS 1 has no types
        kinds = dict(zip(message.__slots__, getattr(message, "_slot_types", ())))
    for name, value in content.items():
        now, kind = getattr(message, name), kinds.get(name, "")
        if isinstance(value, dict):
            filled(now, value, type_of)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            made = type_of(kind.replace("sequence<", "").split(">")[0].split("[")[0])
            setattr(message, name, [filled(made(), each, type_of) for each in value])
        elif isinstance(value, list) and ("float" in kind or "double" in kind):
            setattr(message, name, [float(each) for each in value])
        elif isinstance(value, str) and not isinstance(now, str):
            data = base64.b64decode(value)
            setattr(message, name, data if isinstance(now, bytes) else list(data))
        else:
            setattr(message, name, float(value) if isinstance(now, float) else value)
    return message
