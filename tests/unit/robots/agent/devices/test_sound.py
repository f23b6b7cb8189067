"""Sound that FFmpeg reads, and errors of alsa-utils. Real sound servers: test_sound_servers.py."""

import numpy as np
import pytest

from robots.agent.devices import alsa, device_address
from robots.agent.devices.microphone import BLOCK, RATE, DeviceMicrophone

TONE = 440.0  # Hz


def pitch(samples: np.ndarray) -> float:
    """Return the strongest frequency in Hz."""
    return float(np.argmax(np.abs(np.fft.rfft(samples))) * RATE / len(samples))


def recorded(source: DeviceMicrophone, blocks: int) -> np.ndarray:
    found = [block for block in (source.read(1.0) for _ in range(60)) if block is not None][:blocks]
    assert {block.shape for block in found} == {(BLOCK,)}
    assert {block.dtype for block in found} == {np.dtype(np.int16)}
    return np.concatenate(found)


@pytest.mark.slow
def test_other_rates_and_two_channels_become_mono_at_48_khz():
    sine = "lavfi:sine=frequency=440:sample_rate=22050,aformat=channel_layouts=stereo"
    microphone = DeviceMicrophone(device_address.read(sine, "microphone"))
    microphone.start()
    samples = recorded(microphone, 25)
    microphone.stop()
    assert pitch(samples[2 * BLOCK :]) == pytest.approx(TONE, abs=8.0)


@pytest.mark.parametrize(
    ("output", "reason"),
    [
        (
            (
                "ALSA lib pcm.c:2666:(snd_pcm_open_noupdate) Unknown PCM basement\narecord:"
                " main:831: audio open error: No such file or directory\n"
            ),
            "there is no such device",
        ),
        (
            "aplay: main:831: audio open error: Device or resource busy\n",
            "another program is using it",
        ),
        (
            "aplay: main:831: audio open error: Permission denied\n",
            "the agent's user may not use it: add the user to the group audio",
        ),
        (
            (
                "arecord: set_params:1416: Unable to install hw params:\nACCESS: "
                " RW_INTERLEAVED\nFORMAT:  S16_LE\n"
            ),
            "it cannot be opened",
        ),
        ("arecord: pcm_read:2221: read error: Something new\n", "Something new"),
        ("ALSA lib confmisc.c:165:(snd_config_get_card) Cannot get card index for 7\n", ""),
    ],
)
def test_the_reason_is_found_in_the_output_of_alsa_utils(output, reason):
    """alsa-utils 1.2.8, aplay/aplay.c: `error()` writes `PROGRAM: FUNCTION:LINE: TEXT`; the line
    numbers are of that version.
    """
    assert alsa.reason_in(output) == reason
