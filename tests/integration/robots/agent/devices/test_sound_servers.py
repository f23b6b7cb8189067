"""Microphone and loudspeaker on a real PulseAudio and a real PipeWire."""

import contextlib
import threading
import time
from typing import Self

import numpy as np
import psutil
import pytest

from robots.agent.config import load
from robots.agent.devices.alsa import BLOCK
from robots.agent.devices.equipment import equipment_of
from robots.agent.media.capture.outputs import OutputFeed
from robots.agent.media.capture.sound import MicrophoneFeed, SoundEncoder
from robots.agent.robot_interface import AdapterError
from tests.support.agents.scripted_robot import ScriptedRobot
from tests.support.agents.simulators import eventually
from tests.support.programs.sound_server import (
    environment_of,
    is_tone,
    sine,
    sound_server,
    use_environment,
)

TONE = 440.0  # Hz


@pytest.fixture(params=["pulseaudio", "pipewire"])
def server(request, tmp_path, monkeypatch):
    with sound_server(request.param, tmp_path) as running:
        use_environment(monkeypatch, running.environment)
        yield running


@pytest.fixture
def pulseaudio(tmp_path, monkeypatch):
    with sound_server("pulseaudio", tmp_path) as running:
        use_environment(monkeypatch, running.environment)
        yield running


@contextlib.contextmanager
def listened(source, hear):
    """Yield the feed of a microphone for which a page listens."""
    feed = MicrophoneFeed(source, hear)
    feed.start()
    feed.listen(1)
    try:
        yield feed
    finally:
        feed.listen(-1)
        feed.close()


def equipment(tmp_path, **devices: str):
    return equipment_of(
        ScriptedRobot(),
        load({"robot": "giraff", "mqtt_url": "mqtt://127.0.0.1:1", "var": tmp_path, **devices}, {}),
    )


def microphone_hears(source, tone: float) -> bool:
    """Return whether half a second of the next ten has this tone."""
    deadline, blocks = time.monotonic() + 10.0, []
    while time.monotonic() < deadline:
        block = source.read(0.5)
        if block is not None:
            assert (block.shape, block.dtype) == ((BLOCK,), np.int16)
            blocks = [*blocks, block][-25:]
        if len(blocks) == 25 and is_tone(np.concatenate(blocks), tone):
            return True
    return False


class Talker:
    """A visitor's voice: Opus to an OutputFeed, 50 times a second."""

    def __init__(self, feed: OutputFeed) -> None:
        self._feed, self._over = feed, threading.Event()
        self._thread = threading.Thread(target=self._talk, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_raised: object) -> None:
        self._over.set()
        self._thread.join()

    def _talk(self) -> None:
        encoder, second = SoundEncoder(), np.split(sine(TONE, 50 * BLOCK), 50)
        number, began = 0, time.monotonic()
        while not self._over.wait(max(0.0, began + number * 0.02 - time.monotonic())):
            self._feed.hear(encoder.encode(second[number % 50])[0])
            number += 1


@pytest.mark.nightly
def test_microphone_records_a_tone_twice_in_a_row(server, tmp_path):
    source = equipment(tmp_path, microphone="alsa:default").audio
    for _ in range(2):
        with server.playing(TONE):
            source.start()
            assert microphone_hears(source, TONE)
            source.stop()


@pytest.mark.nightly
def test_loudspeaker_plays_a_tone_twice_in_a_row(server, tmp_path):
    speaker, _display = equipment(tmp_path, loudspeaker="alsa:default").outputs
    for _ in range(2):
        feed = OutputFeed(speaker, None)
        feed.start()
        with server.listening() as ear, Talker(feed):
            assert eventually(lambda: ear.hears(TONE), 20.0)
        assert feed.errors == ()
        feed.close()


def test_device_of_the_server_is_found_by_name_and_converted(pulseaudio, tmp_path):
    # which has two channels at 44.1 kHz
    source = equipment(tmp_path, microphone="alsa:pulse:robot.monitor").audio
    with pulseaudio.playing(TONE):
        source.start()
        assert microphone_hears(source, TONE)
        source.stop()


