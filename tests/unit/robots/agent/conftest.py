import pytest

from tests.support.agents.control_rig import ControlRig
from tests.support.agents.scripted_robot import ScriptedRobot


@pytest.fixture
def robot(request):
    """Make the robot of `rig`: by an indirect parameter, or by the module's ROBOT."""
    make = getattr(request.module, "ROBOT", ScriptedRobot)
    return getattr(request, "param", make)()


@pytest.fixture
def free_rig(tmp_path, robot):
    """A control loop without a driver."""
    with ControlRig(tmp_path, robot=robot) as rig:
        yield rig


@pytest.fixture
def rig(free_rig):
    """A control loop with a driver who has the lease."""
    free_rig.grant()
    return free_rig
