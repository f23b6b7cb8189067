"""A person's sound server as Debian has it, with a silent card: PulseAudio, or PipeWire with its
session manager.
"""

import contextlib
import os
import signal
import subprocess
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from tests.support.agents.simulators import eventually

Kind = Literal["pulseaudio", "pipewire"]
RATE = 48_000
PROTOCOL = "module-native-protocol-unix"
RAW = ("--raw", "--format=s16le", f"--rate={RATE}", "--channels=1", "--latency-msec=50")
PROGRAMS: dict[Kind, tuple[tuple[str, ...], ...]] = {
    "pulseaudio": (("pulseaudio", "-n", "--daemonize=no", "--exit-idle-time=-1", "-L", PROTOCOL),),
    "pipewire": (
        ("dbus-daemon", "--session", "--nofork", "--address=unix:path={run}/bus"),
        ("pipewire",),
        ("pipewire-pulse",),
        ("wireplumber",),
    ),
}


def environment_of(home: Path) -> dict[str, str]:
    """Return the environment of a person's processes, without the variables of the tests."""
    return {
        "PATH": os.environ["PATH"],
        "HOME": str(home),
        "XDG_RUNTIME_DIR": str(home / "run"),
        "LANG": "C.UTF-8",
    }


class SoundServer:
    """Runs in a home of its own; the card is `robot`, and `robot.monitor` has its output."""

    def __init__(self, kind: Kind, home: Path) -> None:
        self.kind, self.home = kind, home
        self.environment = environment_of(home)
        self._programs: list[subprocess.Popen] = []
        (home / "run").mkdir(mode=0o700)

    def start(self) -> None:
        bus = {"DBUS_SESSION_BUS_ADDRESS": f"unix:path={self.home}/run/bus"}
        environment = self.environment | (bus if self.kind == "pipewire" else {})
        for command in PROGRAMS[self.kind]:
            with (self.home / f"{command[0]}.log").open("ab") as log:
                words = [word.format(run=self.home / "run") for word in command]
                program = subprocess.Popen(words, env=environment, stdout=log, stderr=log)
                self._programs.append(program)
            if command[0] == "dbus-daemon":
                assert eventually((self.home / "run/bus").exists)
        assert eventually(lambda: self._pactl("info").returncode == 0, 30.0), "no sound server"
        if (
            self.kind == "pipewire"
        ):  # a card that is added before the session manager may stay unused
            assert eventually(
                lambda: "WirePlumber [export]" in self._pactl("list", "clients").stdout, 30.0
            ), self._programs_now()
        self.plug()

    def _programs_now(self) -> dict[str, int | None]:
        """Return the exit codes of the server's programs, None of those that run."""
        return {str(program.args[0]): program.poll() for program in self._programs}

    def plug(self) -> None:
        assert self._pactl("load-module", "module-null-sink", "sink_name=robot").returncode == 0
        assert eventually(
            lambda: "Default Source: robot.monitor" in self._pactl("info").stdout, 30.0
        ), (self._programs_now(), self._pactl("info").stdout)

    def unplug(self) -> None:
        assert self._pactl("unload-module", "module-null-sink").returncode == 0

    def freeze(self) -> None:
        for program in self._programs:
            program.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        for program in self._programs:
            program.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        for program in reversed(self._programs):
            program.kill()
            program.wait()
        self._programs.clear()

    @contextlib.contextmanager
    def playing(self, tone: float) -> Iterator[None]:
        """Play a tone in Hz on the card during the block, with the server's own client."""
        command = ("pacat", "--playback", *RAW)
        player = subprocess.Popen(command, env=self.environment, stdin=subprocess.PIPE, bufsize=0)
        second = sine(tone, RATE).tobytes()
        threading.Thread(target=self._feed, args=(player, second), daemon=True).start()
        try:
            yield
        finally:
            player.kill()
            player.wait()

    @contextlib.contextmanager
    def listening(self) -> Iterator["Ear"]:
        """Record the output of the card with the server's own client."""
        command = ("parec", *RAW, "--device=robot.monitor")
        recorder = subprocess.Popen(
            command, env=self.environment, stdout=subprocess.PIPE, bufsize=0
        )
        try:
            yield Ear(recorder)
        finally:
            recorder.kill()
            recorder.wait()

    def _feed(self, player: subprocess.Popen, second: bytes) -> None:
        with contextlib.suppress(OSError):
            while True:
                player.stdin.write(second)

    def _pactl(self, *words: str) -> subprocess.CompletedProcess:
        return subprocess.run(
            ("pactl", *words), env=self.environment, capture_output=True, text=True, check=False
        )


class Ear:
    """The last second that was recorded."""

    def __init__(self, recorder: subprocess.Popen) -> None:
        self._samples = bytearray()
        self._lock = threading.Lock()
        threading.Thread(target=self._listen, args=(recorder,), daemon=True).start()

    def hears(self, tone: float) -> bool:
        """Tell whether the last half second was this tone."""
        with self._lock:
            samples = np.frombuffer(bytes(self._samples[-RATE:]), np.int16)
        return len(samples) == RATE // 2 and is_tone(samples, tone)

    def _listen(self, recorder: subprocess.Popen) -> None:
        while data := recorder.stdout.read(4096):
            with self._lock:
                self._samples += data
                del self._samples[: -2 * RATE]


def sine(tone: float, samples: int) -> np.ndarray:
    return (10_000 * np.sin(2 * np.pi * tone / RATE * np.arange(samples))).astype(np.int16)


def is_tone(samples: np.ndarray, tone: float) -> bool:
    """Tell whether samples, (n,), are loud and this is the strongest frequency in Hz."""
    step = RATE / len(samples)
    strongest = float(np.argmax(np.abs(np.fft.rfft(samples)))) * step
    return np.abs(samples).max() > 1000 and abs(strongest - tone) < 2 * step


@contextlib.contextmanager
def sound_server(kind: Kind, home: Path) -> Iterator[SoundServer]:
    server = SoundServer(kind, home)
    try:
        server.start()
        yield server
    finally:
        server.thaw()
        server.kill()


def use_environment(monkeypatch: pytest.MonkeyPatch, environment: Mapping[str, str]) -> None:
    """Give this process a person's environment, which the processes that it starts inherit."""
    for name in tuple(os.environ):
        if name.startswith(("ALSA", "PULSE", "PIPEWIRE", "XDG", "DBUS")):
            monkeypatch.delenv(name)
    for name in ("HOME", "XDG_RUNTIME_DIR"):
        monkeypatch.setenv(name, environment[name])
