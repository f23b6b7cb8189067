"""What camera and microphone of a simulated robot say while there is no simulator yet."""

import time

import pytest

from robots.agent.adapters.simulator.media import SimulatorCamera, SimulatorMicrophone


@pytest.mark.parametrize("source", [SimulatorCamera, SimulatorMicrophone])
def test_a_simulator_that_is_still_being_started_is_no_failure_of_its_camera(source):
    one = source(lambda: None)
    one.start()
    began = time.monotonic()
    assert not one.read(0.05)
    assert time.monotonic() - began >= 0.05
