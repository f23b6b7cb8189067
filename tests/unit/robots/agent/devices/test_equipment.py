"""Whose camera, microphone and loudspeaker a robot has."""

from pathlib import Path

import pytest

from robots.agent.adapters import registry
from robots.agent.agent import factsheet_of
from robots.agent.config import ConfigError, load
from robots.agent.devices.alsa import AlsaLoudspeaker, AlsaMicrophone
from robots.agent.devices.camera import DeviceCamera
from robots.agent.devices.equipment import equipment_of
from robots.agent.devices.microphone import DeviceMicrophone
from robots.agent.robot_interface import FROM_PAGE

ENVIRONMENT = {"TELEPRESENCE_MICROPHONE": "alsa:default"}


def equipped(adapter, **arguments):
    config = load({"robot": "giraff", "mqtt_url": "mqtt://127.0.0.1:1", **arguments}, ENVIRONMENT)
    return equipment_of(adapter, config), config


@pytest.fixture
def giraff():
    """The paper's Giraff, whose architecture has no camera, microphone or loudspeaker."""
    return registry.create("moos", "giraff")


def test_devices_are_named_by_command_line_environment_and_file(giraff, tmp_path):
    path = Path(tmp_path) / "giraff.toml"
    path.write_text('loudspeaker = "alsa:hw:1"\n')
    equipment, _ = equipped(giraff, camera="/dev/video0", credentials=path)
    assert isinstance(equipment.video, DeviceCamera)
    assert isinstance(equipment.audio, AlsaMicrophone)
    assert isinstance(equipment.outputs[0], AlsaLoudspeaker)
    assert equipment.outputs[1] is None
    assert isinstance(equipped(giraff, microphone="talk.mp4")[0].audio, DeviceMicrophone)


def test_a_named_camera_is_in_the_factsheet_with_its_direction(giraff):
    equipment, config = equipped(giraff, camera="/dev/video0")
    sheet = factsheet_of(giraff, equipment, config, "b")
    assert {"photo", "video", "audio"} <= set(sheet.capabilities)
    assert sheet.camera.hfov == 1.5


def test_a_factsheet_without_a_camera_names_none(giraff):
    equipment, config = equipped(giraff)
    sheet = factsheet_of(giraff, equipment, config, "b")
    assert equipment.video is None
    assert not {"photo", "video"} & set(sheet.capabilities)
    assert sheet.camera is None


def test_devices_of_the_architecture_are_the_default():
    simulated = registry.create("simulator", "giraff")
    assert equipped(simulated)[0].video is simulated.video()
    assert equipped(simulated)[0].outputs == (simulated.speaker(), simulated.display())
    without, _ = equipped(simulated, camera="none", microphone="none", loudspeaker="none")
    assert (without.video, without.audio) == (None, None)
    assert without.outputs == (None, simulated.display())


def test_the_page_of_the_robots_screen_may_give_both(giraff):
    equipment, config = equipped(giraff, camera="page", microphone="page")
    assert (equipment.video, equipment.audio) == (FROM_PAGE, FROM_PAGE)
    assert {"photo", "video", "audio"} <= set(
        factsheet_of(giraff, equipment, config, "b").capabilities
    )


def test_a_device_without_an_address_is_refused_with_a_sentence(giraff):
    with pytest.raises(ConfigError, match="the camera 'v4l2:' has no address"):
        equipped(giraff, camera="v4l2:")
