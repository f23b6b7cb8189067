"""What the robot's state says of devices that do not work."""

from robots.api import messages as m
from tests.support.agents.control_rig import ControlRig

REASON = "the camera rtsp://10.0.0.4 cannot be read: connection refused"


def newest(rig: ControlRig) -> m.State:
    return rig.link.all("state")[-1]


def test_the_reason_is_in_the_states_errors_while_a_device_does_not_work(tmp_path):
    with ControlRig(tmp_path) as rig:
        rig.wait(lambda: newest(rig).errors == ())
        assert newest(rig).camera_status is None
        rig.media.camera_status = m.CameraStatus(status="failed", reason=REASON)
        rig.media.errors = (REASON,)
        rig.wait(lambda: newest(rig).errors == (REASON,))
        assert newest(rig).camera_status == m.CameraStatus(status="failed", reason=REASON)
        rig.media.camera_status, rig.media.errors = None, ()
        rig.wait(lambda: newest(rig).errors == ())
        assert newest(rig).camera_status is None
