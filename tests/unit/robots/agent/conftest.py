import pytest

from tests.support.agents.control_rig import ControlRig
from tests.support.agents.scripted_robot import ScriptedRobot


@pytest.fixture
def robot(request):
    """Make the robot of `rig`: by an indirect parameter, or by the module's ROBOT."""
    make = getattr(request.module, "ROBOT", ScriptedRobot)
    return getattr(request, "param", make)()


@pytest.fixture
def rig(tmp_path, robot):
    """A control loop with a driver who has the lease."""
    with ControlRig(tmp_path, robot=robot) as rig:
        rig.grant()
        yield rig
