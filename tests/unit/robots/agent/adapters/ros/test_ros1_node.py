"""The node of ROS 1 in the system's Python: what it says to the agent, and in which order."""

import threading
from types import SimpleNamespace

import pytest

from robots.agent.adapters.ros.graph import TopicPeers
from robots.agent.adapters.ros.ros1 import UNCONNECTED, NodeBus, Ros1Options
from robots.agent.adapters.ros.ros1_node import Node

SOON = 0.2  # s in which a thread that was started says something


def test_the_first_word_is_ready_however_long_that_takes():
    said, spoke = [], threading.Event()
    node = object.__new__(Node)

    def say(**message):
        said.append(message["op"])

    def watch():
        say(op="listeners")
        spoke.set()

    def slow_name():
        spoke.wait(SOON)  # a busy computer, on which threads that run already are heard first
        return "/telepresence"

    node.say, node.driven = say, None
    node.rospy = SimpleNamespace(get_name=slow_name)
    node.connection = SimpleNamespace(makefile=lambda *_, **__: [])
    node.watch_wheels, node.watch_master, node.answer_questions = watch, lambda: None, lambda: None
    node.write_lines = lambda: None
    node.guard = SimpleNamespace(run=lambda: None, finish=lambda: None)
    node.run()
    assert spoke.wait(SOON * 10)
    assert said == ["ready", "listeners"]


class BusyMaster:
    """A master at which a base begins to listen between any two questions."""

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


def test_nobody_is_known_to_listen_before_it_is_known_for_which_type():
    said = []
    node = object.__new__(Node)
    node.new_master, node.rospy = BusyMaster, SimpleNamespace(get_name=lambda: "/telepresence")
    node.refused, node.others, node.unreachable, node.driving = {}, {}, (OSError,), ""
    node.look_up = lambda *_: None
    node.say = lambda **message: said.append(message)
    node.look_round(1, "/cmd_vel", {})
    for kinds, listeners, _ in said[0]["topics"].values():
        assert kinds or not listeners


def test_what_we_published_ourselves_says_nothing_of_who_listens():
    said, master = [], BusyMaster()
    master.base_comes()
    node = object.__new__(Node)
    node.new_master = lambda: master
    node.rospy = SimpleNamespace(get_name=lambda: "/telepresence")
    node.refused, node.others, node.unreachable, node.driving = {}, {}, (OSError,), "/cmd_vel"
    node.publishers = {}
    node.look_up = lambda *_: None
    node.say = lambda **message: said.append(message["topics"]["/cmd_vel"])
    node.look_round(1, "/cmd_vel", {})
    node.refused = {"/cmd_vel": {"/base_driver": "geometry_msgs/Twist"}}
    node.look_round(2, "/cmd_vel", {})
    assert said == [[[], 1, 0], [["geometry_msgs/Twist"], 1, 0]]


def test_who_listens_and_has_not_come_by_the_second_look_is_called_again():
    called, connected = [], [0]
    node = object.__new__(Node)
    node.driving, node.was_alone = "/cmd_vel", False
    node.publishers = {
        "/cmd_vel": SimpleNamespace(
            type="geometry_msgs/Twist", get_num_connections=lambda: connected[0]
        )
    }
    node.rospy = SimpleNamespace(get_name=lambda: "/us", get_node_uri=lambda: "http://us:1/")
    node.own_master = lambda caller: SimpleNamespace(
        registerPublisher=lambda *more: called.append((caller, *more))
    )
    looks = []
    for wanted, there in ((True, 0), (True, 0), (True, 1), (True, 0), (False, 0), (True, 0)):
        connected[0] = there
        node.call_again(wanted)
        looks.append(len(called))
    assert looks == [0, 1, 1, 1, 1, 1]
    assert called == [("/us", "/cmd_vel", "geometry_msgs/Twist", "http://us:1/")]


@pytest.fixture
def bus():
    bus = NodeBus(Ros1Options(master="http://127.0.0.1:1", watchdog=0.6))
    bus.reasons, bus._writer = (
        [],
        SimpleNamespace(
            write=lambda _: None,
            transport=SimpleNamespace(is_closing=lambda: False, get_write_buffer_size=lambda: 0),
        ),
    )
    bus._lost = bus.reasons.append
    bus.advertise("/cmd_vel", "geometry_msgs/Twist", drives=True)
    return bus


LISTENS = TopicPeers(listeners=1)


def test_who_listens_and_does_not_connect_is_reached_from_another_node_once(bus):
    for now in (0.0, UNCONNECTED, UNCONNECTED + 1.0, UNCONNECTED + 2.0, 5 * UNCONNECTED):
        bus._reach_again("/cmd_vel", LISTENS, now)
    assert len(bus.reasons) == 1
    bus._listeners["/cmd_vel"] = 1
    bus._reach_again("/cmd_vel", LISTENS, 6 * UNCONNECTED)
    bus._listeners["/cmd_vel"] = 0
    for now in (7 * UNCONNECTED, 8 * UNCONNECTED + 1.0):
        bus._reach_again("/cmd_vel", LISTENS, now)
    assert len(bus.reasons) == 2


@pytest.mark.parametrize(
    "peers",
    [TopicPeers(), TopicPeers(frozenset({"geometry_msgs/TwistStamped"}), listeners=1)],
    ids=["nobody", "refused"],
)
def test_for_nobody_and_for_who_was_refused_it_stays_where_it_is(bus, peers):
    for now in (0.0, 10 * UNCONNECTED):
        bus._reach_again("/cmd_vel", peers, now)
    assert bus.reasons == []
