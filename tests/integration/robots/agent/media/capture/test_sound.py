"""The sound encoder."""

import numpy as np
import pytest
from av import AudioFrame, CodecContext, Packet

from robots.agent.media.capture.sound import BLOCK, HANGOVER, SoundEncoder

TONE = (8000 * np.sin(2 * np.pi * 480 * np.arange(BLOCK) / 48_000)).astype(np.int16)


def test_tone_is_decoded_with_its_frequency() -> None:
    encoder = SoundEncoder()
    codec = CodecContext.create("libopus", "r")
    codec.format, codec.layout, codec.sample_rate = "s16", "mono", 48_000
    decoded: list[AudioFrame] = []
    for _ in range(20):
        decoded += codec.decode(Packet(encoder.encode(TONE)[0]))
    spectrum = np.abs(np.fft.rfft(decoded[-1].to_ndarray().ravel().astype(float)))
    assert np.argmax(spectrum) * 48_000 / BLOCK == pytest.approx(480, abs=50)


def test_silence_is_not_sent_and_timestamps_advance() -> None:
    encoder = SoundEncoder()
    silence = np.zeros(BLOCK, np.int16)
    assert encoder.encode(silence) is None
    assert encoder.encode(TONE)[1] == BLOCK
    sent = [encoder.encode(silence) is not None for _ in range(HANGOVER + 5)]
    assert sent == [True] * HANGOVER + [False] * 5, "the end of a voice was cut off"
    assert encoder.encode(TONE)[1] == (2 + HANGOVER + 5) * BLOCK


@pytest.mark.parametrize("samples", [np.zeros(480, np.int16), np.zeros(BLOCK, np.float32)])
def test_block_of_another_length_or_type_is_refused(samples) -> None:
    with pytest.raises(ValueError):
        SoundEncoder().encode(samples)
