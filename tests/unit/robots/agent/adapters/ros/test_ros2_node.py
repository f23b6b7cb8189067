"""What ROS 2's node does with its goals when the server is late, gone or restarted, without rclpy;
tests/integration has it with real nodes.
"""

import queue
import threading
from itertools import pairwise
from types import ModuleType, SimpleNamespace

import pytest

from robots.agent.adapters.ros import guarded_node, ros2_node
from robots.agent.adapters.ros.graph import TopicPeers, chosen_stamped
from robots.agent.adapters.ros.ros2_node import CANCELED, PREFIX, UNKNOWN_GOAL, OwnedGoals
from tests.support.patience import patient

EXECUTING = 2
SOON = 0.1  # s in which a started thread would do something


class Record(SimpleNamespace):
    """A message with any fields."""

    def __getattr__(self, name):
        setattr(self, name, Record())
        return getattr(self, name)

    def get_fields_and_field_types(self):
        return {}


class Client:
    """A client of a service whose server answers when the test does."""

    def __init__(self):
        self.ready, self.requests = True, []

    def service_is_ready(self):
        return self.ready

    def call_async(self, request):
        answers = []
        self.requests.append(
            SimpleNamespace(request=request, answer=lambda result: answers[0](Done(result)))
        )
        return SimpleNamespace(add_done_callback=answers.append)


class Done:
    def __init__(self, result):
        self.result = lambda: result


class Node:
    """What OwnedGoals needs of Ros2Node."""

    def __init__(self):
        self.sent, self.guarding, self.starting, self.began = [], False, False, 1000
        self.ros = SimpleNamespace(
            create_client=lambda *_: Client(), create_subscription=lambda *_: None
        )

    def say(self, **message):
        self.sent.append(message)

    def quality(self, **_):
        return None


@pytest.fixture
def clock(monkeypatch):
    now = SimpleNamespace(time=100.0)
    monkeypatch.setattr(ros2_node.time, "monotonic", lambda: now.time)
    return now


@pytest.fixture
def goals(monkeypatch, clock):
    for name in ("action_msgs", "action_msgs.msg", "action_msgs.srv"):
        monkeypatch.setitem(ros2_node.sys.modules, name, ModuleType(name))
    ros2_node.sys.modules["action_msgs.msg"].GoalStatusArray = Record
    ros2_node.sys.modules["action_msgs.srv"].CancelGoal = SimpleNamespace(Request=Record)
    service = SimpleNamespace(Request=Record)
    kind = SimpleNamespace(Impl=SimpleNamespace(SendGoalService=service, GetResultService=service))
    monkeypatch.setattr(ros2_node, "type_of", lambda *_: kind)
    goals = OwnedGoals(Node(), "/navigate_to_pose", "nav2_msgs/NavigateToPose")
    goals.attend_all()
    clock.time += 1.0
    return goals


def id_at(sent_at):
    return PREFIX + sent_at.to_bytes(8, "big")


def listed(*goals):
    entries = [
        SimpleNamespace(
            goal_info=SimpleNamespace(goal_id=SimpleNamespace(uuid=uuid)), status=status
        )
        for uuid, status in goals
    ]
    return SimpleNamespace(status_list=entries)


def cancelled_ids(goals):
    return [bytes(each.request.goal_info.goal_id.uuid) for each in goals.canceller.requests]


def test_an_older_goal_of_ours_is_cancelled_and_no_younger_or_other_one(goals, clock):
    left, successor, other = id_at(999), id_at(1001), bytes(16)
    goals.take_status(listed((left, EXECUTING), (successor, EXECUTING), (other, EXECUTING)))
    goals.attend_all()
    assert cancelled_ids(goals) == [left]
    clock.time += 0.5
    goals.attend_all()
    assert cancelled_ids(goals) == [left, left]


@pytest.mark.parametrize("resumed", [False, True], ids=["accepted late", "resumed"])
def test_a_goal_that_was_given_up_is_cancelled_when_it_runs_after_all(goals, clock, resumed):
    goals.start(id_at(2000), "g", {})
    if resumed:
        goals.sender.requests[0].answer(SimpleNamespace(accepted=True))
    for client in (goals.sender, goals.canceller):
        client.ready = False
    clock.time += 3.0
    goals.attend_all()
    assert goals.node.sent[-1]["reason"] == "the action server on /navigate_to_pose is gone"
    goals.canceller.ready = True
    if resumed:
        goals.take_status(listed((id_at(2000), EXECUTING)))
    else:
        goals.sender.requests[0].answer(SimpleNamespace(accepted=True))
    assert cancelled_ids(goals) == [id_at(2000)]


