"""The node of ROS 1: its reports to the agent, its guard, and its connections."""

import math
import queue
import socket
import threading
import time
from types import SimpleNamespace

import pytest

from robots.agent.adapters.ros import ros1_node
from robots.agent.adapters.ros.guarded_node import (
    BACKLOG,
    DockingCalls,
    GuardedNode,
    Link,
    Standstill,
)
from robots.agent.adapters.ros.node_bus import GRAPH_TIME
from robots.agent.adapters.ros.ros1 import Ros1Bus, Ros1Options
from robots.agent.adapters.ros.ros1_node import MAX_QUEUED, Guard, MasterError, Node
from robots.agent.robot_interface import AdapterError

SOON = 0.2  # s in which a started thread reports something


def node_without_ros(new_master=None, **fields):
    """Return a node; `sent` has its messages."""
    node = object.__new__(Node)
    node.sent, node.new_master = [], new_master
    node.say = lambda **message: node.sent.append(message)
    node.rospy = SimpleNamespace(get_name=lambda: "/telepresence")
    node.refused, node.others, node.driving = {}, {}, ""
    node.unreachable = (OSError, MasterError)
    vars(node).update(fields)
    return node


def test_the_first_message_is_awaited_without_a_limit():
    reported = threading.Event()
    node = node_without_ros(moved_at=None, watch_master=lambda: None, answer_questions=lambda: None)

    def watch():
        node.say(op="listeners")
        reported.set()

    def slow_name():
        reported.wait(SOON)  # a busy computer, on which running threads report first
        return "/telepresence"

    node.watch_wheels, node.rospy = watch, SimpleNamespace(get_name=slow_name)
    connection = SimpleNamespace(makefile=lambda *_, **__: [])
    node.link = SimpleNamespace(connection=connection, write=lambda: None)
    node.guard = SimpleNamespace(run=lambda: None, finish=lambda: None)
    node.run()
    assert reported.wait(SOON * 10)
    assert [message["op"] for message in node.sent] == ["ready", "listeners"]


class BusyMaster:
    """A master at which a base subscribes between any two calls."""

    def __init__(self):
        self.kinds, self.listening = {}, []

    def base_comes(self):
        self.kinds = {"/cmd_vel": "geometry_msgs/TwistStamped"}
        self.listening = [["/cmd_vel", ["/base_driver"]]]

    def getTopicTypes(self):  # noqa: N802 - the master's API
        kinds = list(self.kinds.items())
        self.base_comes()
        return kinds

    def getSystemState(self):  # noqa: N802 - the master's API
        state = [], list(self.listening), []
        self.base_comes()
        return state


BASE = {"/base_driver": "http://base:1/"}


def test_a_subscriber_is_reported_together_with_its_type():
    node = node_without_ros(BusyMaster, others=dict(BASE))
    node.describe_graph(1, "/cmd_vel", {})
    for kinds, listeners, _ in node.sent[0]["topics"].values():
        assert kinds or not listeners


def test_our_own_type_is_not_reported_as_that_of_a_subscriber():
    master = BusyMaster()
    master.base_comes()
    node = node_without_ros(lambda: master, others=dict(BASE), driving="/cmd_vel", publishers={})
    node.describe_graph(1, "/cmd_vel", {})
    node.refused = {"/cmd_vel": {"/base_driver": "geometry_msgs/Twist"}}
    node.describe_graph(2, "/cmd_vel", {})
    reported = [message["topics"]["/cmd_vel"] for message in node.sent]
    assert reported == [[[], 1, 0], [["geometry_msgs/Twist"], 1, 0]]


@pytest.fixture
def bus():
    bus = Ros1Bus(Ros1Options(master="http://127.0.0.1:1", watchdog=0.6))
    bus._writer = SimpleNamespace(
        write=lambda _: None,
        transport=SimpleNamespace(is_closing=lambda: False, get_write_buffer_size=lambda: 0),
    )
    return bus


def master_of(*names, lookup):
    """Return a master of these nodes, of which some may be gone when they are looked up."""
    return lambda: SimpleNamespace(
        getSystemState=lambda: [[["/odom", names]], [], []],
        getTopicTypes=list,
        lookupNode=lookup,
    )


def lost(_name):
    raise OSError("connection refused")


def but_ended(name):
    if name == "/ended":
        raise MasterError("unknown node [/ended]")
    return BASE["/base_driver"]


def test_a_request_for_the_graph_is_answered_when_the_master_is_lost():
    node = node_without_ros(master_of("/base_driver", lookup=lost))
    node.describe_graph(1, "/cmd_vel", {})
    assert (node.sent[0]["op"], node.sent[0]["number"]) == ("response", 1)
    assert "nodes" not in node.sent[0]


