"""One Opus encoder a microphone: 20 ms of mono in, one RTP payload out, the same for every
listener; silence costs nothing.

Opus in its low-delay mode (CELT alone): it takes a third of the processor time of the speech mode,
and 4 ms less of the listener's patience. Silence is not encoded at all: libopus spends more on it
than on noise, and a listener's jitter buffer fades out by itself.
"""

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import av
import numpy as np
import numpy.typing as npt

from robots.agent.media.capture.capture import Capture
from robots.agent.media.rtp import AUDIO_RATE
from robots.agent.robot_interface import AudioSource

BLOCK = 960  # samples: 20 ms at 48 kHz
BITRATE = 40_000
SILENCE = 16  # the largest sample that counts as silence: -66 dB of full scale
HANGOVER = 10  # silent blocks that are still sent, so that a voice fades out whole


class SoundEncoder:
    """Opus at 40 kbit/s. Not thread-safe: it belongs to the thread of its microphone."""

    def __init__(self) -> None:
        self._codec = _open_opus()
        self._samples = 0
        self._silent_blocks = HANGOVER

    def encode(self, samples: npt.NDArray[np.int16]) -> tuple[bytes, int] | None:
        """Encode 960 samples; return (payload, RTP ticks of 1/48000 s from 0), or None for silence.

        Raises:
            ValueError: not 960 samples of int16.
            av.FFmpegError: the encoder failed.
        """
        if samples.dtype != np.int16 or samples.size != BLOCK:
            raise ValueError(
                f"{samples.size} samples of {samples.dtype} instead of {BLOCK} of int16"
            )
        ticks, self._samples = self._samples, self._samples + BLOCK
        silent = int(samples.min()) >= -SILENCE and int(samples.max()) <= SILENCE
        self._silent_blocks = self._silent_blocks + 1 if silent else 0
        if self._silent_blocks > HANGOVER:
            return None
        block = av.AudioFrame.from_ndarray(
            np.ascontiguousarray(samples.reshape(1, BLOCK)), format="s16", layout="mono"
        )
        block.sample_rate, block.time_base, block.pts = AUDIO_RATE, Fraction(1, AUDIO_RATE), ticks
        payload = b"".join(bytes(packet) for packet in self._codec.encode(block))
        return (payload, ticks) if payload else None


def _open_opus() -> Any:
    codec: Any = av.CodecContext.create("libopus", "w")
    codec.sample_rate, codec.format, codec.layout = AUDIO_RATE, "s16", "mono"
    codec.bit_rate, codec.time_base = BITRATE, Fraction(1, AUDIO_RATE)
    codec.options = {"application": "lowdelay", "frame_duration": "20", "compression_level": "2"}
    codec.open()
    return codec


class MicrophoneFeed(Capture):
    """Reads, encodes and delivers sound while there are listeners.

    `deliver` is called in the microphone's thread with (payload, RTP ticks) of every 20 ms that are
    not silent.
    """

    def __init__(self, source: AudioSource, deliver: Callable[[bytes, int], None]) -> None:
        super().__init__("microphone", source, lambda: None, self._read_block)
        self._microphone = source
        self._deliver = deliver
        self._encoder = SoundEncoder()

    listen = Capture.want

    def _read_block(self, timeout: float) -> bool:
        samples = self._microphone.read(timeout)
        if samples is None:
            return False
        sound = self._encoder.encode(samples)
        if sound is not None:
            self._deliver(*sound)
        return True
