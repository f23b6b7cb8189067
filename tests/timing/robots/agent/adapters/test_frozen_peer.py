"""A robot control architecture that hangs for four seconds and resumes obeys no velocities of that
time, although its sockets still receive them: the process is stopped by a signal.
"""

import time

import pytest

from tests.integration.robots.agent.adapters.test_whole_agent import RIGS, agent
from tests.support.agents.orders import OLD, DatedOrders, caught_at_most_one
from tests.support.architectures.ros2_robot import Ros2Rig

FROZEN = 4.0


def press(rig, orders, until, within=15.0):
    """Push dated orders at 20 Hz until a condition holds."""
    deadline = time.monotonic() + within
    while not until():
        assert time.monotonic() < deadline
        linear, angular = orders.now()
        rig.push(linear, angular=angular)
        time.sleep(0.05)


PEERS = RIGS | {"ros2, best effort": lambda _: Ros2Rig("giraff", listens={"best_effort": True})}


@pytest.mark.parametrize("name", PEERS)
def test_no_old_order_moves_a_robot_whose_architecture_hung(name, tmp_path, monkeypatch):
    with PEERS[name](tmp_path) as rca, agent(rca, tmp_path) as rig:
        commands = rca.world.commands
        rig.grant()
        orders = DatedOrders()
        press(
            rig, orders, lambda: sum(orders.age(*each) is not None for each in list(commands)) > 10
        )
        seen = len(commands)
        # an order has just arrived, so that none is in transit
        press(rig, orders, lambda: len(commands) > seen)
        rca.freeze(on=True)
        began, frozen = time.monotonic(), len(commands)
        try:
            press(rig, orders, lambda: time.monotonic() > began + FROZEN)
        finally:
            rca.freeze(on=False)
        thawed = time.monotonic()
        # the driver still holds the key
        press(rig, orders, lambda: time.monotonic() > thawed + 2.0)
        after = commands[frozen:]
        moving = [(each[0], orders.age(*each)) for each in after if each[1] or each[2]]
        assert caught_at_most_one([at for at, age in moving if age is None or age > OLD], after), (
            f"{len(moving)} orders moved the robot: {moving[:5]}"
        )
        assert any(at > thawed and linear == angular == 0.0 for at, linear, angular in after)
        assert after[-1][1:] == (0.0, 0.0)
        assert rca.world.sim.motion.linear == 0.0
        rig.wait(lambda: rig.kernel.fault is None, 20.0)
        rig.lease(renewal=1)
        rig.drive(0.0, until=lambda: not rig.kernel.held, within=20.0)
        orders = DatedOrders()
        press(
            rig,
            orders,
            lambda: (
                any(orders.age(*each) is not None for each in list(commands[-3:]))
                and rca.world.sim.motion.linear > 0.1
            ),
            20.0,
        )
    assert not rca.errors
