"""The whole agent with only the adapter changed: a visitor drives, the architecture is killed under
them, and the robot comes back.
"""

import time
from contextlib import contextmanager

import pytest

from robots.api import messages as m
from tests.support.control_rig import ThreadedControlRig
from tests.support.moos_robot import MoosRig
from tests.support.openmora_robot import OpenMoraRig
from tests.support.ros1_robot import Ros1Rig
from tests.support.ros2_robot import LOOPBACK, Ros2Rig
from tests.support.rosbridge_robot import RosbridgeRig

RIGS = {
    "moos": lambda _: MoosRig("giraff"),
    "openmora_mqtt": OpenMoraRig,
    "rosbridge": lambda _: RosbridgeRig("rhodon", 2),
    "ros1": lambda _: Ros1Rig("rhodon"),
    "ros2": lambda _: Ros2Rig("giraff"),
}


@contextmanager
def agent(rca, directory):
    """An agent whose robot stands behind a real protocol."""
    rig = ThreadedControlRig(directory, robot=rca.adapter())
    rig.control.start(rig.media)
    try:
        rig.wait(lambda: rig.link.connected and rig.kernel.fault is None, 20.0)
        yield rig
    finally:
        rig.__exit__()


@pytest.mark.parametrize("name", RIGS)
def test_a_drive_whose_architecture_is_killed_ends_standing_is_said_and_goes_on_when_it_is_back(
    name, tmp_path, monkeypatch, patient_adapters
):
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setattr("robots.agent.adapters.common.remote_adapter.FIRST_READING", 1.5)
    with RIGS[name](tmp_path) as rca, agent(rca, tmp_path) as rig:
        motion = lambda: rca.world.sim.motion.linear
        rig.grant()
        rig.drive(0.25, until=lambda: any(s.velocity.linear > 0.15 for s in rig.link.all("state")))
        assert any(s.applied for s in rig.link.all("state"))
        if "localization" in rca.adapter().profile.capabilities:
            rig.link.wait("state", lambda s: s.pose.localized)
        said = len(rig.link.sent)  # before it was reached for the first time it was lost as well
        rca.kill()
        lost = rig.link.wait(
            "state",
            lambda s: any(text.startswith("adapter_lost: ") for text in s.errors),
            since=said,
            within=8.0,
        )
        assert lost.safety.inhibited == "fault"
        assert (
            len(next(text for text in lost.errors if text.startswith("adapter_lost")))
            > len("adapter_lost: ") + 10
        )
        rig.wait(lambda: motion() == 0.0)
        for _ in range(5):
            rig.push(0.25)
            time.sleep(0.05)
        assert motion() == 0.0
        rca.revive()
        rig.link.wait("event", lambda event: event.type == "adapter_back", within=20.0)
        rig.lease(renewal=1)
        rig.drive(0.0, until=lambda: not rig.kernel.held)
        rig.drive(0.25, until=lambda: motion() > 0.2)
        rig.act(m.Stop(action_id="stop-1", stamp=time.time()))
        rig.wait(lambda: motion() == 0.0)
    assert not rca.errors
