"""A node of ROS 2 that serves the agent over a loopback connection: one JSON object a line.

It runs in the Python that has rclpy, which may not be the agent's (Humble: 3.10, Jazzy: 3.12), and
so imports nothing of ours and is written for Python 3.8.

    agent -> node   beat (every 0.1 s), guard, advertise, publish, drive (a velocity),
                    ask (answered when every reliable subscriber has acknowledged the last
                    velocity), graph, subscribe, call, docking_ended, goal, cancel
    node -> agent   ready, publish, response, listeners, accepted, ended, problems, lost

This process is also the robot's guard, and outlives the agent. When the connection closes, or no
line arrives for HEARTBEAT while a goal of ours may run, it cancels our goals and publishes zero
velocities until each goal has a terminal status and the robot is measured at rest. Then it exits.

The ids of our goals are PREFIX and the time at which they were sent. An active one that is older
than this process was left by an earlier run and is cancelled. Before `ready`, only cancels and zero
velocities for such goals are sent.

Threads: the main one reads the agent's lines, the executor's has all goals and callbacks, `watch`
is the guard, and one writes to the agent, so that a hung agent blocks none of the others.
"""

import importlib
import json
import math
import os
import queue
import signal
import sys
import threading
import time
import traceback
from typing import Any

if __package__:
    from robots.agent.adapters.ros import guarded_node as guarded
else:  # as a program, in a Python that does not have ours
    import guarded_node as guarded  # type: ignore[no-redef]

PERIOD = 0.05  # s between two rounds of the guard
PREFIX = b"telepres"  # the first bytes of the ids of our goals
CONFIRMED_WITHIN = 0.2  # s that the agent waits for the end of a goal that it cancels
RESULT_WITHIN = 0.2  # s between a terminal status and the result, which has the reason
SERVER_WITHIN = 4.0  # s that a new goal waits for its action server
MATCHED_WITHIN = 0.3  # s between the discovery of the server and its discovery of us
LOST_AFTER = 10.0  # s after which a goal that the server does not know never reached it
GONE_AFTER = 2.0  # s without a server, after which its goals have ended and it answers no call
DISCOVERY = 0.6  # s for the action server and its status to be discovered at the start
LEFTOVERS = 3.0  # s for goals of an earlier run to end, before the connection is given up
STARTED_WITHIN = 30  # s after which a start that hangs in the middleware ends this process
MEASURED_WITHIN = 1.0  # s after which odometry is missing
FORGOTTEN_AFTER = 60.0  # s without any sign of the robot, after which its guard ends
FAREWELL = 0.2  # s for the last lines to the agent
PEERS_PERIOD = 0.5  # s between two looks at the quality of service of others
BYSTANDER = 1.0  # s after which one of several subscribers that acknowledge nothing may be dead
ACTIVE = (1, 2, 3)  # action_msgs/GoalStatus: accepted, executing, canceling
CANCELED, ABORTED = 5, 6
UNKNOWN_GOAL, GOAL_TERMINATED = 2, 3  # action_msgs/CancelGoal


def type_of(kind: str, part: str) -> Any:
    """Return the class of `package/Name`; `part` is msg, srv or action."""
    package, _, name = kind.partition("/")
    try:
        return getattr(importlib.import_module(package + "." + part), name)
    except (ImportError, AttributeError) as error:
        raise guarded.MissingTypeError.of(kind, str(error)) from error


def filled(message: Any, content: Any) -> Any:
    return guarded.filled(message, content, lambda kind: type_of(kind, "msg"))


class Goal:
    """A goal of ours at an action server; one without a name was left by an earlier run."""

    def __init__(self, uuid: bytes, name: str = "", request: Any = None) -> None:
        self.uuid, self.name = uuid, name
        self.request = request  # until it is sent
        self.status = 0  # action_msgs/GoalStatus; 0 until it is accepted
        self.began = time.monotonic()
        self.unwanted = not name
        self.cancelled_at = -math.inf
        self.over_at = math.inf
        self.questions: Any = []  # (number, deadline) of the agent's cancels


