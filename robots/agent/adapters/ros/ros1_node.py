"""A node of ROS 1 that the agent controls over a loopback connection: one JSON object a line,
messages as objects.

It runs in the Python that ROS was built for, which is not the agent's (Noetic: 3.8; Debian 12: 3.11
of the system), and so imports nothing of ours and is written for Python 3.6. rospy can register a
node only once per process and cannot recover from a lost master, so the agent restarts this process
to reconnect.

    agent -> node   advertise, unadvertise, publish, drive (a velocity: after SILENCE without
    another the robot is stopped),
                    ask (do the subscribers of velocities respond?),
                    graph (and which of the `old` nodes run that the master has forgotten?),
                    guard (what to cancel and stop), beat (the agent's heartbeat),
                    subscribe, call, docking_ended
    node -> agent   ready, publish, response, listeners, gone, lost

TCPROS has no acknowledgements: a hung subscriber buffers velocities and executes them later. Before
each velocity the node therefore calls getPid on every subscriber. A subscriber that does not answer
within 1 s is disconnected (TCP reset) and receives a zero velocity when it reconnects.

The node is also the guard of the robot's own navigation. It has its own process group and outlives
the agent: when the heartbeat stops for HEARTBEAT seconds, or the connection closes, it cancels all
goals of ours and the docking, and sends zero velocities until they have ended and the robot is
measured at rest. Then it exits, or waits for the agent to continue.
"""

import base64
import functools
import http.client
import json
import os
import queue
import socket
import struct
import sys
import threading
import time
import xmlrpc.client
from typing import Any

if __package__:
    from robots.agent.adapters.ros import guarded_node as guarded
else:  # as a program, in a Python that does not have ours
    import guarded_node as guarded  # type: ignore[import-not-found,no-redef]

GLANCE = 0.05
MASTER_PERIOD = 0.3
MASTER_TIME = 1.0
LIVES_WITHIN = 1.0
SENDING = 16 << 10
UNACKNOWLEDGED = 1000  # milliseconds
MAX_QUEUED = 500  # messages without a subscriber
FAREWELL = 0.5  # seconds for the last lines to the agent
GUARD_PERIOD = 0.02
STALE = 2.0  # seconds without odometry, after which a standstill cannot be measured
STARTING = 1.0  # seconds in which a new node learns what an earlier one has left
MOVES_WITHIN = 1.0  # seconds from a velocity or a goal until the robot is measured to move
REPLACED = 1.0  # seconds that a newer node has published velocities, before this one exits
SERVER_GONE = 1.0  # seconds without a connection to the action server's status
NODE_NAME = "telepresence_"
OURS = "telepresence-"  # with which the ids of our goals begin
ENDED = {
    2,
    3,
    4,
    5,
    8,
}  # actionlib_msgs/GoalStatus: preempted, succeeded, aborted, rejected, recalled


class TimeoutTransport(xmlrpc.client.Transport):
    """HTTP that waits LIVES_WITHIN for an answer."""

    def make_connection(self, host: Any) -> Any:
        connection = super().make_connection(host)
        connection.timeout = LIVES_WITHIN
        return connection


class MasterError(Exception):
    """The master refuses a call."""


class Master:
    """The master's API, with a time-out; not to be shared between threads."""

    def __init__(self, uri: str, caller: str = "/telepresence") -> None:
        self.proxy = xmlrpc.client.ServerProxy(uri, transport=TimeoutTransport())
        self.caller = caller

    def __getattr__(self, method: str) -> Any:
        def call(*arguments: Any) -> Any:
            code, text, value = getattr(self.proxy, method)(self.caller, *arguments)
            if code != 1:
                raise MasterError(text)
            return value

        return call


class OtherNode:
    """Another node, by its slave API, and whether it lives."""

    def __init__(self, uri: str) -> None:
        self.proxy = xmlrpc.client.ServerProxy(uri, transport=TimeoutTransport())
        self.has_answered = False

    def lives(self) -> bool:
        """Tell whether it answers; one that never did cannot be reached from here, and is believed
        to.
        """
        try:
            self.proxy.getPid("/telepresence")
        except (OSError, http.client.HTTPException, xmlrpc.client.Error):
            return not self.has_answered
        self.has_answered = True
        return True


