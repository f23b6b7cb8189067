"""What stops the robot's own navigation when the agent is lost, velocities that pass through the
agent, the robot's own lock, and its speed limit.
"""

import asyncio
import time

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.common.robot_profile import load_profile
from robots.agent.adapters.ros import base, docking
from robots.agent.adapters.ros.base import RosAdapter, RosOptions
from robots.agent.adapters.ros.bus import UnansweredError
from robots.agent.adapters.ros.docking import TriggerDocking
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import ActionRefusedError, AdapterError
from robots.api.adapter_names import PROFILES
from robots.api.messages import Dock, Goto, Velocity
from tests.support.architectures.fake_ros_bus import FakeBus

DOCKS = {"dock": "/dock", "undock": "/undock"}
AHEAD = Velocity(linear=0.2, angular=0.1)


def adapter_of(*, guards=False, version=1, **options):
    robot = load_profile("rhodon")
    bus = FakeBus(version, guards=guards)
    adapter = RosAdapter(robot, RosOptions(watchdog=0.6, **options), bus, "ROS")
    adapter._failure = ""
    return adapter, bus


@pytest.mark.parametrize(
    ("guards", "options", "control"),
    [
        (True, {}, "guarded"),
        (True, DOCKS | {"cancel_dock": "/cancel_dock"}, "guarded"),
        (True, {"navigation": "none"}, None),
        (False, {"navigation": "none"}, None),
        (False, {"navigation_velocity": "cmd_vel_nav"}, "agent"),
        (True, {"navigation_velocity": "cmd_vel_nav"}, "agent"),
    ],
)
def test_the_profile_states_the_control_of_navigation(guards, options, control):
    assert adapter_of(guards=guards, **options)[0].profile.navigation_control == control


@pytest.mark.parametrize(
    ("guards", "options"), [(False, {}), (True, DOCKS), (False, DOCKS | {"navigation": "none"})]
)
def test_unguarded_navigation_is_refused(guards, options):
    with pytest.raises(AdapterError, match=r"navigation_velocity .* unguarded_navigation"):
        adapter_of(guards=guards, **options)


def test_an_owner_may_allow_unguarded_navigation(tmp_path):
    file = tmp_path / "mine.toml"
    shipped = (PROFILES / "rhodon.toml").read_text()
    file.write_text(f"unguarded_navigation = true\n{shipped}")
    assert registry.create("rosbridge", str(file)).profile.navigation_control == "unguarded"


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_navigation_is_guarded_where_the_master_is_on_this_computer(host):
    profile = registry.create("ros1", "rhodon", {"master": f"http://{host}:11311"}).profile
    assert profile.navigation_control == "guarded"