class OwnedGoals:
    """Our goals at an action server. Everything runs on the executor's thread.

    The client is made of the services and the status topic of an action, because cancelling needs
    neither the type of the action nor the handle of a goal, which an earlier run took with it.
    """

    def __init__(self, node: Any, name: str, kind: str) -> None:
        from action_msgs.msg import GoalStatusArray
        from action_msgs.srv import CancelGoal

        self.node, self.name, self.cancel_goal = node, name, CancelGoal
        self.goals: Any = {}  # by id
        self.left: Any = set()  # ids of goals that were given up without their terminal status
        self.has_reported = False
        self.found_at = math.inf
        self.seen_at = time.monotonic()
        ros = node.ros
        self.canceller = ros.create_client(CancelGoal, name + "/_action/cancel_goal")
        self.subscription = ros.create_subscription(
            GoalStatusArray, name + "/_action/status", self.take_status, node.quality(latched=True)
        )
        self.sender: Any = None
        try:
            self.kind = type_of(kind, "action")
        except guarded.MissingTypeError as error:
            self.missing = str(error)
            node.problem(name, self.missing)
            return
        self.missing = ""
        self.sender = ros.create_client(self.kind.Impl.SendGoalService, name + "/_action/send_goal")
        self.results = ros.create_client(
            self.kind.Impl.GetResultService, name + "/_action/get_result"
        )

    def settled(self, now: float) -> bool:
        """Whether goals of an earlier run would have been reported by now."""
        return self.has_reported or self.is_matched(now)

    def is_matched(self, now: float) -> bool:
        """Whether the server has been there for long enough to receive requests and answer."""
        if self.canceller.service_is_ready():
            self.seen_at = now
            self.found_at = min(self.found_at, now)
        else:
            self.found_at = math.inf
        return now - self.found_at > MATCHED_WITHIN

    def start(self, uuid: bytes, name: str, content: Any) -> None:
        if self.node.guarding:
            return  # the agent is lost
        if self.missing:
            self.node.say(op="ended", goal=name, status=ABORTED, reason=self.missing)
            return
        request = self.kind.Impl.SendGoalService.Request()
        request.goal_id.uuid = list(uuid)
        filled(request.goal, content)
        goal = self.goals[uuid] = Goal(uuid, name, request)
        self.attend(goal, time.monotonic())

    def withdraw(self, uuid: bytes, number: int) -> None:
        """Cancel a goal, also of an earlier run, and answer whether it has certainly ended."""
        goal = self.goals.setdefault(uuid, Goal(uuid))
        goal.unwanted = True
        goal.questions.append((number, time.monotonic() + CONFIRMED_WITHIN))
        self.attend(goal, time.monotonic())

    def attend_all(self) -> None:
        now = time.monotonic()
        self.is_matched(now)
        for goal in list(self.goals.values()):
            self.attend(goal, now)

    def attend(self, goal: Any, now: float) -> None:
        """Send, cancel or end a goal, as is due."""
        if goal.request is not None and goal.unwanted:
            self.finish(goal, CANCELED, "")
        elif goal.request is not None and self.is_matched(now):
            request, goal.request = goal.request, None
            answer = self.sender.call_async(request)
            answer.add_done_callback(lambda done: self.answered(goal, done.result().accepted))
        elif goal.request is not None and now - goal.began > SERVER_WITHIN:
            self.finish(goal, ABORTED, f"there is no action server on {self.name}")
        elif now - goal.over_at > (RESULT_WITHIN if goal.name else 0.0):
            self.finish(goal, goal.status, "")
        elif goal.request is None and now - self.seen_at > GONE_AFTER:
            self.left.add(goal.uuid)
            self.finish(goal, ABORTED, f"the action server on {self.name} is gone")
        elif (
            goal.unwanted
            and goal.request is None
            and now - goal.cancelled_at >= guarded.CANCEL_AGAIN
        ):
            self.cancel(goal, now)
        for question in list(goal.questions):
            if now > question[1]:
                goal.questions.remove(question)
                self.node.say(op="response", number=question[0], confirmed=False)

    def answered(self, goal: Any, is_accepted: bool) -> None:
        if is_accepted and goal.uuid not in self.goals:  # it was given up before
            goal.name, goal.unwanted = "", True
            self.goals[goal.uuid] = goal
        if is_accepted:
            self.accept(goal, 1)
        else:
            self.finish(goal, ABORTED, f"{self.name} rejected the goal")

    def accept(self, goal: Any, status: int) -> None:
        is_new, goal.status = goal.status == 0, status
        if is_new and goal.name:
            self.node.say(op="accepted", goal=goal.name)
            request = self.kind.Impl.GetResultService.Request()
            request.goal_id.uuid = list(goal.uuid)
            answer = self.results.call_async(request)
            answer.add_done_callback(lambda done: self.take_result(goal, done.result()))
        if is_new and goal.unwanted:
            self.cancel(goal, time.monotonic())

    def take_result(self, goal: Any, result: Any) -> None:
        code = getattr(result.result, "error_code", 0)
        reason = getattr(result.result, "error_msg", "") or (code and f"error code {code}") or ""
        self.finish(goal, result.status or ABORTED, reason)

    def take_status(self, message: Any) -> None:
        self.has_reported = True
        for entry in message.status_list:
            uuid = bytes(entry.goal_info.goal_id.uuid)
            goal = self.goals.get(uuid)
            if goal is None and self.is_left(uuid) and entry.status in ACTIVE:
                goal = self.goals[uuid] = Goal(uuid)
            if goal is None:
                continue
            if entry.status in ACTIVE:
                self.accept(goal, entry.status)
            elif goal.over_at == math.inf:
                goal.status, goal.over_at = entry.status, time.monotonic()

    def is_left(self, uuid: bytes) -> bool:
        """Whether a goal was given up, or left by an earlier run. One that is younger than this
        process is its successor's, except before `ready`: the clock may have been set back.
        """
        if uuid in self.left:
            return True
        sent_at = int.from_bytes(uuid[len(PREFIX) :], "big")
        return uuid.startswith(PREFIX) and (self.node.starting or sent_at < self.node.began)

    def cancel(self, goal: Any, now: float) -> None:
        if not self.canceller.service_is_ready():
            return  # in the next round
        goal.cancelled_at = now
        request = self.cancel_goal.Request()
        request.goal_info.goal_id.uuid = list(goal.uuid)
        answer = self.canceller.call_async(request)
        answer.add_done_callback(lambda done: self.cancelled(goal, done.result().return_code))

    def cancelled(self, goal: Any, code: int) -> None:
        now = time.monotonic()
        may_arrive = goal.name and goal.status == 0 and now - goal.began < LOST_AFTER
        if code in (UNKNOWN_GOAL, GOAL_TERMINATED) and goal.over_at == math.inf and not may_arrive:
            if code == UNKNOWN_GOAL:
                self.left.add(goal.uuid)
            goal.status, goal.over_at = CANCELED, now

    def finish(self, goal: Any, status: int, reason: str) -> None:
        if self.goals.pop(goal.uuid, None) is None:
            return
        while goal.questions:
            self.node.say(op="response", number=goal.questions.pop()[0], confirmed=True)
        if goal.name:
            self.node.say(op="ended", goal=goal.name, status=status, reason=reason)


