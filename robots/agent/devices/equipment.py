"""What a robot sees, hears and speaks with: devices of the agent's computer where some are named,
the architecture's otherwise.

`page` is the page of the robot's own screen: the browser that shows it gives picture and sound, and
the agent passes them on.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from robots.agent.config import AgentConfig, ConfigError
from robots.agent.devices import words
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
    """Camera, microphone, and (loudspeaker, display); None for each that there is not."""

    video: VideoSource | FromPage | None
    audio: AudioSource | FromPage | None
    outputs: Outputs


def equipment_of(adapter: Adapter, config: AgentConfig) -> Equipment:
    """Return the devices, not opened yet; later errors are the reasons of missing video or sound.

    Raises:
        ConfigError: no device is named like this; one sentence.
    """
    speaker, display = outputs_of(adapter)
    return Equipment(
        video=FROM_PAGE
        if config.camera == FROM_PAGE
        else _device(config.camera, "camera", DeviceCamera, adapter.video),
        audio=FROM_PAGE
        if config.microphone == FROM_PAGE
        else _device(config.microphone, "microphone", _microphone, adapter.audio),
        outputs=(
            _device(config.loudspeaker, "loudspeaker", AlsaLoudspeaker, lambda: speaker),
            display,
        ),
    )


def _microphone(named: words.DeviceSetting) -> AudioSource:
    return AlsaMicrophone(named) if named.format == words.ALSA else DeviceMicrophone(named)


def _device(
    said: str,
    kind: words.Kind,
    make: Callable[[words.DeviceSetting], Device],
    otherwise: Callable[[], Device | None],
) -> Device | None:
    if not said:
        return otherwise()
    try:
        named = words.read(said, kind)
    except words.DeviceSettingError as error:
        raise ConfigError(str(error)) from error
    return make(named) if named is not None else None
