"""How often ROS 2's adapter sends a velocity, on virtual time."""

import asyncio

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.common.velocity_gate import VelocityGate
from robots.agent.adapters.ros import base, messages
from robots.api.geometry import Pose2D
from robots.api.messages import Velocity
from tests.support.architectures.fake_ros_bus import FakeBus
from tests.support.virtual_time import on_virtual_time

AHEAD = Velocity(linear=0.2, angular=0.0)
TICK = 0.02  # s between two turns of the control loop
SECONDS = 4.0


class AcknowledgingBus(FakeBus):
    """As ROS 2's: the newest velocity is acknowledged 2 ms after it."""

    answers = False

    async def ask(self):
        await asyncio.sleep(0.002)

    def listeners(self, _topic):
        return 1


def connected(now):
    """Return an adapter for ROS 2 that believes that it is connected, and its bus."""
    adapter = registry.create("ros2", "giraff", {"navigation": "none"})
    adapter._bus = bus = AcknowledgingBus(version=2)
    adapter._gate = VelocityGate(adapter.gate_params, now)
    adapter._failure, adapter._advertised = "", True
    return adapter, bus


@pytest.mark.parametrize("hertz", [20.0, 25.0, 30.0])
@on_virtual_time
async def test_base_gets_a_velocity_with_each_odometry_message(hertz, monkeypatch):
    clock = asyncio.get_running_loop().time
    monkeypatch.setattr(base.time, "monotonic", clock)
    adapter, bus = connected(clock())
    where = {"pose": messages.pose(Pose2D(0.0, 0.0, 0.0))}

    async def measure():
        while True:
            header = messages.header("odom", clock(), 2)
            twist = {"twist": messages.twist(AHEAD)}
            adapter._odometry({"header": header, "pose": where, "twist": twist})
            await asyncio.sleep(1.0 / hertz)

    measuring, until = asyncio.ensure_future(measure()), clock() + SECONDS
    while clock() < until:
        adapter.apply(AHEAD)
        await asyncio.sleep(TICK)
    measuring.cancel()
    assert len(bus.published) / SECONDS == pytest.approx(hertz, abs=1.0)
