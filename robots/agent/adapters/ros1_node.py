"""A node of ROS 1 that does what the agent tells it over a loopback connection: one JSON object a line, messages as objects.

It runs in the Python that ROS was built for, which is not the agent's (Noetic: 3.8; Debian 12: 3.11 of the system), and so imports nothing
of ours and is written for Python 3.6. rospy takes a node's name once a process and forgets nothing of a lost master: whoever wants to
begin again ends this process and starts another. It ends by itself, with a standing robot, when the agent is gone or the master is.

    agent -> node   advertise, publish, drive (a velocity: after SILENCE without another the robot is told to stand), subscribe, call
    node -> agent   ready, publish, response, lost
"""
# ruff: noqa: D102, D103, PLC0415, SIM105, SLF001, I001, UP -- read by old Pythons; rospy is imported where its absence can be told

import base64
import json
import math
import os
import socket
import sys
import threading
import time
from typing import Any

SILENCE = 0.3
GLANCE = 0.05
MASTER_PERIOD = 0.3
MASTER_TIME = 1.0
HEARING = 3.0


class Node:
    """One connection to the agent, one node."""

    def __init__(self, connection: Any) -> None:
        import http.client
        import xmlrpc.client

        import genpy
        import roslib.message
        import rosgraph
        import rospy

        self.genpy, self.rospy, self.roslib = genpy, rospy, roslib
        self.connection = connection
        self.lock = threading.Lock()
        self.publishers: Any = {}
        self.waiting: Any = {}  # topic to the messages that nobody is connected to hear yet
        self.subscribers: Any = []
        self.driven: Any = None  # (topic, monotonic time) while the robot may be moving
        self.master = rosgraph.Master("/telepresence")
        self.unreachable = (OSError, http.client.HTTPException, xmlrpc.client.Error, rosgraph.MasterException)
        self.uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
        socket.setdefaulttimeout(MASTER_TIME)
        self.master_pid = self.master.getPid()
        socket.setdefaulttimeout(None)
        rospy.init_node("telepresence", anonymous=True, disable_signals=True, disable_rosout=True)

    def say(self, **message: Any) -> None:
        data = (json.dumps(message) + "\n").encode()
        with self.lock:
            self.connection.sendall(data)

    def run(self) -> None:
        """Do what the agent says until it is gone."""
        for work in (self.watch_wheels, self.watch_master):
            threading.Thread(target=work, daemon=True).start()
        self.say(op="ready", node=self.rospy.get_name())
        try:
            for line in self.connection.makefile("r", encoding="utf-8"):
                order = json.loads(line)
                getattr(self, "do_" + order.pop("op"))(**order)
        except OSError:
            pass  # as good as the end of what the agent says
        self.stand()

    def do_advertise(self, topic: str, kind: str, *, latch: bool) -> None:
        if topic not in self.publishers:
            message = self.roslib.message.get_message_class(kind)
            if message is None:
                self.say(op="lost", reason="ROS has no message type " + kind + " here")
                return
            self.publishers[topic] = self.rospy.Publisher(topic, message, queue_size=2, latch=latch, tcp_nodelay=True)

    def do_publish(self, topic: str, content: Any) -> None:
        """Publish once somebody hears: what rospy publishes before its first subscriber has connected is lost."""
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

    def do_drive(self, topic: str, content: Any, *, moving: bool) -> None:
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

        self.subscribers.append(self.rospy.Subscriber(topic, message, heard, queue_size=2, tcp_nodelay=True))

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
        """Stop a robot whose agent is stuck."""
        while True:
            time.sleep(GLANCE)
            driven = self.driven
            if driven is not None and time.monotonic() - driven[1] > SILENCE:
                self.stand()

    def stand(self) -> None:
        driven, self.driven = self.driven, None
        if driven is not None:
            publisher = self.publishers[driven[0]]
            publisher.publish(publisher.data_class())
            time.sleep(GLANCE)

    def watch_master(self) -> None:
        """End when the master is gone or is another one: it knows nothing of this node then."""
        problem = ""
        while not problem:
            time.sleep(MASTER_PERIOD)
            try:
                if self.master.getPid() != self.master_pid:
                    problem = "the ROS master at " + self.uri + " was started anew"
            except self.unreachable as error:
                problem = "the ROS master at " + self.uri + " is gone: " + str(error)
        self.stand()
        self.say(op="lost", reason=problem)
        os._exit(1)

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


def main(make: Any = Node) -> int:
    """Connect to the agent, whose port is the argument and whose password is the first line of standard input."""
    connection = socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=5.0)
    connection.settimeout(None)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.sendall(sys.stdin.readline().encode())
    try:
        node = make(connection)
    except ImportError as error:
        return refuse(connection, "rospy is not installed for " + sys.executable + ": " + str(error))
    except OSError as error:
        return refuse(connection, "no ROS master at " + os.environ.get("ROS_MASTER_URI", "http://localhost:11311") + ": " + str(error))
    node.run()
    os._exit(0)  # rospy's threads would wait for a master that may be gone


def refuse(connection: Any, reason: str) -> int:
    connection.sendall((json.dumps({"op": "lost", "reason": reason}) + "\n").encode())
    return 1


if __name__ == "__main__":
    sys.exit(main())
