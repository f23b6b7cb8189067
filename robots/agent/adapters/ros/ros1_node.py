"""A node of ROS 1 that the agent controls over a loopback connection: one JSON object a line,
messages as objects.

It runs in the Python that ROS was built for, which is not the agent's (Noetic: 3.8; Debian 12: 3.11
of the system), and so imports nothing of ours and is written for Python 3.6. rospy can register a
node only once per process and cannot recover from a lost master, so the agent restarts this process
to reconnect.

    agent -> node   advertise, publish, subscribe, call, docking_ended,
                    drive (a velocity; SILENCE seconds after the last one the robot is stopped),
                    ask (answered when the subscribers of velocities have responded),
                    graph (and which of the `old` nodes still run without the master's knowledge),
                    guard (what to cancel and stop), beat (the agent's heartbeat)
    node -> agent   ready, publish, response, listeners, docking_cancelled, gone, problems, lost

TCPROS has no acknowledgements: a hung subscriber buffers velocities and executes them later. Before
each velocity the node therefore calls getPid on every subscriber. A subscriber that does not answer
within 1 s is disconnected (TCP reset) and receives a zero velocity when it reconnects.

The node is also the guard of the robot's own navigation. It has its own process group and outlives
the agent: when the heartbeat stops for HEARTBEAT seconds, or the connection closes, it cancels all
goals of ours and the docking, and sends zero velocities until they have ended and the robot is
measured at rest. Then it exits, or waits for the agent to continue.
"""

import functools
import http.client
import os
import queue
import select
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
    import guarded_node as guarded  # type: ignore[no-redef]

POLL_PERIOD = 0.05  # seconds
MASTER_PERIOD = 0.3
LIVES_WITHIN = 1.0
ALL_LIVE_WITHIN = 1.5  # seconds for any number of nodes, well below node_bus.GRAPH_TIME
SENDING = 16 << 10
UNACKNOWLEDGED = 1000  # milliseconds
HANDSHAKE = 5.0  # seconds that a new connection has for its header
LARGEST_HEADER = 1 << 18  # bytes, with the definition of the message
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
ENDED = frozenset([2, 3, 4, 5, 8])  # of actionlib_msgs/GoalStatus, from preempted to recalled


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


def slave_at(uri: str) -> Any:
    """Return the slave API of another node."""
    return xmlrpc.client.ServerProxy(uri, transport=TimeoutTransport())


def answers(slave: Any) -> bool:
    try:
        slave.getPid("/telepresence")
    except (OSError, http.client.HTTPException, xmlrpc.client.Error):
        return False
    return True


def running(nodes: Any) -> Any:
    """Return the names of the nodes, an object from name to slave API, that answer in time."""
    found: Any = []

    def ask(name: str) -> None:
        if answers(slave_at(nodes[name])):
            found.append(name)

    asking = [threading.Thread(target=ask, args=(name,), daemon=True) for name in nodes]
    deadline = time.monotonic() + ALL_LIVE_WITHIN
    for each in asking:
        each.start()
    for each in asking:
        each.join(max(0.0, deadline - time.monotonic()))
    return sorted(found)


def header_arrived(connection: Any) -> Any:
    """Return whether a connection has sent the whole header of TCPROS, a length in four bytes and
    as many bytes; None while more may arrive, False when it is invalid or lost.
    """
    try:
        if not select.select([connection], [], [], 0)[0]:
            return None
        data = connection.recv(LARGEST_HEADER, socket.MSG_PEEK)
    except OSError:
        return False
    if len(data) < 4:
        return None if data else False
    length = struct.unpack("<I", data[:4])[0] + 4
    return False if length > LARGEST_HEADER else len(data) >= length or None