def test_an_unknown_goal_may_still_arrive_until_the_request_counts_as_lost(goals, clock):
    goals.start(id_at(2000), "g", {})
    goals.withdraw(id_at(2000), 7)
    goals.canceller.requests[0].answer(SimpleNamespace(return_code=UNKNOWN_GOAL))
    clock.time += 0.5
    goals.attend_all()
    assert goals.node.sent == [{"op": "response", "number": 7, "confirmed": False}]
    clock.time += 10.0
    goals.attend_all()
    goals.canceller.requests[-1].answer(SimpleNamespace(return_code=UNKNOWN_GOAL))
    clock.time += 0.3
    goals.attend_all()
    assert goals.node.sent[-1] == {"op": "ended", "goal": "g", "status": CANCELED, "reason": ""}


def test_a_goal_of_an_earlier_connection_is_cancelled_by_its_id_until_confirmed(goals, clock):
    goals.withdraw(id_at(999), 7)
    assert cancelled_ids(goals) == [id_at(999)]
    goals.canceller.requests[0].answer(SimpleNamespace(return_code=UNKNOWN_GOAL))
    clock.time += 0.05
    goals.attend_all()
    assert goals.node.sent == [{"op": "response", "number": 7, "confirmed": True}]


def test_a_goal_that_was_cancelled_before_it_was_sent_is_never_sent(goals, clock):
    goals.sender.ready = goals.canceller.ready = False
    goals.attend_all()
    goals.start(id_at(2000), "g", {})
    goals.withdraw(id_at(2000), 7)
    goals.sender.ready = goals.canceller.ready = True
    clock.time += 1.0
    goals.attend_all()
    assert goals.sender.requests == []
    assert goals.node.sent[0] == {"op": "response", "number": 7, "confirmed": True}


def test_a_guard_sends_no_goal_any_more(goals):
    goals.node.guarding = True
    goals.start(id_at(2000), "g", {})
    assert goals.sender.requests == []


def test_a_goal_that_its_server_did_not_know_is_cancelled_when_it_runs_after_all(goals, clock):
    goals.withdraw(id_at(2000), 7)
    goals.canceller.requests[0].answer(SimpleNamespace(return_code=UNKNOWN_GOAL))
    clock.time += 0.05
    goals.attend_all()
    assert goals.goals == {}
    goals.take_status(listed((id_at(2000), EXECUTING)))
    assert cancelled_ids(goals) == [id_at(2000)] * 2


class FailingGuard(ros2_node.Ros2Node):
    """A guard of which each part fails once."""

    def __init__(self):
        self.done = []

    def part(self, name):
        self.done.append(name)
        if self.done.count(name) == 1:
            raise RuntimeError(name)

    def stop_wheels(self):
        self.part("zero")

    def attend(self):
        self.part("cancel")

    def cancel_docking(self, *, own):
        assert own
        self.part("dock")

    def may_move(self, _since):
        self.part("rest")
        return self.done.count("rest") < 3


def test_an_error_ends_no_guard(monkeypatch):
    monkeypatch.setattr(ros2_node.time, "sleep", lambda _: None)
    guard = FailingGuard()
    guard.brake_until_rest(0.0)
    assert guard.done == ["zero", "cancel", "dock", "rest"] * 3


class DockingServer:
    """A server that receives a call, and is there or not at each look, 0.5 s after the last."""

    def __init__(self, clock, looks, answer=None):
        self.clock, self.looks, self.answer = clock, iter(looks), answer
        self.answer_to = None

    def service_is_ready(self):
        if self.answer_to is None:
            return True
        self.clock.time += 0.5
        is_there = next(self.looks, None)
        if is_there is None and self.answer is not None:
            self.answer_to(Done(self.answer))
        return is_there is not False

    def call_async(self, _request):
        return SimpleNamespace(add_done_callback=lambda take: setattr(self, "answer_to", take))


@pytest.fixture
def call(monkeypatch):
    """Call a service that docks, at a server; return the answer."""

    def answer_of(server):
        monkeypatch.setattr(ros2_node, "type_of", lambda *_: SimpleNamespace(Request=Record))
        node = object.__new__(ros2_node.Ros2Node)
        node.clients, node.guarding = {"/dock": server}, False
        node.docking = SimpleNamespace(cancel_service="/cancel_dock")
        node.later = lambda work, *words: work(*words)
        return node.answer_of("/dock", "std_srvs/Trigger", {}, docking=1)

    return answer_of


@pytest.mark.timeout(10)
def test_a_call_ends_when_its_server_has_been_absent_for_2_s(call, clock):
    began = clock.time
    server = DockingServer(clock, [True, *[False] * 9])
    assert call(server) == {"problem": "no answer"}
    assert clock.time - began == 0.5 + ros2_node.GONE_AFTER


@pytest.mark.timeout(10)
def test_a_call_continues_while_its_server_is_absent_for_less_than_2_s(call, clock):
    server = DockingServer(clock, [False, False, False, True] * 2, [True])
    assert call(server) == {"values": [True]}