def described(old, *names):
    """Return the description of the graph, given the nodes of earlier connections."""
    node = node_without_ros(master_of("/base_driver", *names, lookup=but_ended))
    node.describe_graph(1, "/cmd_vel", old)
    return node.sent[0]


def test_a_node_that_ends_during_a_description_hides_no_other(monkeypatch):
    monkeypatch.setattr(ros1_node, "answers", lambda _: True)
    found = described({"/planner": "http://planner:1/"}, "/ended")
    assert found["nodes"] == BASE
    assert found["forgotten"] == ["/planner"]


@pytest.mark.slow
def test_the_graph_is_described_in_time_although_many_old_nodes_hang(monkeypatch):
    ended = threading.Event()
    monkeypatch.setattr(ros1_node, "slave_at", lambda uri: uri)
    monkeypatch.setattr(ros1_node, "answers", lambda uri: "hung" not in uri or ended.wait(2.0))
    old = {f"/{number}": f"http://hung:{number}/" for number in range(6)}
    began = time.monotonic()
    found = described({**old, "/planner": "http://planner:1/"})
    took = time.monotonic() - began
    ended.set()
    assert found["forgotten"] == ["/planner"]
    assert took < GRAPH_TIME / 2


async def test_a_graph_that_gets_no_answer_is_an_error(bus, monkeypatch):
    monkeypatch.setattr("robots.agent.adapters.ros.node_bus.GRAPH_TIME", 0.05)
    with pytest.raises(AdapterError, match="the ROS master does not answer"):
        await bus.graph("/cmd_vel", ())


def test_readings_for_an_agent_that_does_not_read_them_are_bounded():
    link = Link(None)
    for number in range(2 * BACKLOG):
        link.say(op="publish", number=number)
    link.say(op="lost")
    assert len(link.lines) == BACKLOG + 1


def test_messages_without_a_subscriber_are_kept_up_to_a_bound():
    publisher = SimpleNamespace(data_class=object, get_num_connections=lambda: 0)
    publisher.impl = SimpleNamespace(is_latch=False)
    node = node_without_ros(
        waiting={"/move_base/goal": list(range(MAX_QUEUED))},
        publishers={"/move_base/goal": publisher},
        filled=lambda message, _content: message,
        guard=SimpleNamespace(published=lambda *_: None),
    )
    node.do_publish("/move_base/goal", {})
    assert len(node.waiting["/move_base/goal"]) == MAX_QUEUED


# --- the guard ------------------------------------------------------------------------------------

ACTIVE, PREEMPTED = 1, 2


class Stamp:
    """As genpy.Time."""

    __slots__ = ("nsecs", "secs")

    def __init__(self, secs, nsecs):
        self.secs, self.nsecs = secs, nsecs


class GuardRig:
    """A guard whose clock, status and odometry the test gives."""

    def __init__(self, monkeypatch):
        self.now, self.zeros, self.cancelled, self.sent = 100.0, 0, [], []
        monkeypatch.setattr(ros1_node.time, "monotonic", lambda: self.now)
        node = SimpleNamespace(
            publish_zero=self._zero,
            say=lambda **message: self.sent.append(message["op"]),
            standstill=Standstill(),
            docking=DockingCalls(),
            cancel_docking=lambda **_: None,
            attempt=lambda work: work(),
            beaten_at=self.now,
        )
        self.guard = Guard(node)
        self.guard.action = "/move_base"
        self.guard.kind_of_id = lambda id: id  # noqa: A006 - as GoalID
        self.guard.publisher = SimpleNamespace(publish=self.cancelled.append)

    def _zero(self):
        self.zeros += 1

    def sends(self, goal):
        goal_id = SimpleNamespace(goal_id=SimpleNamespace(id=goal))
        self.guard.published("/move_base/goal", goal_id)

    def lists(self, **goals):
        entries = [
            SimpleNamespace(goal_id=SimpleNamespace(id=goal.replace("_", "-")), status=status)
            for goal, status in goals.items()
        ]
        self.guard.listed(SimpleNamespace(status_list=entries))

    def passes(self, seconds, speed=0.0, *, beats=False, stamp_stands=False):
        """Time passes at 50 Hz; return how many zeros were sent."""
        before, linear = self.zeros, SimpleNamespace(x=speed, y=0.0)
        twist = SimpleNamespace(linear=linear, angular=SimpleNamespace(z=0.0))
        for _ in range(round(seconds / 0.02)):
            self.now += 0.02
            if beats:
                self.guard.node.beaten_at = self.now
            if not stamp_stands:
                self.stamp = Stamp(int(self.now), int(self.now % 1.0 * 1e9))
            header = SimpleNamespace(stamp=self.stamp)
            self.guard.measured(SimpleNamespace(header=header, twist=SimpleNamespace(twist=twist)))
            self.guard.look(self.now)
        return self.zeros - before


