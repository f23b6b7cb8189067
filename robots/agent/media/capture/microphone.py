"""The robot's microphone as the media side uses it: encoded sound for listeners."""

from collections.abc import Callable

from robots.agent.media.capture.capture import Capture, CaptureState
from robots.agent.media.capture.sound import SoundEncoder
from robots.agent.robot_interface import AudioSource


class MicrophoneFeed:
    """Reads, encodes and delivers sound while there are listeners.

    Args:
        source: the microphone.
        deliver: called in the microphone's thread with (payload, RTP ticks) of every 20 ms that are
            not silent.
    """

    def __init__(self, source: AudioSource, deliver: Callable[[bytes, int], None]) -> None:
        self._source = source
        self._deliver = deliver
        self._encoder = SoundEncoder()
        self._capture = Capture("microphone", source, lambda: None, self._step)

    @property
    def state(self) -> CaptureState:
        """Return how the microphone is."""
        return self._capture.state

    def start(self) -> None:
        """Start the microphone's thread; the microphone itself starts with the first listener."""
        self._capture.start()

    def close(self) -> None:
        """Stop the microphone and its thread."""
        self._capture.close()

    def listen(self, number: int) -> None:
        """Say that `number` more listen, fewer when negative."""
        self._capture.want(number)

    def _step(self, timeout: float) -> bool:
        samples = self._source.read(timeout)
        if samples is None:
            return False
        sound = self._encoder.encode(samples)
        if sound is not None:
            self._deliver(*sound)
        return True