@pytest.mark.parametrize(
    ("kinds", "published"),
    [
        (["Twist", "TwistStamped"], "Twist"),
        (["TwistStamped"], "TwistStamped"),
        (["TwistStamped", "Twist"], "Twist"),
    ],
)
def test_a_guard_brakes_with_the_type_that_the_agent_would_choose(monkeypatch, kinds, published):
    sent = []
    monkeypatch.setattr(ros2_node, "type_of", lambda kind, _: type(kind.split("/")[1], (), {}))
    node = object.__new__(ros2_node.Ros2Node)
    node.settings, node.publishers, node.kinds = {"driving": "/cmd_vel"}, {}, {}
    node.quality = lambda **_: None
    node.subscribers_of = lambda _: [Record(topic_type="geometry_msgs/msg/" + k) for k in kinds]
    node.later = lambda *_: None
    node.ros = SimpleNamespace(
        create_publisher=lambda *_: SimpleNamespace(publish=sent.append), destroy_publisher=None
    )
    node.stop_wheels()
    graph = {"/cmd_vel": TopicPeers(frozenset("geometry_msgs/" + kind for kind in kinds))}
    assert [type(each).__name__ for each in sent] == [published]
    assert chosen_stamped(graph, "/cmd_vel", stamped=False) == (published == "TwistStamped")


DONE, UNANSWERED = {"values": {"success": True}}, {"problem": "no answer"}


class DockedNode(ros2_node.Ros2Node):
    """A node that may have a docking of an earlier run, whose cancel service answers when the test
    does.
    """

    def __init__(self, clock):
        guarded_node.GuardedNode.__init__(self, None)
        self.clock, self.settings, self.moved_at = clock, {"driving": ""}, None
        self.answers, self.said = queue.Queue(), queue.Queue()
        self.docked = threading.Event()  # the docking service was called
        self.say = lambda **message: self.said.put(message)
        self.do_guard(linear=0.02, angular=0.05, docks=["/dock"], cancel_dock="/cancel_dock")

    def attend(self):
        pass

    def report_listeners(self, topic, count):
        pass

    def answer_of(self, service, kind, arguments, *, docking=0):
        if service == "/dock":
            self.docked.set()
            return DONE
        return self.answers.get()

    def call_dock(self):
        self.do_call(7, "/dock", "std_srvs/Trigger", {})

    def guards_for(self, seconds):
        """Time passes in rounds of the guard; return the times at which it cancelled."""
        times = [self.docking_cancelled_at]
        for _ in range(round(seconds / ros2_node.PERIOD)):
            self.look_after(self.clock.time)
            if times[-1] != self.docking_cancelled_at:
                times.append(self.docking_cancelled_at)
            self.clock.time += ros2_node.PERIOD
        return times[1:]

    def answers_all(self, answer):
        for _ in range(self.docking.cancels):
            self.answers.put(answer)
        with self.docking.changed:
            assert self.docking.changed.wait_for(lambda: not self.docking.cancels, patient(1.0))


def test_a_docking_of_an_earlier_run_is_cancelled_every_half_second_until_confirmed(clock):
    node = DockedNode(clock)
    times = node.guards_for(2.0)
    assert len(times) == 4
    assert all(0.5 <= after - before < 0.6 for before, after in pairwise(times))
    node.answers_all(UNANSWERED)
    assert len(node.guards_for(1.0)) == 2
    node.answers_all(DONE)
    assert node.guards_for(2.0) == []


def test_a_docking_of_this_run_is_not_cancelled_while_the_agent_lives(clock):
    node = DockedNode(clock)
    node.guards_for(0.1)
    node.answers_all(DONE)
    node.docking.called("/dock")
    assert node.guards_for(2.0) == []


def test_cancels_that_wait_for_an_answer_are_bounded(clock):
    node = DockedNode(clock)
    assert len(node.guards_for(20.0)) == guarded_node.MOST_CANCELS
    node.answers_all(UNANSWERED)


@pytest.mark.parametrize("cancelled_first", [True, False])
def test_a_docking_waits_until_no_cancel_of_an_earlier_one_can_end_it(clock, cancelled_first):
    node = DockedNode(clock)
    if cancelled_first:
        node.guards_for(0.6)
    node.call_dock()
    node.guards_for(0.6)
    assert not node.docked.wait(SOON)
    node.answers_all(UNANSWERED)
    assert not node.docked.wait(SOON)
    node.guards_for(0.6)
    node.answers_all(DONE)
    assert node.docked.wait(patient(1.0))
    assert node.guards_for(2.0) == []


def test_a_docking_is_refused_while_its_cancel_service_does_not_answer(clock, monkeypatch):
    monkeypatch.setattr(guarded_node, "SETTLED_WITHIN", SOON)
    node = DockedNode(clock)
    node.guards_for(0.6)
    node.call_dock()
    answer = node.said.get(timeout=patient(1.0))
    assert (answer["problem"], answer["absent"]) == ("/cancel_dock does not answer", True)
    assert not node.docked.is_set()
    assert node.guards_for(0.6), "an earlier one may still run"
    node.answers_all(DONE)