@pytest.mark.nightly
def test_unplugged_microphone_is_reported_and_heard_again(pulseaudio, tmp_path):
    payloads: list[bytes] = []
    source = equipment(tmp_path, microphone="alsa:default").audio
    with listened(source, lambda payload, _ticks: payloads.append(payload)) as feed:
        for _ in range(2):
            with pulseaudio.playing(TONE):
                assert eventually(lambda: feed.state.status == "live" and bool(payloads), 30.0)
                pulseaudio.unplug()
                assert eventually(lambda: feed.state.reason != "", 30.0)
                assert feed.state.reason.startswith("the microphone default cannot be used: ")
            pulseaudio.plug()
            payloads.clear()
            with pulseaudio.playing(TONE):
                assert eventually(lambda: feed.state.status == "live" and bool(payloads), 30.0)


@pytest.mark.nightly
@pytest.mark.parametrize("fault", ["killed", "frozen"])
def test_loudspeaker_whose_server_fails_is_reported_and_plays_again(pulseaudio, tmp_path, fault):
    feed = OutputFeed(equipment(tmp_path, loudspeaker="alsa:default").outputs[0], None)
    feed.start()
    with Talker(feed):
        with pulseaudio.listening() as ear:
            assert eventually(lambda: ear.hears(TONE), 30.0)
        (pulseaudio.kill if fault == "killed" else pulseaudio.freeze)()
        assert eventually(
            lambda: any("the loudspeaker default" in error for error in feed.errors), 30.0
        )
        (pulseaudio.start if fault == "killed" else pulseaudio.thaw)()
        with pulseaudio.listening() as ear:
            assert eventually(lambda: ear.hears(TONE) and feed.errors == (), 30.0)
    feed.close()


@pytest.mark.nightly
def test_microphone_whose_server_freezes_is_reported_and_heard_again(pulseaudio, tmp_path):
    source = equipment(tmp_path, microphone="alsa:default").audio
    with listened(source, lambda _payload, _ticks: None) as feed:
        assert eventually(lambda: feed.state.status == "live", 30.0)
        pulseaudio.freeze()
        assert eventually(lambda: feed.state.reason != "", 30.0)
        pulseaudio.thaw()
        assert eventually(lambda: feed.state.status == "live", 30.0)


def test_missing_device_is_reported_with_the_available_ones(pulseaudio, tmp_path):
    found = equipment(tmp_path, microphone="alsa:basement", loudspeaker="alsa:hw:7,0")
    missing = "cannot be used: there is no such device; available: default, pulse$"
    for _ in range(2):
        found.audio.start()
        with pytest.raises(AdapterError, match=f"^the microphone basement {missing}"):
            [found.audio.read(0.5) for _ in range(60)]
        found.audio.stop()
        speaker = found.outputs[0]
        speaker.start()
        with pytest.raises(AdapterError, match=f"^the loudspeaker hw:7,0 {missing}"):
            [speaker.play(sine(TONE, BLOCK)) for _ in range(500)]
        speaker.stop()


def test_alsa_works_without_a_sound_server(tmp_path, monkeypatch):
    """The system's alsa.conf reads `~/.asoundrc`, in which `default` here is a file, not a card."""
    use_environment(monkeypatch, environment_of(tmp_path))
    sine(TONE, 20 * BLOCK * 50).tofile(tmp_path / "spoken.raw")
    (tmp_path / ".asoundrc").write_text(
        f'pcm.!default {{ type file slave.pcm null file "{tmp_path}/payloads.raw" infile'
        f' "{tmp_path}/spoken.raw" format raw }}\n'
    )
    found = equipment(tmp_path, microphone="alsa:default", loudspeaker="alsa:default")
    found.audio.start()
    assert microphone_hears(found.audio, TONE)
    found.audio.stop()
    speaker = found.outputs[0]
    speaker.start()
    for block in np.split(sine(TONE, 50 * BLOCK), 50):
        speaker.play(block)
    speaker.stop()
    assert is_tone(np.fromfile(tmp_path / "payloads.raw", np.int16)[-24_000:], TONE)


def test_missing_alsa_utils_are_reported_with_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    found = equipment(tmp_path, microphone="alsa:default", loudspeaker="alsa:default")
    for device in (found.audio, found.outputs[0]):
        with pytest.raises(
            AdapterError,
            match="is not installed; run sudo apt install alsa-utils libasound2-plugins",
        ):
            device.start()
        device.stop()


def test_closed_devices_leave_no_process(pulseaudio, tmp_path):
    found = equipment(tmp_path, microphone="alsa:default", loudspeaker="alsa:default")
    before = psutil.Process().children()
    found.audio.start()
    found.outputs[0].start()
    assert len(psutil.Process().children()) == len(before) + 2
    found.audio.stop()
    found.outputs[0].stop()
    assert psutil.Process().children() == before