class TopicSubscription:
    """A topic, and the subscriptions that receive it from publishers of any quality of service.

    Best effort and volatile receives from all. A latched topic has a second one that is reliable
    and transient local, which alone receives what was published before; the first one is dropped
    while all publishers are transient local, and reliable while all publishers are reliable.
    """

    def __init__(self, node: Any, topic: str, kind: Any) -> None:
        self.node, self.topic, self.kind = node, topic, kind
        self.period, self.due = 0.0, 0.0
        self.is_forwarded = self.is_latched = False
        self.volatile: Any = None
        self.latched: Any = None
        self.reliable = False

    def open(self, *, latched: bool) -> None:
        if self.volatile is None:
            self.volatile = self.made(self.node.quality(reliable=False))
        if latched and self.latched is None:
            self.is_latched = True
            self.latched = self.made(self.node.quality(latched=True))

    def made(self, quality: Any) -> Any:
        return self.node.ros.create_subscription(self.kind, self.topic, self.take, quality)

    def adapt(self) -> None:
        """Fit the publishers that are there now."""
        if not self.is_latched:
            return
        qos = self.node.qos
        others = [each.qos_profile for each in self.node.publishers_of(self.topic)]
        if not others:
            return
        reliable = all(each.reliability == qos.ReliabilityPolicy.RELIABLE for each in others)
        durable = all(each.durability == qos.DurabilityPolicy.TRANSIENT_LOCAL for each in others)
        former = self.volatile
        if durable:
            self.volatile = None
        elif self.volatile is None or self.reliable != reliable:
            self.volatile = self.made(self.node.quality(reliable=reliable))
            self.reliable = reliable
        if former is not None and former is not self.volatile:
            self.node.ros.destroy_subscription(former)

    def take(self, message: Any) -> None:
        now = time.monotonic()
        if self.topic == self.node.settings["odom"]:
            self.node.standstill.measure(message, now)
        if self.is_forwarded and now >= self.due:
            self.due = now + self.period
            self.node.say(op="publish", topic=self.topic, content=guarded.plain(message))


