"""The whole agent with each adapter: a visitor drives, the architecture is killed, and the visitor
drives again after its restart.
"""

import re
import time
from contextlib import contextmanager

import pytest

from robots.api import messages as m
from tests.support.agents.control_rig import ThreadedControlRig
from tests.support.architectures.moos_robot import MoosRig
from tests.support.architectures.openmora_robot import OpenMoraRig
from tests.support.architectures.ros1_robot import Ros1Rig
from tests.support.architectures.ros2_robot import Ros2Rig
from tests.support.architectures.rosbridge_robot import RosbridgeRig

RIGS = {
    "moos": lambda _: MoosRig("giraff"),
    "openmora_mqtt": OpenMoraRig,
    "rosbridge": lambda _: RosbridgeRig("rhodon", 2),
    "ros1": lambda _: Ros1Rig("rhodon"),
    "ros2": lambda _: Ros2Rig("giraff"),
}


@contextmanager
def agent(rca, directory):
    """An agent whose robot is reached by a real protocol."""
    rig = ThreadedControlRig(directory, robot=rca.adapter())
    rig.control.start(rig.media)
    try:
        rig.wait(lambda: rig.link.connected and rig.kernel.fault is None, 20.0)
        yield rig
    finally:
        rig.__exit__()


@pytest.mark.nightly
@pytest.mark.parametrize("name", RIGS)
def test_killed_architecture_stops_the_robot_and_driving_resumes_after_its_restart(
    name, tmp_path, monkeypatch, patient_adapters
):
    monkeypatch.setattr("robots.agent.adapters.common.remote_adapter.FIRST_READING", 1.5)
    with RIGS[name](tmp_path) as rca, agent(rca, tmp_path) as rig:
        motion = lambda: rca.world.sim.motion.linear
        rig.grant()
        rig.drive(0.25, until=lambda: any(s.velocity.linear > 0.15 for s in rig.link.all("state")))
        assert any(s.applied for s in rig.link.all("state"))
        if "localization" in rca.adapter().profile.capabilities:
            rig.link.wait("state", lambda s: s.pose.localized)
        before = len(rig.link.sent)  # it also counts as lost until its first connection
        rca.kill()
        lost = rig.link.wait(
            "state",
            lambda s: any(re.match("adapter_lost: .{10}", text) for text in s.errors),
            since=before,
            within=8.0,
        )
        assert lost.safety.inhibited == "fault"
        rig.wait(lambda: motion() == 0.0)
        for _ in range(5):
            rig.push(0.25)
            time.sleep(0.05)
        assert motion() == 0.0
        rca.revive()
        rig.link.wait("event", lambda event: event.type == "adapter_back", within=20.0)
        rig.lease(renewal=1)
        has_lease = lambda: rig.kernel.leases.live(rig.now()) is not None
        rig.drive(0.0, until=lambda: has_lease() and not rig.kernel.held)
        rig.drive(0.25, until=lambda: motion() > 0.2)
        rig.act(m.Stop(action_id="stop-1", stamp=time.time()))
        rig.wait(lambda: motion() == 0.0)
    assert not rca.errors


@pytest.mark.parametrize(
    "name", ["rosbridge", *(pytest.param(one, marks=pytest.mark.soak) for one in ("ros1", "ros2"))]
)
def test_only_the_wizards_script_moves_a_robot_that_it_has_taken_over(
    name, tmp_path, monkeypatch, patient_adapters
):
    lease = {"kind": "wizard", "wizard": "w1", "wizard_epoch": 4, "ways": ("mqtt",)}
    with RIGS[name](tmp_path) as rca, agent(rca, tmp_path) as rig:
        motion = lambda: rca.world.sim.motion.linear
        refused = lambda reason: sum(s.refused.get(reason, 0) for s in rig.link.all("state"))
        rig.lease(**lease)
        rig.wait(lambda: rig.kernel.leases.live(rig.now()) is not None)
        for peer in ("p1", "w1"):
            rig.know_clock(peer)
        rig.push(0.0, way="mqtt", epoch=4)
        rig.wait(lambda: not rig.kernel.held)
        for transport in ("datachannel", "mqtt"):
            rig.push(0.25, way=transport, epoch=1)  # the visitor's
        rig.wait(lambda: refused("observer") and refused("wrong_epoch"))
        assert motion() == 0.0
        script = {"method": "script", "epoch": 4, "way": "mqtt"}
        rig.drive(0.25, until=lambda: motion() > 0.15, within=10.0, **script)
        rig.lease(renewal=1, **{**lease, "wizard": None, "wizard_epoch": 5})  # the page is gone
        rig.wait(lambda: motion() == 0.0)
        rig.push(0.25, **script)
        rig.wait(lambda: refused("observer") > 1)
        assert motion() == 0.0
    assert not rca.errors
