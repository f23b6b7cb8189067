"""A person's sound server as Debian has it: a real PulseAudio, or PipeWire with its session
manager, with a sound card that makes no sound.
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
PROGRAMS: dict[Kind, tuple[tuple[str, ...], ...]] = {
    "pulseaudio": (
        (
            "pulseaudio",
            "-n",
            "--daemonize=no",
            "--exit-idle-time=-1",
            "-L",
            "module-native-protocol-unix",
        ),
    ),
    "pipewire": (
        ("dbus-daemon", "--session", "--nofork", "--address=unix:path={run}/bus"),
        ("pipewire",),
        ("pipewire-pulse",),
        ("wireplumber",),
    ),
}


def environment_of(home: Path) -> dict[str, str]:
    """Return what a person's processes have: no word about sound, and nothing of the tests'."""
    return {
        "PATH": os.environ["PATH"],
        "HOME": str(home),
        "XDG_RUNTIME_DIR": str(home / "run"),
        "LANG": "C.UTF-8",
    }


class SoundServer:
    """Runs in a home of its own; the card is called `robot`, and what is played on it comes out of
    `robot.monitor`.
    """

    def __init__(self, kind: Kind, home: Path) -> None:
        self.kind, self.home = kind, home
        self.environment = environment_of(home)
        self._programs: list[subprocess.Popen] = []
        (home / "run").mkdir(mode=0o700)

    def start(self) -> None:
        bus = (
            {"DBUS_SESSION_BUS_ADDRESS": f"unix:path={self.home}/run/bus"}
            if self.kind == "pipewire"
            else {}
        )
        for command in PROGRAMS[self.kind]:
            with (self.home / f"{command[0]}.log").open("ab") as log:
                words = [word.format(run=self.home / "run") for word in command]
                self._programs.append(
                    subprocess.Popen(words, env={**self.environment, **bus}, stdout=log, stderr=log)
                )
            if command[0] == "dbus-daemon":
                assert eventually((self.home / "run/bus").exists)
        assert eventually(lambda: self._pactl("info").returncode == 0, 30.0), "no sound server"
        if self.kind == "pipewire":  # a card that comes before its session manager may stay unused
            assert eventually(
                lambda: "WirePlumber [export]" in self._pactl("list", "clients").stdout, 30.0
            ), self._programs_now()
        self.plug()

    def _programs_now(self) -> dict[str, int | None]:
        """Return the programs of the server, and with what each has ended."""
        return {str(program.args[0]): program.poll() for program in self._programs}

    def plug(self) -> None:
        """Plug the card in."""
        assert self._pactl("load-module", "module-null-sink", "sink_name=robot").returncode == 0
        assert eventually(
            lambda: "Default Source: robot.monitor" in self._pactl("info").stdout, 30.0
        ), (self._programs_now(), self._pactl("info").stdout)

    def unplug(self) -> None:
        """Pull the card out."""
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
        """Play a tone in Hz on the card meanwhile, by the server's own client."""
        command = (
            "pacat",
            "--playback",
            "--raw",
            "--format=s16le",
            f"--rate={RATE}",
            "--channels=1",
            "--latency-msec=50",
        )
        player = subprocess.Popen(command, env=self.environment, stdin=subprocess.PIPE, bufsize=0)
        threading.Thread(
            target=self._feed, args=(player, sine(tone, RATE).tobytes()), daemon=True
        ).start()
        try:
            yield
        finally:
            player.kill()
            player.wait()

    @contextlib.contextmanager
    def listening(self) -> Iterator["Ear"]:
        """Record what comes out of the card, by the server's own client."""
        command = (
            "parec",
            "--raw",
            "--format=s16le",
            f"--rate={RATE}",
            "--channels=1",
            "--latency-msec=50",
            "--device=robot.monitor",
        )
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
    """What was heard, the last second of it."""

    def __init__(self, recorder: subprocess.Popen) -> None:
        self._heard = bytearray()
        self._lock = threading.Lock()
        threading.Thread(target=self._listen, args=(recorder,), daemon=True).start()

    def hears(self, tone: float) -> bool:
        """Tell whether the last half second was this tone."""
        with self._lock:
            samples = np.frombuffer(bytes(self._heard[-RATE:]), np.int16)
        return len(samples) == RATE // 2 and is_tone(samples, tone)

    def _listen(self, recorder: subprocess.Popen) -> None:
        while data := recorder.stdout.read(4096):
            with self._lock:
                self._heard += data
                del self._heard[: -2 * RATE]


def sine(tone: float, samples: int) -> np.ndarray:
    return (10_000 * np.sin(2 * np.pi * tone / RATE * np.arange(samples))).astype(np.int16)


def is_tone(samples: np.ndarray, tone: float) -> bool:
    """Tell whether samples, (n,), are loud and this is the strongest frequency in Hz."""
    spectrum = np.abs(np.fft.rfft(samples))
    return np.abs(samples).max() > 1000 and abs(
        float(np.argmax(spectrum)) * RATE / len(samples) - tone
    ) < 2 * RATE / len(samples)


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
    """Give this process the environment of a person's: what the product starts inherits it."""
    for name in tuple(os.environ):
        if name.startswith(("ALSA", "PULSE", "PIPEWIRE", "XDG", "DBUS")):
            monkeypatch.delenv(name)
    for name in ("HOME", "XDG_RUNTIME_DIR"):
        monkeypatch.setenv(name, environment[name])
