"""Microphone and loudspeaker of Linux through arecord and aplay.

Each is a child process instead of FFmpeg's own ALSA. The one in PyAV's wheel has folders under the
temporary directory compiled in, where any user may put a configuration that loads code, and it
passes the system's plug-ins structures of another version of libasound. alsa-utils belongs to the
system's libasound, and a program that hangs or crashes does not stop the robot.

https://www.alsa-project.org/alsa-doc/alsa-lib/pcm_plugins.html: `plug` converts any device to our
rate and number of channels.
"""

import os
import select
import subprocess
import time
from dataclasses import dataclass
from typing import IO, Literal

import numpy as np
import numpy.typing as npt
import structlog

from robots.agent.devices.device_address import DeviceSetting
from robots.agent.robot_interface import AdapterError

log = structlog.stdlib.get_logger(__name__)

RATE, BLOCK = 48_000, 960  # samples a second, and in 20 ms
WIDTH = 2  # bytes a sample, S16_LE
PACKAGES = "alsa-utils libasound2-plugins"
# of what `arecord -L` lists: names of devices, and none of converters
CARDS = ("default", "pulse", "pipewire", "hw:")
# What arecord and aplay (alsa-utils, aplay/aplay.c) say last, in words for the robot's owner.
REASONS = {
    "No such file or directory": "there is no such device",
    "No such device": "there is no such device",
    "Device or resource busy": "another program is using it",
    "Connection refused": "the sound server is not running",
    "Input/output error": "it is gone",
    "Unable to install hw params": "it cannot be opened",
    "Permission denied": "the agent's user may not use it: add the user to the group audio",
}


@dataclass(frozen=True)
class AlsaLimits:
    """Times in seconds, sizes in samples."""

    device_buffer: float = 0.1  # what the device keeps, each way
    period: float = 0.02
    waiting: int = 10 * BLOCK  # recorded and not fetched: more is dropped, the oldest first
    pipe: int = 2048  # written and not played: the smallest pipe that Linux makes, 43 ms
    opening: float = 5.0  # a sound server that wakes a device needs seconds
    full: float = 1.0  # a device that is open and takes nothing for so long hangs
    ending: float = 0.5  # to play the rest, and to end
    listing: float = 3.0  # to name the devices that there are


LIMITS = AlsaLimits()
Program = Literal["arecord", "aplay"]


class _AlsaDevice:
    program: Program
    name: str

    def __init__(self, words: DeviceSetting) -> None:
        self._words = words
        self._child: _Child | None = None

    def start(self) -> None:
        """Open the device; idempotent. Raises AdapterError when its program is not installed; other
        errors are raised on its use.
        """
        if self._child is None:
            self._child = _Child(self.program, self.name, self._words.address)

    def stop(self) -> None:
        """Play the rest, if it plays, and close the device; idempotent."""
        child, self._child = self._child, None
        if child is not None:
            child.end()


