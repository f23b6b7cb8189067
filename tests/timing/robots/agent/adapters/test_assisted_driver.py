"""A driver who is helped past what they do not see: by the real limits, which a neighbour's work would reach first."""

from robots.api.messages import Velocity
from tests.support.autonomous_drive import driving, made


async def test_a_driver_is_helped_and_told_why():
    async with driving(made(start="2.0,1.0,3.1416")) as drive:
        await drive.until(lambda: drive.adapter._beams is not None)
        drive.adapter.set_assist("slow")
        drive.driver = Velocity(linear=0.5, angular=0.0)
        # A laser's noise may let it creep.
        await drive.until(lambda: drive.state.assist_why == "stop" and drive.told.linear < 0.03 and drive.state.assist_point is not None)
        assert drive.state.contacts == 0
        assert drive.state.clearance < 0.6
        drive.driver = Velocity(linear=-0.2, angular=0.0)
        await drive.until(lambda: drive.state.velocity.linear < -0.1)
