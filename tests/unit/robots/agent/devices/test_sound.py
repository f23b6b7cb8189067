"""Microphones and loudspeakers: the real ALSA, with files in the place of its hardware."""

import numpy as np
import pytest

from robots.agent.adapters.contract import AdapterError
from robots.agent.devices import words
from robots.agent.devices.loudspeaker import DeviceLoudspeaker
from robots.agent.devices.microphone import BLOCK, RATE, DeviceMicrophone

CONFIGURATION = """
pcm.loudspeaker { type file slave.pcm nothing file "FOLDER/heard.raw" format raw }
pcm.microphone { type file slave.pcm nothing file "/dev/null" infile "FOLDER/said.raw" format raw }
pcm.nothing { type null }
"""
TONE = 440.0  # Hz


def tone(samples: int) -> np.ndarray:
    return (10_000 * np.sin(2 * np.pi * TONE / RATE * np.arange(samples))).astype(np.int16)


def pitch(samples: np.ndarray) -> float:
    """Return the strongest frequency in Hz."""
    return float(np.argmax(np.abs(np.fft.rfft(samples))) * RATE / len(samples))


@pytest.fixture
def alsa(tmp_path, monkeypatch):
    (tmp_path / "asound.conf").write_text(CONFIGURATION.replace("FOLDER", str(tmp_path)))
    monkeypatch.setenv("ALSA_CONFIG_PATH", str(tmp_path / "asound.conf"))
    return tmp_path


def heard(source: DeviceMicrophone, blocks: int) -> np.ndarray:
    found = [block for block in (source.read(1.0) for _ in range(60)) if block is not None][:blocks]
    assert {block.shape for block in found} == {(BLOCK,)}
    assert {block.dtype for block in found} == {np.dtype(np.int16)}
    return np.concatenate(found)


def test_a_tone_goes_through_the_loudspeaker(alsa):
    loudspeaker = DeviceLoudspeaker(words.read("alsa:loudspeaker", "loudspeaker"))
    loudspeaker.start()
    for block in np.split(tone(RATE), 50):
        loudspeaker.play(block)
    loudspeaker.stop()
    sides = np.fromfile(alsa / "heard.raw", np.int16).reshape(-1, 2)
    assert (sides[:, 0] == sides[:, 1]).all()
    assert pitch(sides[:, 0][-RATE // 2 :]) == pytest.approx(TONE, abs=4.0)


def test_a_tone_comes_through_the_microphone(alsa):
    tone(4 * RATE).tofile(alsa / "said.raw")
    microphone = DeviceMicrophone(words.read("alsa:microphone channels=1 sample_rate=48000", "microphone"))
    microphone.start()
    samples = heard(microphone, 25)
    microphone.stop()
    assert pitch(samples[BLOCK:]) == pytest.approx(TONE, abs=8.0)


def test_other_rates_and_two_channels_become_mono_at_48_khz():
    microphone = DeviceMicrophone(words.read("lavfi:sine=frequency=440:sample_rate=22050,aformat=channel_layouts=stereo", "microphone"))
    microphone.start()
    samples = heard(microphone, 25)
    microphone.stop()
    assert pitch(samples[2 * BLOCK :]) == pytest.approx(TONE, abs=8.0)


def test_a_loudspeaker_that_is_not_there_is_said_in_a_sentence(alsa):
    loudspeaker = DeviceLoudspeaker(words.read("alsa:basement", "loudspeaker"))
    with pytest.raises(AdapterError, match="the loudspeaker basement cannot be used: "):
        loudspeaker.start()
    with pytest.raises(AdapterError, match="is not open"):
        loudspeaker.play(tone(BLOCK))
    loudspeaker.stop()


def test_a_microphone_that_is_not_there_is_said_in_a_sentence(alsa):
    microphone = DeviceMicrophone(words.read("alsa:basement", "microphone"))
    microphone.start()
    with pytest.raises(AdapterError, match="the microphone basement cannot be read: "):
        [microphone.read(0.5) for _ in range(60)]
    microphone.stop()