async def test_velocities_pass_while_an_action_of_ours_runs(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(base.time, "monotonic", lambda: now[0])
    adapter, _ = adapter_of(navigation_velocity="cmd_vel_nav")
    message = {"linear": {"x": 0.2}, "angular": {"z": 0.1}}
    adapter._navigate(message)
    assert adapter.wanted() is None
    adapter.pending_actions.begin(adapter._pending(Goto(action_id="g", stamp=0.0, x=1.0, y=0.0)))
    assert adapter.wanted() == AHEAD
    now[0] += 0.31
    assert adapter.wanted() == ZERO
    adapter._navigate({"header": {}, "twist": message})
    assert adapter.wanted() == AHEAD
    adapter.pending_actions.drive.first_cancelled_at = now[0]
    assert adapter.wanted() is None


async def test_velocities_of_a_guarded_navigation_are_not_wanted():
    adapter, _ = adapter_of(guards=True)
    adapter.pending_actions.begin(adapter._pending(Goto(action_id="g", stamp=0.0, x=1.0, y=0.0)))
    assert adapter.wanted() is None


async def test_the_robots_own_lock_is_set_by_topic_and_service():
    adapter, bus = adapter_of(guards=True, lock="lock", estop_service="/estop")
    for locked in (True, False):
        adapter.set_lock(locked=locked)
        await asyncio.gather(*adapter._tasks)
    assert bus.published == [("/lock", {"data": True}), ("/lock", {"data": False})]
    assert bus.calls == [
        ("/estop", "std_srvs/SetBool", {"data": True}),
        ("/estop", "std_srvs/SetBool", {"data": False}),
    ]
    bus.answer = AdapterError("/estop does not answer")
    adapter.set_lock(locked=True)
    await asyncio.gather(*adapter._tasks)
    assert adapter._lock_problem == "/estop failed: /estop does not answer"


async def test_a_trigger_that_locks_is_not_called_to_release():
    adapter, bus = adapter_of(guards=True, estop_service="/estop", estop_service_type="Trigger")
    for locked in (True, False):
        adapter.set_lock(locked=locked)
        await asyncio.gather(*adapter._tasks)
    assert bus.calls == [("/estop", "std_srvs/Trigger", {})]


async def test_a_speed_limit_is_published_in_metres_a_second():
    adapter, bus = adapter_of(version=2, guards=True, navigation="nav2", speed_limit="speed_limit")
    adapter.limit_speed(0.2)
    (topic, message), *_ = bus.published
    assert (topic, message["percentage"], message["speed_limit"]) == ("/speed_limit", False, 0.2)


def test_an_estop_that_was_never_reported_is_unknown():
    adapter, _ = adapter_of(guards=True, estop="estop")
    assert adapter.readings.state(time.time()).estop is None
    (estop,) = (each for each in adapter._subscriptions() if each.topic == "/estop")
    assert estop.either
    estop.handler({"data": False})
    assert adapter.readings.state(time.time()).estop is False


async def test_a_docking_that_its_service_refuses_has_not_begun():
    adapter, bus = adapter_of(guards=True, **DOCKS, cancel_dock="/cancel_dock")
    bus.answer = (False, "no dock in sight")
    with pytest.raises(ActionRefusedError, match="rca: /dock: no dock in sight"):
        await adapter.start(Dock(action_id="d", stamp=0.0))
    assert await adapter.cancel("d")


async def test_a_dock_that_fails_is_cancelled_until_its_service_answers():
    adapter, bus = adapter_of(guards=True, **DOCKS, cancel_dock="/cancel_dock")
    bus.answer = AdapterError("/dock does not answer")
    with pytest.raises(AdapterError, match="/dock does not answer"):
        await adapter.start(Dock(action_id="d", stamp=0.0))
    assert not await adapter.cancel("d")
    bus.answer = (True, "")
    assert await adapter.cancel("d")
    assert [call[0] for call in bus.calls] == ["/dock", "/cancel_dock", "/cancel_dock"]


@pytest.mark.parametrize(("stands", "confirmed"), [(True, True), (False, False)])
async def test_a_cancel_without_success_counts_at_rest_only(stands, confirmed):
    bus = FakeBus()
    bus.answer = (False, "nothing to cancel")
    assert await TriggerDocking("/cancel_dock", bus, lambda: stands).cancel() is confirmed


class LateDock:
    """A bus whose docking service answers when the test lets it."""

    def __init__(self):
        self.answer = asyncio.get_running_loop().create_future()
        self.cancelled = lambda: asyncio.sleep(0)
        self.calls = []

    async def call(self, service, kind, arguments=None, *, within=0.0):
        self.calls.append(service)
        if service == "/dock":
            return await self.answer
        if service == "/cancel_dock":
            await self.cancelled()
        return True, ""


async def test_a_docking_that_is_answered_late_is_cancelled_again(monkeypatch):
    monkeypatch.setattr(docking, "ANSWER_TIME", 0.01)
    bus = LateDock()
    docks = TriggerDocking("/cancel_dock", bus, lambda: True)
    with pytest.raises(AdapterError, match="/dock does not answer"):
        await docks.start("/dock")
    assert not await docks.cancel()
    assert not await docks.cancel()
    bus.answer.set_result((True, ""))
    while len(bus.calls) < 4:
        await asyncio.sleep(0)
    assert await docks.cancel()
    assert bus.calls == ["/dock", *["/cancel_dock"] * 3]


@pytest.mark.parametrize("lost", [True, False], ids=["connection lost", "no answer"])
async def test_a_docking_call_without_an_answer_is_cancelled_for_a_while(monkeypatch, lost):
    now = [100.0]
    monkeypatch.setattr(docking.time, "monotonic", lambda: now[0])
    bus = LateDock()
    docks = TriggerDocking("/cancel_dock", bus, lambda: True)
    starting = asyncio.ensure_future(docks.start("/dock"))
    while not bus.calls:
        await asyncio.sleep(0)
    now[0] += 100.0
    if lost:
        bus.answer.cancel()
    else:
        bus.answer.set_exception(UnansweredError("/dock does not answer"))
    with pytest.raises(AdapterError, match="/dock does not answer"):
        await starting
    assert not await docks.cancel()
    now[0] += docking.LOST_FOR - 1.0
    assert not await docks.cancel()
    now[0] += 1.0
    assert await docks.cancel()


@pytest.fixture
async def slow(monkeypatch):
    """A docking with a cancel under way, whose service answers once `bus.answers` is set."""
    monkeypatch.setattr(docking, "CANCEL_TIME", 0.01)
    monkeypatch.setattr(docking, "SETTLED_WITHIN", 0.05)
    bus = LateDock()
    docks = TriggerDocking("/cancel_dock", bus, lambda: True)
    bus.answer.set_result((True, ""))
    bus.answers = asyncio.Event()
    bus.cancelled = bus.answers.wait
    await docks.start("/dock")
    assert not await docks.cancel()
    bus.calls.clear()
    return docks, bus


async def test_the_answer_to_a_cancel_applies_only_to_its_docking(slow):
    docks, bus = slow
    bus.answers.set()
    await asyncio.sleep(0.01)
    await docks.start("/undock")
    assert await docks.cancel()
    assert bus.calls == ["/undock", "/cancel_dock"]


async def test_the_next_docking_waits_for_the_answer_to_a_cancel(slow, monkeypatch):
    monkeypatch.setattr(docking, "SETTLED_WITHIN", 60.0)
    docks, bus = slow
    starting = asyncio.ensure_future(docks.start("/undock"))
    await asyncio.sleep(0.01)
    assert bus.calls == []
    bus.answers.set()
    await starting
    assert bus.calls == ["/undock"]


async def test_the_next_docking_is_refused_until_a_cancel_is_answered(slow):
    docks, bus = slow
    for _ in range(2):
        with pytest.raises(ActionRefusedError, match="rca: /cancel_dock does not answer"):
            await docks.start("/undock")
    bus.cancelled = unanswered
    bus.answers.set()
    docks._cancelling.cancel()
    await asyncio.sleep(0)
    with pytest.raises(ActionRefusedError, match="rca: /cancel_dock does not answer"):
        await docks.start("/undock")
    bus.cancelled = bus.answers.wait
    await docks.start("/undock")
    assert bus.calls == ["/cancel_dock", "/cancel_dock", "/undock"]


async def unanswered():
    raise UnansweredError("/cancel_dock does not answer")


async def test_a_docking_that_is_cancelled_while_it_waits_does_not_begin(slow, monkeypatch):
    monkeypatch.setattr(docking, "SETTLED_WITHIN", 60.0)
    docks, bus = slow
    starting = asyncio.ensure_future(docks.start("/undock"))
    await asyncio.sleep(0)
    assert not await docks.cancel()
    bus.answers.set()
    with pytest.raises(ActionRefusedError, match="cancelled"):
        await starting
    assert bus.calls == []


async def test_two_cancels_at_once_share_one_call():
    bus = LateDock()
    docks = TriggerDocking("/cancel_dock", bus, lambda: True)
    bus.cancelled = lambda: asyncio.sleep(0.05)
    assert await asyncio.gather(docks.cancel(), docks.cancel()) == [True, True]
    assert bus.calls == ["/cancel_dock"]


@pytest.mark.parametrize("docks", [True, False], ids=["docking", "goto"])
async def test_a_docking_that_the_guard_has_cancelled_fails_and_no_other_action(docks):
    adapter, _ = adapter_of(guards=True, **DOCKS, cancel_dock="/cancel_dock")
    action = Dock(action_id="a", stamp=0.0) if docks else Goto(action_id="a", stamp=0.0, x=1.0)
    adapter.pending_actions.begin(adapter._pending(action))
    adapter.docking_cancelled()
    assert adapter.pending_actions.drive.failure == ("heartbeat_lost" if docks else "")


async def test_the_guard_learns_of_the_end_of_a_docking_and_of_no_other_action():
    adapter, bus = adapter_of(guards=True, **DOCKS, cancel_dock="/cancel_dock")
    await adapter.start(Dock(action_id="d", stamp=0.0))
    assert bus.guard_orders == []
    adapter.pending_actions.end("d", "FINISHED")

    def look(now, speed):
        adapter._odometry(odometry(now, speed))
        adapter.readings.last_received_at = float(now)
        adapter._look(float(now))

    look(1, -0.1)
    assert bus.guard_orders == [], "it still backs out of the dock"
    look(2, 0.0)
    assert bus.guard_orders == []
    look(3, 0.0)
    assert bus.guard_orders == [{"op": "docking_ended"}]
    adapter.pending_actions.begin(adapter._pending(Goto(action_id="g", stamp=0.0, x=1.0, y=0.0)))
    adapter.pending_actions.end("g", "FINISHED")
    assert len(bus.guard_orders) == 1


def odometry(second, speed):
    return {
        "header": {"stamp": {"secs": second, "nsecs": 0}},
        "pose": {"pose": {"position": {"x": 0.0, "y": 0.0}, "orientation": AHEAD_OF_MAP}},
        "twist": {"twist": {"linear": {"x": speed}, "angular": {"z": 0.0}}},
    }


AHEAD_OF_MAP = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


async def test_odometry_that_is_published_again_is_no_reading():
    adapter, _ = adapter_of(guards=True)
    adapter._odometry(odometry(5, 0.3))
    received_at = adapter.readings.last_received_at
    adapter._odometry(odometry(5, 0.0))
    assert adapter.readings.velocity.linear == 0.3
    assert adapter.readings.last_received_at == received_at
    adapter._odometry(odometry(6, 0.0))
    assert adapter.readings.velocity.linear == 0.0
    for _ in range(2):  # a stamp of zero is none
        adapter.readings.fresh = False
        adapter._odometry(odometry(0, 0.0))
        assert adapter.readings.fresh
