"""The robot's microphone: mono in, one RTP payload out, the same for every listener; silence costs
nothing.

Opus in its low-delay mode (CELT alone): it takes a third of the processor time of the speech mode,
and 4 ms less of the listener's patience. Silence is not encoded at all: libopus spends more on it
than on noise, and a listener's jitter buffer fades out by itself.

For a narrow network there is a second encoder: speech mode, and long packets, because the headers
of fifty packets a second take as much as the speech.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import av
import numpy as np
import numpy.typing as npt

from robots.agent.media.capture.capture import Capture
from robots.agent.media.rtp import AUDIO_RATE
from robots.agent.robot_interface import AudioSource

BLOCK = 960  # samples: 20 ms at 48 kHz
SILENCE = 16  # the largest sample that counts as silence: -66 dB of full scale
HANGOVER = 10  # silent packets that are still sent, so that a voice fades out whole


@dataclass(frozen=True)
class SoundQuality:
    """Blocks of 20 ms a packet, bit/s, and libopus' mode."""

    blocks: int
    bitrate: int
    mode: str


WIDE = SoundQuality(blocks=1, bitrate=40_000, mode="lowdelay")
NARROW = SoundQuality(blocks=3, bitrate=16_000, mode="voip")


class SoundEncoder:
    """Not thread-safe: it belongs to the thread of its microphone."""

    def __init__(self, quality: SoundQuality = WIDE) -> None:
        self._quality = quality
        self._codec = _open_opus(quality)
        self._blocks: list[npt.NDArray[np.int16]] = []  # of the next packet
        self._samples = 0
        self._silent_packets = HANGOVER

    def encode(self, samples: npt.NDArray[np.int16]) -> tuple[bytes, int] | None:
        """Encode 960 samples; return (payload, RTP ticks of 1/48000 s from 0), or None for silence
        and until a packet is complete.

        Raises:
            ValueError: not 960 samples of int16.
            av.FFmpegError: the encoder failed.
        """
        if samples.dtype != np.int16 or samples.size != BLOCK:
            raise ValueError(
                f"{samples.size} samples of {samples.dtype} instead of {BLOCK} of int16"
            )
        self._samples += BLOCK
        self._blocks.append(samples.reshape(1, BLOCK))
        if len(self._blocks) < self._quality.blocks:
            return None
        whole = np.ascontiguousarray(np.concatenate(self._blocks, axis=1))
        self._blocks.clear()
        ticks = self._samples - whole.size
        silent = int(whole.min()) >= -SILENCE and int(whole.max()) <= SILENCE
        self._silent_packets = self._silent_packets + 1 if silent else 0
        if self._silent_packets > HANGOVER:
            return None
        block = av.AudioFrame.from_ndarray(whole, format="s16", layout="mono")
        block.sample_rate, block.time_base, block.pts = AUDIO_RATE, Fraction(1, AUDIO_RATE), ticks
        payload = b"".join(bytes(packet) for packet in self._codec.encode(block))
        return (payload, ticks) if payload else None

    def skip(self) -> None:
        """Let 20 ms pass without a listener."""
        self._samples += BLOCK
        self._blocks.clear()


def _open_opus(quality: SoundQuality) -> Any:
    codec: Any = av.CodecContext.create("libopus", "w")
    codec.sample_rate, codec.format, codec.layout = AUDIO_RATE, "s16", "mono"
    codec.bit_rate, codec.time_base = quality.bitrate, Fraction(1, AUDIO_RATE)
    duration = str(20 * quality.blocks)
    codec.options = {
        "application": quality.mode,
        "frame_duration": duration,
        "compression_level": "2",
    }
    codec.open()
    return codec


class MicrophoneFeed(Capture):
    """Reads, encodes and delivers sound while there are listeners, once for all of a quality.

    `deliver` is called in the microphone's thread with (payload, RTP ticks, whether it is for
    narrow networks) of all packets that are not silent.
    """

    def __init__(self, source: AudioSource, deliver: Callable[[bytes, int, bool], None]) -> None:
        super().__init__("microphone", source, lambda: None, self._read_block)
        self._microphone = source
        self._deliver = deliver
        self._encoders = {False: SoundEncoder(WIDE), True: SoundEncoder(NARROW)}
        self._listeners = {False: 0, True: 0}

    def listen(self, number: int, *, narrow: bool = False) -> None:
        self._listeners[narrow] += number
        self.want(number)

    def _read_block(self, timeout: float) -> bool:
        samples = self._microphone.read(timeout)
        if samples is None:
            return False
        for narrow, encoder in self._encoders.items():
            if not self._listeners[narrow]:
                encoder.skip()
            elif (sound := encoder.encode(samples)) is not None:
                self._deliver(*sound, narrow)
        return True
