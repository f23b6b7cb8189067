"""The number of threads that a hung device may occupy."""

import threading

import pytest

from robots.agent.devices import device_address, reader
from robots.agent.devices.reader import DeviceReader, ReaderLimits
from robots.agent.robot_interface import AdapterError
from tests.support.agents.simulators import eventually


def test_hung_device_occupies_a_few_threads_and_is_read_again_when_it_is_back(monkeypatch):
    goes_on = threading.Event()

    def hang(*_, **__):
        goes_on.wait()
        raise OSError("unplugged")

    monkeypatch.setattr(reader.av, "open", hang)
    camera = DeviceReader(
        "camera",
        device_address.read("/dev/video0", "camera"),
        "video",
        lambda *_: None,
        ReaderLimits(ending=0.01),
    )
    before = threading.active_count()
    for _ in range(3):
        camera.start()
        camera.stop()
    for _ in range(20):
        with pytest.raises(AdapterError, match="the camera /dev/video0 hangs"):
            camera.start()
        camera.stop()
    assert threading.active_count() == before + 3
    goes_on.set()
    assert eventually(lambda: threading.active_count() == before)
    camera.start()
    assert eventually(lambda: camera.failed)
    camera.stop()
