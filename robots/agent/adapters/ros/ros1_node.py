"""A node of ROS 1 that does what the agent tells it over a loopback connection: one JSON object a
line, messages as objects.

It runs in the Python that ROS was built for, which is not the agent's (Noetic: 3.8; Debian 12: 3.11
of the system), and so imports nothing of ours and is written for Python 3.6. rospy takes a node's
name once a process and forgets nothing of a lost master: whoever wants to begin again ends this
process and starts another. It ends by itself, with a standing robot, when the agent is gone or the
master is.

    agent -> node   advertise, unadvertise, publish, drive (a velocity: after SILENCE without
    another the robot is told to stand),
                    ask (do those live who listen for velocities?),
                    graph (and which of the `old` nodes run that the master has forgotten?),
                    subscribe, call
    node -> agent   ready, publish, response, listeners, lost

TCPROS has no answers: a node that hangs lets its socket buffer fill and obeys all of it when it
goes on. So whoever listens for velocities is asked for its process id (the slave API's getPid,
which every node serves) before each of them; who owes the answer for a second loses its connection,
by a reset, and is told to stand when it comes back.
"""

import base64
import functools
import http.client
import json
import math
import os
import queue
import socket
import struct
import sys
import threading
import time
import xmlrpc.client
from typing import Any

SILENCE = 0.3
GLANCE = 0.05
MASTER_PERIOD = 0.3
MASTER_TIME = 1.0
HEARING = 3.0
OLDEST = 0.25  # seconds after which a velocity that waited for this process is none any more
LIVES_WITHIN = 1.0
SENDING = 16 << 10
UNACKNOWLEDGED = 1000  # milliseconds


class Impatient(xmlrpc.client.Transport):
    """Asks over HTTP, and not for long."""

    def make_connection(self, host: Any) -> Any:
        connection = super().make_connection(host)
        connection.timeout = LIVES_WITHIN
        return connection


