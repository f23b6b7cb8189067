"""A robot's camera, microphone and loudspeaker: the devices named in its settings, otherwise the
architecture's. With `page` the browser of the robot's own screen provides video and sound.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from robots.agent.config import AgentConfig, ConfigError
from robots.agent.devices import device_address
from robots.agent.devices.alsa import AlsaLoudspeaker, AlsaMicrophone
from robots.agent.devices.camera import DeviceCamera
from robots.agent.devices.microphone import DeviceMicrophone
from robots.agent.robot_interface import (
    FROM_PAGE,
    Adapter,
    AudioSource,
    FromPage,
    Outputs,
    VideoSource,
    outputs_of,
)

Device = TypeVar("Device")


@dataclass(frozen=True)
class Equipment:
    """Camera, microphone, and (loudspeaker, display); None for each that is missing."""

    video: VideoSource | FromPage | None
    audio: AudioSource | FromPage | None
    outputs: Outputs


def equipment_of(adapter: Adapter, config: AgentConfig) -> Equipment:
    """Return the devices, not opened yet. Raises ConfigError with one sentence for an invalid name;
    later errors are reported as reasons of missing video or sound.
    """
    speaker, display = outputs_of(adapter)
    video: VideoSource | FromPage | None = FROM_PAGE
    if config.camera != FROM_PAGE:
        video = _device(config.camera, "camera", DeviceCamera, adapter.video)
    audio: AudioSource | FromPage | None = FROM_PAGE
    if config.microphone != FROM_PAGE:
        audio = _device(config.microphone, "microphone", _microphone, adapter.audio)
    speaker = _device(config.loudspeaker, "loudspeaker", AlsaLoudspeaker, lambda: speaker)
    return Equipment(video, audio, (speaker, display))


def _microphone(named: device_address.DeviceSetting) -> AudioSource:
    return AlsaMicrophone(named) if named.format == device_address.ALSA else DeviceMicrophone(named)


def _device(
    address: str,
    kind: device_address.Kind,
    make: Callable[[device_address.DeviceSetting], Device],
    otherwise: Callable[[], Device | None],
) -> Device | None:
    if not address:
        return otherwise()
    try:
        named = device_address.read(address, kind)
    except device_address.DeviceSettingError as error:
        raise ConfigError(str(error)) from error
    return make(named) if named is not None else None