class Node(guarded.GuardedNode):
    """One connection to the agent, one node."""

    def __init__(self, connection: Any) -> None:
        super().__init__(connection)
        import roslib.message
        import rospy
        import rospy.impl.registration
        import rospy.impl.tcpros_base

        self.rospy, self.roslib = rospy, roslib
        self.waiting: Any = {}  # topic to the messages that have no subscriber yet
        self.subscribers: Any = []
        self.driving = ""  # the topic of velocities
        self.was_alone = False  # at the last look no subscriber of velocities had connected
        self.moved_at: Any = None  # monotonic time of the last velocity other than zero
        self.unreachable = (OSError, http.client.HTTPException, xmlrpc.client.Error, MasterError)
        self.uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
        # one for each thread: it has one connection
        self.new_master: Any = functools.partial(Master, self.uri)
        self.own_master: Any = self.new_master
        self.master = self.new_master()
        self.master_pid = self.master.getPid()
        self.questions: Any = queue.Queue(MAX_QUEUED)
        self.slaves: Any = {}  # of the subscribers of velocities, by the names of their nodes
        self.has_answered: Any = set()  # those of them that have
        self.others: Any = {}  # address of the slave API by the name of the node
        self.refused: Any = {}  # by topic: by node the type that it wants
        name = NODE_NAME + str(int(time.time() * 1e6))  # a newer node has a larger number
        rospy.init_node(name, disable_signals=True, disable_rosout=True)
        server = rospy.impl.tcpros_base._tcpros_server
        self.accept, server.topic_connection_handler = (
            server.topic_connection_handler,
            self.connected,
        )
        server.start_server()
        self.arriving: Any = queue.Queue()
        self.take_connection = server.tcp_ros_server.inbound_handler
        server.tcp_ros_server.inbound_handler = self.incoming
        threading.Thread(target=self.shake_hands, daemon=True).start()
        self.keep_publications()
        self.guard: Any = Guard(self)

    def run(self) -> None:
        """Serve the agent until it is lost, then guard the robot."""
        # anything else before it counts as a failure
        self.say(op="ready", node=self.rospy.get_name())
        self.start(self.watch_wheels, self.watch_master, self.answer_questions, self.guard.run)
        try:
            self.obey_orders()
        finally:
            self.leave()

    def leave(self) -> None:
        """Stop the robot, and return when nothing of ours can move it any more."""
        self.attempt(self.stop_driving)
        self.guard.finish()

    def do_guard(self, **settings: Any) -> None:
        super().do_guard(**settings)
        self.guard.begin(**settings)

    def type_of(self, kind: str) -> Any:
        found = self.roslib.message.get_message_class(kind)
        if found is None:
            raise guarded.MissingTypeError.of(kind)
        return found

    def do_advertise(self, topic: str, kind: str, *, latch: bool, drives: bool = False) -> None:
        message, former = self.type_of(kind), self.publishers.get(topic)
        if former is not None and former.data_class is message:
            return
        if drives:
            self.driving, self.moved_at = topic, None
        greeting = ZeroFirst(message) if drives else None
        with self.topics.lock:
            # the guard may publish there, too: only another type of ours is replaced
            replaced = self.topics.pubs.pop(topic) if former is not None else None
            self.publishers[topic] = self.rospy.Publisher(
                topic, message, greeting, queue_size=2, latch=latch, tcp_nodelay=True
            )
        if replaced is not None:
            self.refused.pop(topic, None)
            replaced.close()

    def keep_publications(self) -> None:
        """Never be seen without a topic whose type is replaced.

        rospy asks a publisher that has refused it for its publications 1 s later. If the topic is
        missing then, it keeps the dead connection in its list and for good ignores all news of that
        publisher (rospy/impl/tcpros_pubsub.py, robust_connect_subscriber).
        """
        self.topics = self.rospy.impl.registration.get_topic_manager()
        listed = self.topics.get_publications

        def get_publications() -> Any:
            with self.topics.lock:
                return listed()

        self.topics.get_publications = get_publications

    def shake_hands(self) -> None:
        """Give rospy each new connection once its header has arrived, in the order of arrival.

        rospy reads one header at a time without a time-out (rospy/impl/tcpros_base.py,
        TCPServer.run), so no subscriber could connect while a stranger sends none, for example a
        client of an ended node whose port this node now has. The order matters because rospy keeps
        the newer of two connections of one subscriber.
        """
        pending: Any = []
        while True:
            try:
                pending.append(self.arriving.get(timeout=POLL_PERIOD / 5 if pending else None))
            except queue.Empty:
                pass
            for entry in list(pending):
                connection, address, deadline = entry
                is_whole = header_arrived(connection)
                if is_whole is None and time.monotonic() < deadline:
                    continue
                pending.remove(entry)
                if is_whole:
                    self.attempt(functools.partial(self.take_connection, connection, address))
                else:
                    connection.close()

    def incoming(self, connection: Any, address: Any) -> None:
        self.arriving.put((connection, address, time.monotonic() + HANDSHAKE))

    def connected(self, connection: Any, address: Any, header: Any) -> Any:
        """Accept a subscriber; return the reason for refusing it, or None."""
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
            self.disconnect_unresponsive(master)
            self.say(op="response", number=number)

    def disconnect_unresponsive(self, master: Any) -> None:
        """Probe each subscriber of velocities, and disconnect those that do not answer. One that
        has never answered cannot be reached from here, and keeps its connection.
        """
        publisher = self.publishers.get(self.driving)
        for connection in list(publisher.impl.connections) if publisher is not None else []:
            name = connection.endpoint_id
            try:
                if name not in self.slaves:
                    self.slaves[name] = slave_at(master.lookupNode(name))
            except self.unreachable:
                continue  # it is no longer registered; its connection will end
            if answers(self.slaves[name]):
                self.has_answered.add(name)
            elif name in self.has_answered:
                self.has_answered.discard(name)
                del self.slaves[name]
                publisher.impl.remove_connection(connection)
                connection.close()

    def do_graph(self, number: int, driving: str, old: Any) -> None:
        words: Any = (number, driving, old)
        threading.Thread(target=self.describe_graph, args=words, daemon=True).start()

    def describe_graph(self, number: int, driving: str, old: Any) -> None:
        found: Any = {}
        nodes: Any = {}
        try:
            master, own = self.new_master(), self.rospy.get_name()
            speaking, listening, serving = master.getSystemState()
            kinds = dict(master.getTopicTypes())  # after it: a new node has a type
            for which, topics in ((2, speaking), (1, listening)):
                for topic, names in topics:
                    entry = found.setdefault(
                        topic, [[kinds[topic]] if topic in kinds else [], 0, 0]
                    )
                    entry[which] += len([name for name in names if name != own])
            if self.driving:  # the master has the type of the last publisher: ours
                wanted = sorted(set(self.refused.get(driving, {}).values()) - {""})
                entry = found.setdefault(driving, [[], 0, 0])
                entry[0] = wanted
                self.announce_again(bool(entry[1]) and not wanted)
            names = {
                name for each in (speaking, listening, serving) for _, at in each for name in at
            }
            self.others = self.addresses(master, names - {own})
            forgotten = running({name: old[name] for name in old if name not in names})
            nodes = {"nodes": self.others, "forgotten": forgotten}
        except self.unreachable:
            pass  # watch_master reports it
        self.say(op="response", number=number, topics=found, **nodes)

    def addresses(self, master: Any, names: Any) -> Any:
        """Return the slave APIs by name, without nodes that have ended."""
        found: Any = {}
        for name in names:
            try:
                found[name] = self.others.get(name) or master.lookupNode(name)
            except MasterError:
                continue
        return found

    def announce_again(self, wanted: bool) -> None:
        """Have the master announce our velocities again when no subscriber has connected since the
        last look: of two lists of publishers that reach a node at the same time, rospy uses the one
        that arrived last, which may be the older one (rospy/impl/registration.py, RegManager).
        """
        publisher = self.publishers.get(self.driving)
        alone = publisher is not None and wanted and not publisher.get_num_connections()
        if alone and self.was_alone:
            name, uri = self.rospy.get_name(), self.rospy.get_node_uri()
            self.own_master(caller=name).registerPublisher(self.driving, publisher.type, uri)
        self.was_alone = alone

    def do_publish(self, topic: str, content: Any) -> None:
        """Publish once there is a subscriber: rospy discards messages before the first connects."""
        publisher, waiting = self.publishers[topic], self.waiting.setdefault(topic, [])
        message = self.filled(publisher.data_class(), content)
        self.guard.published(topic, message)
        if publisher.impl.is_latch or (not waiting and publisher.get_num_connections()):
            publisher.publish(message)  # rospy keeps a latched one for later subscribers
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
            time.sleep(POLL_PERIOD)
        while waiting:
            if publisher.get_num_connections() and self.guard.permits(topic):
                publisher.publish(waiting[0])
            else:
                self.guard.lost(topic)
            waiting.pop(0)

    def do_drive(self, topic: str, content: Any, *, moving: bool, at: float) -> None:
        if moving and time.monotonic() - at > guarded.OLDEST:
            return  # it has waited here: this process has hung
        publisher = self.publishers[topic]
        publisher.publish(self.filled(publisher.data_class(), content))
        if moving:
            self.guard.starting = False
            self.guard.act()
        self.moved_at = time.monotonic() if moving else None

    def subscribe(self, topic: str, kind: str, *, period: float, latched: bool) -> None:
        """Subscribe to a topic; `latched` is the publisher's to decide."""
        message, due = self.type_of(kind), [0.0]

        def take(content: Any) -> None:
            now = time.monotonic()
            if now < due[0]:
                return
            due[0] = now + period
            self.say(op="publish", topic=topic, content=guarded.plain(content))

        self.subscribers.append(
            self.rospy.Subscriber(topic, message, take, queue_size=2, tcp_nodelay=True)
        )

    def do_call(self, number: int, service: str, kind: str, arguments: Any) -> None:
        if service in self.docking.services:
            self.guard.starting = False
            self.guard.act()
        super().do_call(number, service, kind, arguments)

    def answer_of(self, service: str, kind: str, arguments: Any, *, docking: int = 0) -> Any:
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
        """Stop a robot that receives no more velocities, and report their subscribers."""
        while True:
            time.sleep(POLL_PERIOD)
            self.attempt(self.look_at_wheels)

    def look_at_wheels(self) -> None:
        publisher = self.publishers.get(self.driving)
        count = publisher.get_num_connections() if publisher is not None else 0
        self.report_listeners(self.driving, count)
        moved_at = self.moved_at
        if moved_at is not None and time.monotonic() - moved_at > guarded.SILENCE:
            self.stop_driving()

    def publish_zero(self) -> None:
        publisher = self.publishers.get(self.driving)
        if publisher is not None:
            publisher.publish(zero_of(publisher.data_class))

    def stop_driving(self) -> None:
        if self.moved_at is not None:
            self.moved_at = None
            self.publish_zero()
            time.sleep(POLL_PERIOD)

    def watch_master(self) -> None:
        """End when the master is lost or was restarted, and so does not know this node.

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

    def unregister(self) -> None:
        """Have the master forget this node: other nodes would continue to call its ports."""
        name, uri = self.rospy.get_name(), self.rospy.get_node_uri()
        calls = xmlrpc.client.MultiCall(self.new_master().proxy)
        for topic, _ in self.topics.get_publications():
            calls.unregisterPublisher(name, topic, uri)
        for topic, _ in self.topics.get_subscriptions():
            calls.unregisterSubscriber(name, topic, uri)
        for service, at in self.rospy.impl.registration.get_service_manager().get_services():
            calls.unregisterService(name, service, at)
        try:
            calls()
        except self.unreachable:
            pass  # the master has forgotten it, or ends itself

    def exit(self, code: int) -> None:
        """End this process: rospy's threads would wait for a master that may be gone."""
        self.link.drain(FAREWELL)
        os._exit(code)

    def is_known(self) -> bool:
        try:
            self.master.lookupNode(self.rospy.get_name())
        except MasterError:
            return False
        return True

    def filled(self, message: Any, content: Any) -> Any:
        return guarded.filled(message, content, self.type_of)


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
        self.standstill, self.docking = node.standstill, node.docking
        self.began_at = time.monotonic()
        self.closed = False  # the agent will not continue
        self.starting = False  # goals of an earlier node are being ended
        self.sent: Any = {}  # our goals that have not ended: whether they were listed
        self.found: Any = {}  # goals of earlier nodes that have not ended
        self.cancelled_at = 0.0
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
        self.starting, self.began_at = True, time.monotonic()
        rospy.Subscriber(settings["odom"], Odometry, self.measured, queue_size=2, tcp_nodelay=True)
        if settings["kind"] == "move_base":
            self.action, self.kind_of_id = settings["action"], GoalID
            self.publisher = rospy.Publisher(self.action + "/cancel", GoalID, queue_size=10)
            self.status = rospy.Subscriber(self.action + "/status", GoalStatusArray, self.listed)

    @property
    def alone(self) -> bool:
        return self.closed or time.monotonic() - self.node.beaten_at > guarded.HEARTBEAT

    @property
    def busy(self) -> bool:
        return bool(self.found or self.sent or self.docking.is_active)

    def permits(self, topic: str) -> bool:
        """Return whether a message that waited may still be published: a goal only while the agent
        is connected.
        """
        return topic != self.action + "/goal" or not self.alone

    def published(self, topic: str, message: Any) -> None:
        if self.action and topic == self.action + "/goal":
            self.sent[message.goal_id.id] = False
            self.starting = False
            self.act()

    def lost(self, topic: str) -> None:
        """Note that a message was not published: a goal then never runs."""
        if topic == self.action + "/goal":
            self.sent.clear()
            self.node.say(op="gone")

    def act(self) -> None:
        """Note that the robot moves, or is about to, on our behalf, and must be stopped."""
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
                    self.node.attempt(self.node.publish_zero)

    def look(self, now: float) -> None:
        self.watch_server(now)
        acts = self.alone or self.starting
        self.node.cancel_docking(own=self.alone)
        if (acts and self.busy) or self.found:
            self.cancel(now)
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
            is_new = now - self.began_at < STARTING or self.docking.is_active
            self.starting = self.starting and is_new
            self.rest.set()

    def watch_server(self, now: float) -> None:
        """Note that goals have ended with a server whose connection is lost."""
        if self.status is None:
            return
        if self.status.get_num_connections():
            self.server_seen_at = now
        elif self.server_seen_at is not None and now - self.server_seen_at > SERVER_GONE:
            self.server_seen_at = None
            self.sent.clear()
            self.found.clear()
            self.node.say(op="gone")

    def cancel(self, now: float) -> None:
        """Cancel all goals that have not ended, every CANCEL_AGAIN seconds."""
        if now - self.cancelled_at < guarded.CANCEL_AGAIN:
            return
        self.cancelled_at = now
        for goal in set(self.found) | (set(self.sent) if self.alone else set()):
            self.publisher.publish(self.kind_of_id(id=goal))

    def finish(self) -> None:
        """Return when our goals have ended and the robot is at rest, or a newer node guards it."""
        self.closed = True
        self.rest.clear()
        alone_at = time.monotonic()
        while not self.rest.wait(MASTER_PERIOD) and time.monotonic() - alone_at < REPLACED:
            if not self.node.attempt(self.is_replaced):
                alone_at = time.monotonic()

    def is_replaced(self) -> bool:
        """Return whether a newer node of ours drives."""
        try:
            publishing = dict(self.node.new_master().getSystemState()[0])
        except self.node.unreachable:
            return False
        own = self.node.rospy.get_name()
        others = publishing.get(self.node.driving, ())
        return any(name > own for name in others if name.rsplit("/", 1)[-1].startswith(NODE_NAME))


def zero_of(kind: Any) -> Any:
    """Return a zero velocity, stamped now: a base may refuse an old one."""
    import rospy

    message = kind()
    if hasattr(message, "header"):
        message.header.stamp, message.header.frame_id = rospy.Time.now(), "base_link"
    return message


class ZeroFirst:
    """rospy's subscriber listener: a new subscriber of velocities receives a zero first."""

    def __init__(self, kind: Any) -> None:
        self.kind = kind

    def peer_subscribe(self, _topic: Any, _publish_all: Any, publish: Any) -> None:
        publish(zero_of(self.kind))

    def peer_unsubscribe(self, _topic: Any, _count: Any) -> None:
        pass


def main(make: Any = Node) -> int:
    """Connect to the agent and serve it."""
    connection = guarded.connect()
    try:
        node = make(connection)
    except ImportError as error:
        return guarded.refuse(connection, f"rospy is not installed for {sys.executable}: {error}")
    except OSError as error:
        uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
        return guarded.refuse(connection, f"no ROS master at {uri}: {error}")
    node.run()
    node.unregister()
    node.exit(0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