class Node:
    """One connection to the agent, one node."""

    def __init__(self, connection: Any) -> None:
        import genpy
        import roslib.message
        import rospy
        import rospy.impl.tcpros_base

        self.genpy, self.rospy, self.roslib = genpy, rospy, roslib
        self.link = guarded.Link(connection)
        self.say = self.link.say
        self.publishers: Any = {}
        self.waiting: Any = {}  # topic to the messages that have no subscriber yet
        self.subscribers: Any = []
        self.driving = ""  # the topic of velocities
        self.was_alone = False  # at the last look no listener of velocities had connected
        self.driven: Any = None  # (topic, monotonic time) while the robot may be moving
        self.unknown = MasterError
        self.unreachable = (OSError, http.client.HTTPException, xmlrpc.client.Error, MasterError)
        self.uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
        # one for each thread: it has one connection
        self.new_master: Any = functools.partial(Master, self.uri)
        self.own_master: Any = self.new_master
        self.master = self.new_master()
        self.master_pid = self.master.getPid()
        self.questions: Any = queue.Queue(MAX_QUEUED)
        self.listeners: Any = {}  # who listens for velocities, by the name of its node
        self.others: Any = {}  # slave API by the name of the node
        self.refused: Any = {}  # by topic: by node the type that it wants
        name = NODE_NAME + str(int(time.time() * 1e6))  # a newer node has a larger number
        rospy.init_node(name, disable_signals=True, disable_rosout=True)
        self.server = rospy.impl.tcpros_base._tcpros_server
        self.accept, self.server.topic_connection_handler = (
            self.server.topic_connection_handler,
            self.connected,
        )
        self.guard: Any = Guard(self)

    def run(self) -> None:
        """Do what the agent requests until it is gone, then guard the robot."""
        # the agent takes anything else that comes first for a failure
        self.say(op="ready", node=self.rospy.get_name())
        for work in (
            self.link.write,
            self.watch_wheels,
            self.watch_master,
            self.answer_questions,
            self.guard.run,
        ):
            threading.Thread(target=work, daemon=True).start()
        try:
            for line in self.link.connection.makefile("r", encoding="utf-8"):
                self.guard.beaten_at = time.monotonic()
                order = json.loads(line)
                getattr(self, "do_" + order.pop("op"))(**order)
        except (OSError, ValueError):
            pass  # the connection ended, perhaps in the middle of a line
        finally:
            self.leave()

    def leave(self) -> None:
        """Stop the robot, and return when nothing of ours can move it any more."""
        self.stand()
        self.guard.finish()

    def do_beat(self) -> None:
        """The agent's control loop runs."""

    def do_guard(self, **settings: Any) -> None:
        self.guard.begin(**settings)

    def do_docking_ended(self) -> None:
        self.guard.docking.is_active = False

    def do_advertise(self, topic: str, kind: str, *, latch: bool, drives: bool = False) -> None:
        if topic in self.publishers:
            return
        message = self.roslib.message.get_message_class(kind)
        if message is None:
            self.say(op="lost", reason="ROS has no message type " + kind + " here")
            return
        if drives:
            self.driving = topic
        greeting = StandingPublisher(message) if drives else None
        self.publishers[topic] = self.rospy.Publisher(
            topic, message, greeting, queue_size=2, latch=latch, tcp_nodelay=True
        )

    def do_unadvertise(self, topic: str) -> None:
        publisher = self.publishers.pop(topic, None)
        if publisher is not None:
            self.driven = None
            self.refused.pop(topic, None)
            publisher.unregister()

    def connected(self, connection: Any, address: Any, header: Any) -> Any:
        """Take somebody who has come to hear a topic; rospy says why not."""
        topic, name = header.get("topic"), header.get("callerid")
        if topic == self.driving:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SENDING)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            if hasattr(socket, "TCP_USER_TIMEOUT"):
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNACKNOWLEDGED)
        problem = self.accept(connection, address, header)
        wanting = self.refused.setdefault(topic, {})
        wanting.pop(name, None)
        if problem:
            wanting[name] = header.get("type", "")
        return problem

    def do_ask(self, number: int) -> None:
        try:
            self.questions.put_nowait(number)
        except queue.Full:
            pass  # the agent takes no answer for a lost connection

    def answer_questions(self) -> None:
        master = self.new_master()
        while True:
            number = self.questions.get()
            self.drop_the_dead(master)
            self.say(op="response", number=number)

    def drop_the_dead(self, master: Any) -> None:
        """Ask everybody who listens for velocities, and let go of who does not answer."""
        publisher = self.publishers.get(self.driving)
        for connection in list(publisher.impl.connections) if publisher is not None else []:
            name = connection.endpoint_id
            try:
                if name not in self.listeners:
                    self.listeners[name] = OtherNode(master.lookupNode(name))
                lives = self.listeners[name].lives()
            except self.unreachable:
                lives = True  # it is no node of this master's any more; its connection will say so
            if not lives:
                self.listeners.pop(name, None)
                publisher.impl.remove_connection(connection)
                connection.close()

    def do_graph(self, number: int, driving: str, old: Any) -> None:
        threading.Thread(target=self.look_round, args=(number, driving, old), daemon=True).start()

    def look_round(self, number: int, driving: str, old: Any) -> None:
        found: Any = {}
        nodes: Any = {}
        try:
            master, own = self.new_master(), self.rospy.get_name()
            speaking, listening, serving = master.getSystemState()
            kinds = dict(master.getTopicTypes())  # after it: whoever has just come has a type
            for which, topics in ((2, speaking), (1, listening)):
                for topic, names in topics:
                    entry = found.setdefault(
                        topic, [[kinds[topic]] if topic in kinds else [], 0, 0]
                    )
                    entry[which] += len([name for name in names if name != own])
            if self.driving:  # the master knows a topic by the type of who published last: ours
                wanted = sorted(set(self.refused.get(driving, {}).values()) - {""})
                entry = found.setdefault(driving, [[], 0, 0])
                entry[0] = wanted
                self.call_again(bool(entry[1]) and not wanted)
            running_names = {
                name for each in (speaking, listening, serving) for _, at in each for name in at
            }
            self.look_up(master, running_names - {own})
            nodes = {
                "nodes": self.others,
                "forgotten": running(
                    {name: old[name] for name in old if name not in running_names}
                ),
            }
        except self.unreachable:
            pass  # watch_master reports it
        self.say(op="response", number=number, topics=found, **nodes)

    def call_again(self, wanted: bool) -> None:
        """Have the master tell who listens once more that we publish velocities, if nobody has come
        since the last look: of two lists of publishers that reach a node at once, rospy takes the
        one that came last, which need not be the newest (rospy/impl/registration.py, RegManager).
        """
        publisher, topic = self.publishers.get(self.driving), self.driving
        alone = publisher is not None and wanted and not publisher.get_num_connections()
        if alone and self.was_alone:
            name, uri = self.rospy.get_name(), self.rospy.get_node_uri()
            self.own_master(caller=name).registerPublisher(topic, publisher.type, uri)
        self.was_alone = alone

    def look_up(self, master: Any, names: Any) -> None:
        """Know the slave API of each of these nodes, and of no others."""
        known = {name: uri for name, uri in self.others.items() if name in names}
        for name in names - set(known):
            try:
                known[name] = master.lookupNode(name)
            except self.unknown:
                pass  # it has just ended
        self.others = known

    def do_publish(self, topic: str, content: Any) -> None:
        """Publish once there is a subscriber: what rospy publishes before the first one has
        connected is lost.
        """
        publisher, waiting = self.publishers[topic], self.waiting.setdefault(topic, [])
        message = self.filled(publisher.data_class(), content)
        self.guard.published(topic, message)
        if not waiting and publisher.get_num_connections():
            publisher.publish(message)
            return
        if len(waiting) >= MAX_QUEUED:
            return
        waiting.append(message)
        if len(waiting) == 1:
            threading.Thread(
                target=self.hand_over, args=(topic, publisher, waiting), daemon=True
            ).start()

    def hand_over(self, topic: str, publisher: Any, waiting: Any) -> None:
        deadline = time.monotonic() + guarded.HEARING
        while not publisher.get_num_connections() and time.monotonic() < deadline:
            time.sleep(GLANCE)
        while waiting:
            if publisher.get_num_connections() and self.guard.permits(topic):
                publisher.publish(waiting[0])
            else:
                self.guard.lost(topic)
            waiting.pop(0)

    def do_drive(self, topic: str, content: Any, *, moving: bool, at: float) -> None:
        if moving and time.monotonic() - at > guarded.OLDEST:  # this process has hung meanwhile
            return
        publisher = self.publishers[topic]
        publisher.publish(self.filled(publisher.data_class(), content))
        if moving:
            self.guard.starting = False
            self.guard.act()
        self.driven = (topic, time.monotonic()) if moving else None

    def do_subscribe(self, topic: str, kind: str, period: float) -> None:
        message = self.roslib.message.get_message_class(kind)
        if message is None:
            self.say(op="lost", reason="ROS has no message type " + kind + " here")
            return
        due = [0.0]

        def heard(content: Any) -> None:
            now = time.monotonic()
            if now < due[0]:
                return
            due[0] = now + period
            self.say(op="publish", topic=topic, content=guarded.plain(content))

        self.subscribers.append(
            self.rospy.Subscriber(topic, message, heard, queue_size=2, tcp_nodelay=True)
        )

    def do_call(self, number: int, service: str, kind: str, arguments: Any = None) -> None:
        docking = self.guard.called(service)
        threading.Thread(
            target=self.call, args=(number, docking, service, kind, arguments or {}), daemon=True
        ).start()

    def call(self, number: int, docking: int, service: str, kind: str, arguments: Any) -> None:
        answer = self.answer_of(service, kind, arguments, docking)
        self.guard.docking.answered(docking, answer)
        self.say(op="response", number=number, **answer)

    def answer_of(self, service: str, kind: str, arguments: Any, docking: int) -> Any:
        """Call a service; `docking` is the number of a call that docks."""
        try:
            self.rospy.wait_for_service(service, timeout=2.0)
            if docking and self.guard.alone:
                return {"problem": "the agent is lost", "absent": True}
            proxy = self.rospy.ServiceProxy(service, self.roslib.message.get_service_class(kind))
            return {"values": guarded.plain(proxy(**arguments))}
        except self.rospy.ServiceException as error:
            return {"problem": str(error) or type(error).__name__}
        except self.rospy.ROSException as error:
            return {"problem": str(error) or type(error).__name__, "absent": True}

    def watch_wheels(self) -> None:
        """Stop a robot whose agent is stuck, and tell the agent how many hear what it says of
        motion.
        """
        told = None
        while True:
            time.sleep(GLANCE)
            publisher = self.publishers.get(self.driving)
            now = (self.driving, publisher.get_num_connections() if publisher is not None else 0)
            if now != told:
                told = now
                self.say(op="listeners", topic=now[0], count=now[1])
            driven = self.driven
            if driven is not None and time.monotonic() - driven[1] > guarded.SILENCE:
                self.stand()

    def publish_zero(self) -> None:
        publisher = self.publishers.get(self.driving)
        if publisher is not None:
            publisher.publish(standing(publisher.data_class))

    def stand(self) -> None:
        driven, self.driven = self.driven, None
        if driven is not None:
            publisher = self.publishers[driven[0]]
            publisher.publish(standing(publisher.data_class))
            time.sleep(GLANCE)

    def watch_master(self) -> None:
        """End when the master is gone or is another one: it knows nothing of this node then.

        A master in a container has the same process id after a restart.
        """
        problem, was_known = "", False
        while not problem:
            time.sleep(MASTER_PERIOD)
            try:
                known = self.is_known()
                if self.master.getPid() != self.master_pid or (was_known and not known):
                    problem = "the ROS master at " + self.uri + " was restarted"
                was_known = known
            except self.unreachable as error:
                problem = "the ROS master at " + self.uri + " is gone: " + str(error)
        self.say(op="lost", reason=problem)
        self.leave()
        self.exit(1)

    def exit(self, code: int) -> None:
        """End this process: rospy's threads would wait for a master that may be gone."""
        self.link.drain(FAREWELL)
        os._exit(code)

    def is_known(self) -> bool:
        """Tell whether the master knows this node."""
        try:
            self.master.lookupNode(self.rospy.get_name())
        except self.unknown:
            return False
        return True

    def filled(self, message: Any, content: Any) -> Any:
        """Return a message with the fields that an object names."""
        for name, value in content.items():
            now = getattr(message, name)
            if isinstance(now, self.genpy.TVal):
                now.secs, now.nsecs = value["secs"], value["nsecs"]
            elif isinstance(value, dict):
                self.filled(now, value)
            elif isinstance(value, list) and value and isinstance(value[0], dict):
                kind = message._slot_types[message.__slots__.index(name)].partition("[")[0]
                made = self.roslib.message.get_message_class(kind)
                setattr(message, name, [self.filled(made(), each) for each in value])
            elif isinstance(value, str) and isinstance(now, bytes):
                setattr(message, name, base64.b64decode(value))
            else:
                setattr(message, name, value)
        return message