class AlsaMicrophone(_AlsaDevice):
    """See robot_interface.AudioSource. Belongs to one thread."""

    program, name = "arecord", "microphone"

    def __init__(self, words: DeviceSetting) -> None:
        super().__init__(words)
        self._recorded = bytearray()

    def stop(self) -> None:
        super().stop()
        self._recorded.clear()

    def read(self, timeout: float) -> npt.NDArray[np.int16] | None:
        """Block for 20 ms, (960,), for `timeout` s at most; None without data, or AdapterError."""
        if self._child is None:
            return None
        deadline = time.monotonic() + timeout
        while len(self._recorded) < BLOCK * WIDTH:
            if not self._child.is_ready(max(0.0, deadline - time.monotonic())):
                return None
            self._recorded += self._child.read()
        late = len(self._recorded) - LIMITS.waiting * WIDTH
        if late > 0:
            del self._recorded[: late // WIDTH * WIDTH]
        block = np.frombuffer(bytes(self._recorded[: BLOCK * WIDTH]), "<i2").astype(np.int16)
        del self._recorded[: BLOCK * WIDTH]
        return block


class AlsaLoudspeaker(_AlsaDevice):
    """See robot_interface.Speaker. Belongs to one thread."""

    program, name = "aplay", "loudspeaker"

    def play(self, samples: npt.NDArray[np.int16]) -> None:
        """Play (n,) mono at 48 kHz, waiting while the device is full; raises AdapterError."""
        if self._child is None:
            raise AdapterError(f"the {self.name} {self._words.address} is not open")
        self._child.write(samples.astype("<i2").tobytes())


class _Child:
    """A running arecord or aplay, and its last messages; AdapterError when not installed."""

    def __init__(self, program: Program, name: str, address: str) -> None:
        self._program, self._name, self._address = program, name, address
        self._output = b""
        self._began = time.monotonic()
        options = {
            "device": f"plug:'{address}'",
            "file-type": "raw",
            "format": "S16_LE",
            "rate": RATE,
            "channels": 1,
            "buffer-time": round(LIMITS.device_buffer * 1e6),  # microseconds
            "period-time": round(LIMITS.period * 1e6),
        }
        command = (program, "--quiet", *(f"--{name}={of}" for name, of in options.items()))
        records = program == "arecord"
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL if records else subprocess.PIPE,
                stdout=subprocess.PIPE if records else subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                bufsize=0,
                pipesize=-1 if records else LIMITS.pipe * WIDTH,
                env={**os.environ, "LC_ALL": "C"},
                start_new_session=True,  # Ctrl-C is for the agent, which ends it in its own time
            )
        except FileNotFoundError as error:
            missing = f"{program} is not installed; run sudo apt install {PACKAGES}"
            raise AdapterError(f"the {name} {address} cannot be used: {missing}") from error
        except OSError as error:
            raise AdapterError(f"the {name} {address} cannot be used: {error.strerror}") from error
        assert self._process.stderr is not None
        os.set_blocking(self._process.stderr.fileno(), False)
        if self._process.stdin is not None:
            os.set_blocking(self._process.stdin.fileno(), False)

    def is_ready(self, timeout: float) -> bool:
        """Wait for recorded sound, or the program's end, for `timeout` seconds at most."""
        return bool(select.select([_file(self._process.stdout)], [], [], timeout)[0])

    def read(self) -> bytes:
        """Return what was recorded; raises AdapterError when the program has ended."""
        self._listen()
        data = os.read(_file(self._process.stdout).fileno(), LIMITS.waiting * WIDTH)
        if not data:
            raise self._failure()
        return data

    def write(self, data: bytes) -> None:
        """Play this, waiting while it is full; AdapterError when it has ended or takes nothing."""
        left = memoryview(data)
        while left:
            self._listen()
            patience = max(LIMITS.full, self._began + LIMITS.opening - time.monotonic())
            if not select.select([], [_file(self._process.stdin)], [], patience)[1]:
                raise AdapterError(f"the {self._name} {self._address} does not accept sound")
            try:
                left = left[os.write(_file(self._process.stdin).fileno(), left) :]
            except BlockingIOError:
                continue
            except BrokenPipeError as error:
                raise self._failure() from error

    def end(self) -> None:
        """End it, by force if necessary."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        else:
            self._process.terminate()
        try:
            self._process.wait(LIMITS.ending)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._wait()
        for file in (self._process.stdout, self._process.stderr):
            if file is not None:
                file.close()

    def _wait(self) -> None:
        try:
            self._process.wait(LIMITS.ending)
        except subprocess.TimeoutExpired:
            log.warning("device_hung", name=self._name, address=self._address)

    def _listen(self) -> None:
        """Keep the end of its messages; a full pipe would stop it."""
        assert self._process.stderr is not None
        try:
            while output := os.read(self._process.stderr.fileno(), 4096):
                self._output = (self._output + output)[-4096:]
        except BlockingIOError:
            pass

    def _failure(self) -> AdapterError:
        self._wait()
        self._listen()
        reason = reason_in(self._output.decode(errors="replace")) or f"{self._program} has ended"
        available = ", ".join(devices(self._program)) or "none"
        problem = f"the {self._name} {self._address} cannot be used: {reason}"
        return AdapterError(f"{problem}; available: {available}")


def reason_in(output: str) -> str:
    """Return the reason in the last message of arecord or aplay, "" without one, such as `aplay:
    main:831: audio open error: Device or resource busy`.
    """
    lines = [line for line in output.splitlines() if line.startswith(("arecord: ", "aplay: "))]
    reason = lines[-1].rpartition(": ")[2].strip(" :") if lines else ""
    return REASONS.get(reason, reason)


def devices(program: Program) -> tuple[str, ...]:
    """Return the devices that a person would choose; none when the listing fails."""
    try:
        listing = subprocess.run(
            (program, "-L"), capture_output=True, text=True, timeout=LIMITS.listing, check=False
        ).stdout
    except (OSError, subprocess.TimeoutExpired):
        return ()
    return tuple(line for line in listing.splitlines() if line.startswith(CARDS))


def _file(file: IO[bytes] | None) -> IO[bytes]:
    assert file is not None
    return file