class Ros2Node(guarded.GuardedNode):
    """One connection to the agent, one node."""

    def __init__(self, connection: Any, settings: Any) -> None:
        super().__init__(connection)
        import rclpy
        from rclpy import executors, node, qos, signals

        self.settings = settings  # driving, odom, action, kind
        self.qos = qos
        self.kinds: Any = {}  # type by publisher's topic
        self.subscriptions: Any = {}
        self.clients: Any = {}
        self.waiting: Any = []  # (topic, message, deadline) without a subscriber
        self.questions: Any = queue.Queue()
        self.moved_at: Any = None  # monotonic time of the last velocity other than zero
        self.ended = threading.Event()
        self.guarding = self.is_attending = False
        self.starting, self.began = True, time.time_ns()
        self.peers_due = 0.0
        rclpy.init(
            args=["--ros-args", "--disable-external-lib-logs"],
            signal_handler_options=signals.SignalHandlerOptions.NO,
        )
        self.ros = node.Node(
            f"telepresence_agent_{os.getpid()}",
            enable_rosout=False,
            start_parameter_services=False,
        )
        self.executor = executors.SingleThreadedExecutor()
        self.executor.add_node(self.ros)
        self.subscription(settings["odom"], "nav_msgs/Odometry").open(latched=False)
        self.actions: Any = {}
        if settings["action"]:
            name = settings["action"]
            self.actions[name] = OwnedGoals(self, name, settings["kind"])

    def quality(self, *, latched: bool = False, reliable: bool = True, depth: int = 10) -> Any:
        """Return a quality of service; `latched` keeps the last message for later subscribers."""
        reliability, durability = self.qos.ReliabilityPolicy, self.qos.DurabilityPolicy
        return self.qos.QoSProfile(
            depth=1 if latched else depth,
            reliability=reliability.RELIABLE if reliable else reliability.BEST_EFFORT,
            durability=durability.TRANSIENT_LOCAL if latched else durability.VOLATILE,
        )

    def run(self) -> None:
        """Serve the agent until it is gone."""
        for number in (signal.SIGTERM, signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGTERM)):
            signal.signal(number, self.end)
        watching = threading.Thread(target=self.watch, daemon=True)
        self.start(self.spin, self.answer_questions)
        watching.start()
        self.obey_orders()
        self.ended.set()
        watching.join()

    def end(self, *_: Any) -> None:
        """Begin to guard; a guard that is ended has a successor (node_bus.py, `NodeBus._take`)."""
        if self.guarding:
            os._exit(0)
        self.ended.set()

    def spin(self) -> None:
        while True:
            try:
                self.executor.spin_once()
            except Exception:  # a callback's; the guard needs the others
                traceback.print_exc()

    def later(self, work: Any, *words: Any) -> None:
        """Run something on the executor's thread."""
        self.executor.create_task(work, *words)

    # --- orders of the agent ----------------------------------------------------------------------

    def do_advertise(self, topic: str, kind: str, *, drives: bool, latch: bool = False) -> None:
        try:
            made = type_of(kind, "msg")
        except guarded.MissingTypeError as error:
            self.problem(topic, str(error))
            return
        former = self.publishers.get(topic)
        if former is not None:
            if self.kinds[topic] is made:
                return
            self.moved_at = None
            self.later(self.ros.destroy_publisher, former)
        # of velocities, only the newest is sent again to a subscriber that missed it
        quality = self.quality(latched=latch, depth=1 if drives else 10)
        self.kinds[topic] = made
        self.publishers[topic] = self.ros.create_publisher(made, topic, quality)

    def do_publish(self, topic: str, content: Any) -> None:
        if topic in self.publishers:
            message = filled(self.kinds[topic](), content)
            self.later(self.publish_soon, (topic, message, time.monotonic() + guarded.HEARING))

    def publish_soon(self, *new: Any) -> None:
        """Publish messages that have a subscriber; without one, they would be lost."""
        waiting, self.waiting = [*self.waiting, *new], []
        for topic, message, deadline in waiting:
            publisher = self.publishers.get(topic)
            if publisher is None:
                continue
            if publisher.get_subscription_count() or time.monotonic() > deadline:
                publisher.publish(message)
            else:
                self.waiting.append((topic, message, deadline))

    def do_drive(self, topic: str, content: Any, *, moving: bool, at: float) -> None:
        if moving and (self.guarding or time.monotonic() - at > guarded.OLDEST):
            return  # the agent is lost, or this process has hung
        self.publishers[topic].publish(self.stamped(filled(self.kinds[topic](), content)))
        self.moved_at = time.monotonic() if moving else None

    def subscribe(self, topic: str, kind: str, *, period: float, latched: bool) -> None:
        subscription = self.subscription(topic, kind)
        subscription.period, subscription.is_forwarded = period, True
        subscription.open(latched=latched)

    def subscription(self, topic: str, kind: str) -> Any:
        if topic not in self.subscriptions:
            self.subscriptions[topic] = TopicSubscription(self, topic, type_of(kind, "msg"))
        return self.subscriptions[topic]

    def do_ask(self, number: int) -> None:
        self.questions.put(number)

    def answer_questions(self) -> None:
        has_bystanders = False
        while True:
            number = self.questions.get()
            began = time.monotonic()
            while not self.acknowledged():
                is_over = has_bystanders or time.monotonic() - began > BYSTANDER
                if is_over and self.subscriber_count() > 1:
                    has_bystanders = True
                    break
                time.sleep(0.002)
            else:
                has_bystanders = False
            self.say(op="response", number=number)

    def subscriber_count(self) -> int:
        publisher = self.publishers.get(self.settings["driving"])
        return publisher.get_subscription_count() if publisher is not None else 0

    def acknowledged(self) -> bool:
        """Whether every reliable subscriber has acknowledged the last velocity."""
        from rclpy.duration import Duration

        publisher = self.publishers.get(self.settings["driving"])
        try:
            return publisher is None or publisher.wait_for_all_acked(Duration())
        except RuntimeError:  # the publisher was destroyed
            return True

    def do_graph(self, number: int, driving: str) -> None:
        threading.Thread(target=self.describe_graph, args=(number, driving), daemon=True).start()

    def describe_graph(self, number: int, driving: str) -> None:
        """Answer with the types, publishers and subscribers of others by topic.

        The topic of velocities has its subscribers' types: a planner may publish another one there.
        """
        found: Any = {}
        for topic, _ in self.ros.get_topic_names_and_types():
            publishers, subscribers = self.publishers_of(topic), self.subscribers_of(topic)
            typed = subscribers if topic == driving and subscribers else publishers + subscribers
            if typed:
                kinds = sorted({each.topic_type.replace("/msg/", "/") for each in typed})
                found[topic] = [kinds, len(subscribers), len(publishers)]
        self.say(op="response", number=number, topics=found)

    def publishers_of(self, topic: str, *, own: bool = False) -> Any:
        found, name = self.ros.get_publishers_info_by_topic(topic), self.ros.get_name()
        return [each for each in found if (each.node_name == name) == own]

    def subscribers_of(self, topic: str) -> Any:
        found, name = self.ros.get_subscriptions_info_by_topic(topic), self.ros.get_name()
        return [each for each in found if each.node_name != name]

    def answer_of(self, service: str, kind: str, arguments: Any, *, docking: int = 0) -> Any:
        try:
            made = type_of(kind, "srv")
        except guarded.MissingTypeError as error:
            return {"problem": str(error), "absent": True}
        if service not in self.clients:
            self.clients[service] = self.ros.create_client(made, service)
        client, deadline = self.clients[service], time.monotonic() + SERVER_WITHIN
        while not client.service_is_ready():
            if time.monotonic() > deadline:
                return {"problem": "there is no such service", "absent": True}
            time.sleep(PERIOD)
        if docking and self.guarding:
            return {"problem": "the agent is lost", "absent": True}
        answers: Any = queue.Queue()
        self.later(self.send, client, filled(made.Request(), arguments), answers.put)
        is_cancel = service == self.docking.cancel_service
        within = SERVER_WITHIN if is_cancel else guarded.ANSWERED_WITHIN
        return self.received(answers, client, within)

    def received(self, answers: Any, client: Any, within: float) -> Any:
        """Wait for an answer, which a server that has ended, or was restarted, never sends."""
        began = seen_at = now = time.monotonic()
        while now - began < within and now - seen_at < GONE_AFTER:
            try:
                return {"values": guarded.plain(answers.get(timeout=PERIOD))}
            except queue.Empty:
                now = time.monotonic()
            if client.service_is_ready():
                seen_at = now
        return {"problem": "no answer"}

    def send(self, client: Any, request: Any, take: Any) -> None:
        client.call_async(request).add_done_callback(lambda done: take(done.result()))

    def do_goal(self, action: str, uuid: str, goal: str, content: Any) -> None:
        self.later(self.actions[action].start, bytes.fromhex(uuid), goal, content)

    def do_cancel(self, number: int, action: str, uuid: str) -> None:
        self.later(self.actions[action].withdraw, bytes.fromhex(uuid), number)

    # --- the guard --------------------------------------------------------------------------------

    @property
    def goals(self) -> Any:
        return [goal for action in self.actions.values() for goal in list(action.goals.values())]

    def watch(self) -> None:
        try:
            self.say(op="lost", reason=self.serve())
        except Exception as error:  # after any error, the guard stops the robot
            traceback.print_exc()
            self.say(op="lost", reason=f"the node of ROS 2 failed: {error!r}")
        self.guard()

    def serve(self) -> str:
        """Monitor the connection; return why it has ended."""
        if not self.cancel_leftovers():
            return "a goal of an earlier connection does not end when cancelled"
        self.starting = False
        self.say(op="ready")
        while not self.ended.wait(PERIOD):
            now = time.monotonic()
            self.look_after(now)
            if now - self.beaten_at > guarded.HEARTBEAT and (self.goals or self.docking.is_active):
                return f"the agent did not respond for {guarded.HEARTBEAT} s while an action ran"
        return "the connection was closed"

    def cancel_leftovers(self) -> bool:
        """Cancel the goals of an earlier run; return whether they have ended."""
        now = began = time.monotonic()
        while now - began < DISCOVERY and not all(a.settled(now) for a in self.actions.values()):
            time.sleep(0.02)
            now = time.monotonic()
        if not self.goals:
            return True
        while time.monotonic() - now < LEFTOVERS and not self.ended.is_set():
            if not self.may_move(now):
                return True
            self.stop_wheels()
            self.attend()
            time.sleep(PERIOD)
        return False

    def guard(self) -> None:
        """Cancel all goals and brake until the robot is measured at rest; then exit."""
        self.guarding = True
        began, was_moving = time.monotonic(), self.moved_at is not None
        self.attempt(self.disown_goals)
        if self.goals or self.docking.is_active or was_moving:
            self.brake_until_rest(began)
        self.link.drain(FAREWELL)
        os._exit(0)  # rclpy's threads would wait

    def disown_goals(self) -> None:
        settled = threading.Event()
        self.later(settled.set)  # behind a goal that the agent has just sent
        settled.wait(MEASURED_WITHIN)
        for goal in self.goals:
            goal.unwanted = True

    def brake_until_rest(self, began: float) -> None:
        """Brake, and cancel what may move the robot, despite any errors."""
        is_over = False
        while not is_over:
            for work in (self.stop_wheels, self.attend, lambda: self.cancel_docking(own=True)):
                self.attempt(work)
            time.sleep(PERIOD)
            is_over = self.attempt(lambda: not self.may_move(began))

    def may_move(self, since: float) -> bool:
        """Whether a goal of ours may run, or the robot is not at rest."""
        now = time.monotonic()
        measured_at = self.standstill.measured_at
        if self.goals or self.docking.is_active:
            return now - max(since, measured_at) < FORGOTTEN_AFTER
        if now - measured_at > MEASURED_WITHIN:
            return now - since < MEASURED_WITHIN
        return not self.standstill.is_proved

    def stop_wheels(self) -> None:
        """Publish a zero velocity; before the agent has advertised any, of the type that
        graph.chosen_stamped would choose: of two, Twist.
        """
        topic = self.settings["driving"]
        if topic not in self.publishers:
            kinds = {each.topic_type for each in self.subscribers_of(topic)}
            for kind in ("geometry_msgs/Twist", "geometry_msgs/TwistStamped"):
                if kind.replace("/", "/msg/") in kinds:
                    self.do_advertise(topic, kind, drives=True)
                    break
        if topic in self.publishers:
            self.publishers[topic].publish(self.stamped(self.kinds[topic]()))

    def stamped(self, message: Any) -> Any:
        """Return a velocity, stamped now: a base may refuse an old one."""
        if hasattr(message, "header"):
            message.header.stamp = self.ros.get_clock().now().to_msg()
            message.header.frame_id = message.header.frame_id or "base_link"
        return message

    def look_after(self, now: float) -> None:
        if self.moved_at is not None and now - self.moved_at > guarded.SILENCE:
            self.moved_at = None
            self.stop_wheels()
        self.report_listeners(self.settings["driving"], self.subscriber_count())
        self.cancel_docking(own=False)
        self.attend()

    def attend(self) -> None:
        if not self.is_attending:  # else the executor is late
            self.is_attending = True
            self.later(self.attend_now)

    def attend_now(self) -> None:
        self.is_attending = False
        for action in self.actions.values():
            action.attend_all()
        self.publish_soon()
        now = time.monotonic()
        if now >= self.peers_due:
            self.peers_due = now + PEERS_PERIOD
            for subscription in list(self.subscriptions.values()):
                subscription.adapt()
            for topic in list(self.publishers):
                self.check_subscribers(topic)

    def check_subscribers(self, topic: str) -> None:
        """Report a subscriber whose quality of service keeps it from receiving our messages."""
        own = self.publishers_of(topic, own=True)
        for each in self.subscribers_of(topic) if own else ():
            fits, why = self.qos.qos_check_compatible(own[0].qos_profile, each.qos_profile)
            if fits == self.qos.QoSCompatibility.ERROR:
                qos = why.replace("ERROR: ", "").strip("; ")
                where = f"{topic} does not reach {each.node_name}"
                self.problem(topic, f"{where}: incompatible QoS ({qos}); change it there")
                return
        self.problem(topic, "")


def main() -> int:
    """Connect to the agent: arguments are its port and the settings, the password is on stdin."""
    connection = guarded.connect()
    alarm: Any = getattr(signal, "alarm", lambda _: None)  # not on Windows
    alarm(STARTED_WITHIN)
    try:
        node = Ros2Node(connection, json.loads(sys.argv[2]))
    except ImportError as error:
        return guarded.refuse(
            connection,
            f"rclpy is not installed for {sys.executable} ({error}): source a ROS 2 installation,"
            " set python to the interpreter that has it, or install the extra ros2",
        )
    except guarded.MissingTypeError as error:
        return guarded.refuse(connection, str(error))
    except RuntimeError as error:  # rclpy's RCLError
        return guarded.refuse(connection, f"ROS 2 cannot be started with {sys.executable}: {error}")
    alarm(0)
    node.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