class Guard:
    """Stops what the robot's own navigation does for the agent, when the agent is lost.

    Two facts decide: `alone`, whether the agent's heartbeat has stopped, and `busy`, what of ours
    has not ended: goals in the status of the action server that have our prefix, goals that were
    sent and are not listed yet, and a docking. A goal of an earlier node is cancelled in any case.
    A robot that moves for none of these, by a joystick for example, is left alone.
    """

    def __init__(self, node: Any) -> None:
        self.node = node
        self.action = ""
        self.standstill, self.docking = guarded.Standstill(), guarded.DockingCalls()
        self.beaten_at = self.began_at = time.monotonic()
        self.closed = False  # the agent will not continue
        self.starting = False  # goals of an earlier node are being ended
        self.sent: Any = {}  # our goals that have not ended: whether they were listed
        self.found: Any = {}  # goals of earlier nodes that have not ended
        self.cancelled_at = 0.0
        self.dock_call: Any = None
        self.acted_at = time.monotonic()
        self.brakes = False  # the robot moves, or is about to, for the agent or for a goal of ours
        self.server_seen_at: Any = None
        self.status: Any = None
        self.publisher: Any = None
        self.rest = threading.Event()

    def begin(self, **settings: Any) -> None:
        """Take what to guard, and end what an earlier node has left."""
        from actionlib_msgs.msg import GoalID, GoalStatusArray
        from nav_msgs.msg import Odometry

        rospy = self.node.rospy
        self.standstill.linear, self.standstill.angular = settings["linear"], settings["angular"]
        self.docking.begin(settings["docks"], settings["cancel_dock"])
        self.starting, self.began_at = True, time.monotonic()
        rospy.Subscriber(settings["odom"], Odometry, self.measured, queue_size=2, tcp_nodelay=True)
        if settings["kind"] == "move_base":
            self.action, self.kind_of_id = settings["action"], GoalID
            self.publisher = rospy.Publisher(self.action + "/cancel", GoalID, queue_size=10)
            self.status = rospy.Subscriber(self.action + "/status", GoalStatusArray, self.listed)

    @property
    def alone(self) -> bool:
        return self.closed or time.monotonic() - self.beaten_at > guarded.HEARTBEAT

    @property
    def busy(self) -> bool:
        return bool(self.found or self.sent or self.docking.is_active)

    def permits(self, topic: str) -> bool:
        """Return whether a message that waited may still be published: a goal only for an agent
        that lives.
        """
        return topic != self.action + "/goal" or not self.alone

    def published(self, topic: str, message: Any) -> None:
        if self.action and topic == self.action + "/goal":
            self.sent[message.goal_id.id] = False
            self.starting = False
            self.act()

    def lost(self, topic: str) -> None:
        """Take it that a message was not published: a goal then never runs."""
        if topic == self.action + "/goal":
            self.sent.clear()
            self.node.say(op="gone")

    def called(self, service: str) -> int:
        """Take a call of a service; return its number if it docks, else 0."""
        number: int = self.docking.called(service)
        if number:
            self.starting = False
            self.act()
        return number

    def act(self) -> None:
        """Take that the robot moves, or is about to, on our behalf: it has to come to rest."""
        self.acted_at, self.brakes = time.monotonic(), True

    def measured(self, odometry: Any) -> None:
        self.standstill.measure(odometry, time.monotonic())

    def listed(self, message: Any) -> None:
        """Take the action server's status, which lists each goal that has not ended."""
        listed = {each.goal_id.id: each.status for each in message.status_list}
        for goal, status in listed.items():
            if status in ENDED:
                self.sent.pop(goal, None)
                self.found.pop(goal, None)
            elif goal in self.sent:
                self.sent[goal] = True
            elif goal.startswith(OURS):
                self.found[goal] = True
                self.act()
        for goals in (self.sent, self.found):
            for goal in [each for each, seen in list(goals.items()) if seen and each not in listed]:
                goals.pop(goal, None)  # the server was restarted

    def run(self) -> None:
        while True:
            time.sleep(GUARD_PERIOD)
            try:
                self.look(time.monotonic())
            except Exception as error:  # noqa: BLE001 (without this thread nothing guards the robot)
                self.node.say(op="lost", reason=f"the guard: {error!r}"[:300])
                if self.alone and (self.busy or self.brakes):
                    self.node.publish_zero()

    def look(self, now: float) -> None:
        self.watch_server(now)
        acts = self.alone or self.starting
        if (acts and self.busy) or self.found:
            self.cancel(now, docking=acts and self.docking.is_active)
        at_rest = self.standstill.is_proved or now - self.standstill.measured_at > STALE
        if at_rest and now - self.acted_at > MOVES_WITHIN and not (self.found or self.sent):
            self.brakes = False
        if (
            (self.alone and self.busy)
            or (self.starting and self.found)
            or (acts and self.brakes and not at_rest)
        ):
            self.node.publish_zero()
            self.rest.clear()
        else:
            is_new = now - self.began_at < STARTING
            self.starting = self.starting and (is_new or self.docking.is_active)
            self.rest.set()

    def watch_server(self, now: float) -> None:
        """Take it that goals have ended with a server whose connection is lost."""
        if self.status is None:
            return
        if self.status.get_num_connections():
            self.server_seen_at = now
        elif self.server_seen_at is not None and now - self.server_seen_at > SERVER_GONE:
            self.server_seen_at = None
            self.sent.clear()
            self.found.clear()
            self.node.say(op="gone")

    def cancel(self, now: float, *, docking: bool) -> None:
        """Cancel all that has not ended, every CANCEL_AGAIN seconds."""
        if now - self.cancelled_at < guarded.CANCEL_AGAIN:
            return
        self.cancelled_at = now
        for goal in set(self.found) | (set(self.sent) if self.alone else set()):
            self.publisher.publish(self.kind_of_id(id=goal))
        if docking and (self.dock_call is None or not self.dock_call.is_alive()):
            self.dock_call = threading.Thread(target=self.call_cancel_dock, daemon=True)
            self.dock_call.start()

    def call_cancel_dock(self) -> None:
        from std_srvs.srv import Trigger

        rospy, docking = self.node.rospy, self.docking
        number = docking.cancelling()
        try:
            rospy.wait_for_service(docking.cancel_service, timeout=1.0)
            rospy.ServiceProxy(docking.cancel_service, Trigger)()
        except rospy.ServiceException:
            return  # it is called again
        except rospy.ROSException:
            pass  # no docking server is there
        docking.cancelled(number)

    def finish(self) -> None:
        """Return when all of ours has ended and the robot is at rest, or another node of ours
        guards it.
        """
        self.closed = True
        self.rest.clear()
        alone_at = time.monotonic()
        while not self.rest.wait(MASTER_PERIOD) and time.monotonic() - alone_at < REPLACED:
            if not self.is_replaced():
                alone_at = time.monotonic()

    def is_replaced(self) -> bool:
        """Return whether a newer node of ours publishes velocities."""
        try:
            publishing = dict(self.node.new_master().getSystemState()[0])
        except self.node.unreachable:
            return False
        own = self.node.rospy.get_name()
        others = publishing.get(self.node.driving, ())
        return any(name > own for name in others if name.rsplit("/", 1)[-1].startswith(NODE_NAME))