@pytest.fixture
def guard(monkeypatch):
    return GuardRig(monkeypatch)


@pytest.fixture
def navigating(guard):
    """A guard whose agent has an active goal."""
    guard.passes(1.0, beats=True)
    guard.sends("telepresence-1")
    guard.lists(telepresence_1=ACTIVE)
    return guard


def test_the_guard_does_nothing_while_heartbeats_arrive(navigating):
    assert navigating.passes(5.0, 0.3, beats=True) == 0
    assert navigating.cancelled == []


def test_half_a_second_after_the_last_heartbeat_the_guard_cancels_and_brakes(navigating):
    guard = navigating
    assert guard.passes(0.48, 0.3) == 0
    assert guard.passes(1.1, 0.3) >= 50
    assert guard.cancelled == ["telepresence-1"] * 3
    assert guard.passes(2.0) == 100  # at rest, but the goal has not ended
    guard.lists(telepresence_1=PREEMPTED)
    assert guard.passes(1.0) == 0


def test_a_robot_that_a_joystick_moves_gets_no_commands(guard):
    guard.guard.starting, guard.guard.began_at = True, guard.now
    assert guard.passes(3.0, 0.3, beats=True) == 0
    assert guard.passes(3.0, 0.3) == 0


def test_a_robot_that_the_agent_drove_is_braked_until_it_is_at_rest(guard):
    guard.passes(3.0, beats=True)
    guard.guard.act()
    guard.passes(0.5, 0.3, beats=True)
    assert guard.passes(1.0, 0.3) >= 24
    assert guard.passes(1.0) <= 16
    assert guard.passes(1.0, 0.3) == 0


def test_a_goal_that_the_server_has_not_listed_yet_is_cancelled_too(guard):
    guard.passes(1.0, beats=True)
    guard.sends("telepresence-1")
    guard.lists()
    assert guard.passes(1.0) > 0
    assert guard.cancelled == ["telepresence-1"]


def test_a_goal_of_an_earlier_node_is_cancelled_while_the_agent_is_alive(guard):
    guard.passes(1.0, beats=True)
    guard.lists(telepresence_7=ACTIVE, rviz=ACTIVE)
    guard.passes(1.0, beats=True)
    assert guard.cancelled == ["telepresence-7"] * 2


def test_a_new_node_brakes_a_robot_that_an_earlier_one_left_moving(guard):
    guard.guard.starting, guard.guard.began_at = True, guard.now
    guard.lists(telepresence_7=ACTIVE)
    assert guard.passes(3.0, 0.3, beats=True) == 150
    guard.lists(telepresence_7=PREEMPTED)
    guard.passes(0.5, beats=True)
    assert guard.passes(1.0, 0.3, beats=True) == 0


def test_goals_end_with_a_server_whose_connection_is_lost(guard):
    connections = [1]
    guard.guard.status = SimpleNamespace(get_num_connections=lambda: connections[0])
    guard.passes(1.0, beats=True)
    guard.sends("telepresence-1")
    guard.lists(telepresence_1=ACTIVE)
    connections[0] = 0
    guard.passes(1.1, beats=True)
    assert guard.sent == ["gone"]
    assert guard.passes(3.0) == 0


def test_odometry_that_is_published_again_measures_no_standstill(guard):
    guard.passes(3.0, beats=True)
    guard.guard.act()
    guard.passes(0.5, 0.3, beats=True)
    # the last reading from before the motion is repeated
    assert guard.passes(1.5, 0.0, stamp_stands=True) >= 45


@pytest.mark.parametrize(("speed", "is_at_rest"), [(0.02, True), (0.0201, False)])
def test_a_robot_as_fast_as_the_threshold_is_at_rest(guard, speed, is_at_rest):
    guard.passes(1.0, speed, beats=True)
    assert guard.guard.standstill.is_proved is is_at_rest


def test_a_guard_that_fails_to_cancel_still_brakes(guard):
    guard.guard.sent["telepresence-1"] = True
    guard.guard.closed = True
    rounds = iter(range(3))

    def fail(_topic_id):
        raise RuntimeError("the publisher is lost")

    guard.guard.publisher = SimpleNamespace(publish=fail)
    guard.guard.cancelled_at = -1.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ros1_node.time, "sleep", lambda _seconds: next(rounds))
        with pytest.raises(StopIteration):
            guard.guard.run()
    assert guard.zeros == 3