class OtherNode:
    """Another node, by its slave API, and whether it lives."""

    def __init__(self, uri: str) -> None:
        self.proxy = xmlrpc.client.ServerProxy(uri, transport=Impatient())
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
        import rosgraph
        import rospy
        import rospy.impl.tcpros_base

        self.genpy, self.rospy, self.roslib = genpy, rospy, roslib
        self.connection = connection
        self.lock = threading.Lock()
        self.publishers: Any = {}
        self.waiting: Any = {}  # topic to the messages that nobody is connected to hear yet
        self.subscribers: Any = []
        self.driving = ""  # the topic of velocities
        self.was_alone = False  # at the last look: who listens for velocities had not connected
        self.driven: Any = None  # (topic, monotonic time) while the robot may be moving
        # one for each thread: it has one connection
        self.new_master: Any = functools.partial(rosgraph.Master, "/telepresence")
        self.own_master: Any = rosgraph.Master
        self.master = self.new_master()
        self.unknown = rosgraph.MasterError
        self.unreachable = (
            OSError,
            http.client.HTTPException,
            xmlrpc.client.Error,
            rosgraph.MasterException,
        )
        self.uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
        socket.setdefaulttimeout(MASTER_TIME)
        self.master_pid = self.master.getPid()
        socket.setdefaulttimeout(None)
        self.questions: Any = queue.Queue()
        self.listeners: Any = {}  # who listens for velocities, by the name of its node
        self.others: Any = {}  # slave API by the name of the node
        self.refused: Any = {}  # by topic: by node the type that it wants
        rospy.init_node("telepresence", anonymous=True, disable_signals=True, disable_rosout=True)
        self.server = rospy.impl.tcpros_base._tcpros_server
        self.accept, self.server.topic_connection_handler = (
            self.server.topic_connection_handler,
            self.connected,
        )

    def say(self, **message: Any) -> None:
        data = (json.dumps(message) + "\n").encode()
        with self.lock:
            self.connection.sendall(data)

    def run(self) -> None:
        """Do what the agent says until it is gone."""
        # the agent takes anything else that comes first for a failure
        self.say(op="ready", node=self.rospy.get_name())
        for work in (self.watch_wheels, self.watch_master, self.answer_questions):
            threading.Thread(target=work, daemon=True).start()
        try:
            for line in self.connection.makefile("r", encoding="utf-8"):
                order = json.loads(line)
                getattr(self, "do_" + order.pop("op"))(**order)
        except OSError:
            pass  # as good as the end of what the agent says
        self.stand()

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
        self.questions.put(number)

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
                for topic, nodes in topics:
                    entry = found.setdefault(
                        topic, [[kinds[topic]] if topic in kinds else [], 0, 0]
                    )
                    entry[which] += len([node for node in nodes if node != own])
            if self.driving:  # the master knows a topic by the type of who published last: ours
                wanted = sorted(set(self.refused.get(driving, {}).values()) - {""})
                entry = found.setdefault(driving, [[], 0, 0])
                entry[0] = wanted
                self.call_again(bool(entry[1]) and not wanted)
            names = {
                node for each in (speaking, listening, serving) for _, at in each for node in at
            }
            self.look_up(master, names - {own})
            nodes = {
                "nodes": self.others,
                "forgotten": running({name: old[name] for name in old if name not in names}),
            }
        except self.unreachable:
            pass  # watch_master says so
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
            self.own_master(name).registerPublisher(topic, publisher.type, uri)
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
        """Publish once somebody hears: what rospy publishes before its first subscriber has
        connected is lost.
        """
        publisher, waiting = self.publishers[topic], self.waiting.setdefault(topic, [])
        message = self.filled(publisher.data_class(), content)
        if not waiting and publisher.get_num_connections():
            publisher.publish(message)
            return
        waiting.append(message)
        if len(waiting) == 1:
            threading.Thread(target=self.hand_over, args=(publisher, waiting), daemon=True).start()

    def hand_over(self, publisher: Any, waiting: Any) -> None:
        deadline = time.monotonic() + HEARING
        while not publisher.get_num_connections() and time.monotonic() < deadline:
            time.sleep(GLANCE)
        while waiting:
            publisher.publish(waiting[0])
            waiting.pop(0)

    def do_drive(self, topic: str, content: Any, *, moving: bool, at: float) -> None:
        if moving and time.monotonic() - at > OLDEST:  # this process has hung meanwhile
            return
        publisher = self.publishers[topic]
        publisher.publish(self.filled(publisher.data_class(), content))
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
            try:
                self.say(op="publish", topic=topic, content=self.plain(content))
            except OSError:
                pass  # the agent is gone, which run() notices

        self.subscribers.append(
            self.rospy.Subscriber(topic, message, heard, queue_size=2, tcp_nodelay=True)
        )

    def do_call(self, number: int, service: str, kind: str) -> None:
        threading.Thread(target=self.call, args=(number, service, kind), daemon=True).start()

    def call(self, number: int, service: str, kind: str) -> None:
        try:
            self.rospy.wait_for_service(service, timeout=2.0)
            answer = self.rospy.ServiceProxy(service, self.roslib.message.get_service_class(kind))()
            self.say(op="response", number=number, values=self.plain(answer))
        except (self.rospy.ROSException, self.rospy.ServiceException) as error:
            self.say(op="response", number=number, problem=str(error) or type(error).__name__)

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
            if driven is not None and time.monotonic() - driven[1] > SILENCE:
                self.stand()

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
        self.stand()
        self.say(op="lost", reason=problem)
        os._exit(1)

    def is_known(self) -> bool:
        """Tell whether the master knows this node."""
        try:
            self.master.lookupNode(self.rospy.get_name())
        except self.unknown:
            return False
        return True

    def plain(self, value: Any) -> Any:
        """Return a message as JSON has it."""
        if isinstance(value, self.genpy.TVal):
            return {"secs": value.secs, "nsecs": value.nsecs}
        if isinstance(value, self.genpy.Message):
            return {name: self.plain(getattr(value, name)) for name in value.__slots__}
        if isinstance(value, (list, tuple)):
            return [self.plain(each) for each in value]
        if isinstance(value, (bytes, bytearray)):
            return base64.b64encode(value).decode()
        if isinstance(value, float) and not math.isfinite(value):
            return None
        return value

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
    os._exit(0)  # rospy's threads would wait for a master that may be gone


def refuse(connection: Any, reason: str) -> int:
    connection.sendall((json.dumps({"op": "lost", "reason": reason}) + "\n").encode())
    return 1


if __name__ == "__main__":
    sys.exit(main())