def running(nodes: Any) -> Any:
    """Return the names of those nodes that answer, all of them asked at once."""
    found: Any = []

    def ask(name: str, uri: str) -> None:
        node = OtherNode(uri)
        if node.lives() and node.has_answered:
            found.append(name)

    asking = [threading.Thread(target=ask, args=each, daemon=True) for each in nodes.items()]
    for thread in asking:
        thread.start()
    for thread in asking:
        thread.join(2 * LIVES_WITHIN)
    return sorted(found)


def standing(kind: Any) -> Any:
    """Return the velocity zero, said now: a base may refuse one that is old."""
    import rospy

    message = kind()
    if hasattr(message, "header"):
        message.header.stamp, message.header.frame_id = rospy.Time.now(), "base_link"
    return message


class StandingPublisher:
    """A listener of rospy's: who comes to hear velocities hears first that the robot stands."""

    def __init__(self, kind: Any) -> None:
        self.kind = kind

    def peer_subscribe(self, _topic: Any, _publish_all: Any, publish: Any) -> None:
        publish(standing(self.kind))

    def peer_unsubscribe(self, _topic: Any, _count: Any) -> None:
        pass


def main(make: Any = Node) -> int:
    """Connect to the agent, whose port is the argument and whose password is the first line of
    standard input.
    """
    connection = socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=5.0)
    connection.settimeout(None)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.sendall(sys.stdin.readline().encode())
    try:
        node = make(connection)
    except ImportError as error:
        return refuse(
            connection, "rospy is not installed for " + sys.executable + ": " + str(error)
        )
    except OSError as error:
        return refuse(
            connection,
            "no ROS master at "
            + os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
            + ": "
            + str(error),
        )
    node.run()
    node.exit(0)
    return 0


def refuse(connection: Any, reason: str) -> int:
    connection.sendall((json.dumps({"op": "lost", "reason": reason}) + "\n").encode())
    return 1


if __name__ == "__main__":
    sys.exit(main())