DONE = {"values": {"success": True}}
UNANSWERED = {"problem": "no answer"}


@pytest.fixture
def docking():
    made = DockingCalls()
    made.begin(["/dock"], "/cancel_dock")
    made.cancelled(made.cancelling(own=False), DONE)
    return made


def test_a_docking_is_active_until_a_cancel_that_was_sent_after_its_answer(docking):
    assert not docking.is_active
    call = docking.called("/dock")
    early = docking.cancelling(own=True)
    docking.cancelled(early, DONE)
    assert docking.is_active
    docking.answered(call, DONE)
    assert docking.is_active
    docking.cancelled(early, DONE)
    assert docking.is_active
    docking.cancelled(docking.cancelling(own=True), DONE)
    assert not docking.is_active


@pytest.mark.parametrize("answer", [{"values": {"success": False}}, {"absent": True}])
def test_a_docking_that_is_refused_is_not_active(docking, answer):
    docking.answered(docking.called("/dock"), answer)
    assert not docking.is_active


def test_a_call_of_another_service_is_no_docking(docking):
    assert docking.called("/estop") == 0
    assert not docking.is_active


class DockedNode(GuardedNode):
    """A node whose service that cancels docking answers as the test says."""

    def __init__(self, *answers):
        super().__init__(None)
        self.docking.begin(["/dock"], "/cancel_dock")
        self.answers = list(answers)

    def answer_of(self, service, kind, arguments, *, docking=0):
        assert (service, kind) == ("/cancel_dock", "std_srvs/Trigger")
        return self.answers.pop(0)

    def cancels(self):
        self.docking_cancelled_at = -1.0
        self.cancel_docking(own=False)
        with self.docking.changed:
            assert self.docking.changed.wait_for(lambda: not self.docking.cancels, SOON)


def test_docking_is_cancelled_until_its_service_answers_or_is_absent():
    for last in ({"values": {"success": True}}, {"problem": "there is none", "absent": True}):
        node = DockedNode(UNANSWERED, last)
        node.cancels()
        assert node.docking.is_active
        node.cancels()
        assert not node.docking.is_active
        node.cancels()
        assert node.answers == []


@pytest.mark.parametrize("own", [True, False])
def test_the_agent_learns_of_a_cancel_of_its_own_docking(monkeypatch, own):
    sent = []
    node = DockedNode(DONE)
    monkeypatch.setattr(node, "say", lambda **message: sent.append(message["op"]))
    node.cancel_docking(own=own)
    assert sent == (["docking_cancelled"] if own else [])


def test_a_call_that_fails_unexpectedly_is_answered_and_can_be_cancelled(monkeypatch):
    sent = queue.Queue()
    node = DockedNode(DONE)
    node.cancels()
    monkeypatch.setattr(node, "say", lambda **message: sent.put(message))
    monkeypatch.setattr(node, "answer_of", lambda *_, **__: 1 / 0)
    node.do_call(7, "/dock", "std_srvs/Trigger", {})
    answer = {"op": "response", "number": 7, "problem": "division by zero"}
    assert sent.get(timeout=5.0) == answer
    assert node.docking.is_active
    node.docking.cancelled(node.docking.cancelling(own=True), DONE)
    assert not node.docking.is_active


def test_a_cancel_does_not_end_a_docking_that_is_called_while_it_begins(docking):
    calling = threading.Thread(target=docking.called, args=("/dock",))

    class Time(float):
        """The time of a call; while it is compared, another thread makes the next one."""

        def __gt__(self, other):
            calling.start()
            calling.join(SOON)
            return super().__gt__(other)

    docking.unanswered[docking.called("/dock")] = Time(-math.inf)
    cancel = docking.cancelling(own=True)
    calling.join()
    docking.cancelled(cancel, DONE)
    assert docking.is_active


# --- connections ----------------------------------------------------------------------------------

HEADER = b"callerid=/base"


@pytest.mark.parametrize(
    ("sent", "is_whole"),
    [
        (b"", None),
        (b"\x0e\x00", None),
        (b"\x0e\x00\x00\x00" + HEADER[:-1], None),
        (b"\x0e\x00\x00\x00" + HEADER, True),
        (b"POST /RPC2 HTTP/1.1\r\n", False),
    ],
)
def test_only_a_complete_header_of_tcpros_counts(sent, is_whole):
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(sent)
        assert ros1_node.header_arrived(ours) is is_whole
        if is_whole:
            assert ours.recv(100) == sent
        theirs.close()
        if is_whole is None and not sent:
            assert ros1_node.header_arrived(ours) is False
