"""Microphone and loudspeaker on a real PulseAudio and a real PipeWire."""

import os
import threading
import time
from pathlib import Path
from typing import Self

import numpy as np
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


def equipment(tmp_path, **devices: str):
    return equipment_of(
        ScriptedRobot(),
        load({"robot": "giraff", "mqtt_url": "mqtt://127.0.0.1:1", "var": tmp_path, **devices}, {}),
    )


def microphone_hears(source, tone: float) -> bool:
    """Tell whether half a second of the next ten has this tone."""
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
def test_a_tone_comes_through_the_microphone_twice_in_a_row(server, tmp_path):
    source = equipment(tmp_path, microphone="alsa:default").audio
    for _ in range(2):
        with server.playing(TONE):
            source.start()
            assert microphone_hears(source, TONE)
            source.stop()


@pytest.mark.nightly
def test_a_tone_goes_through_the_loudspeaker_twice_in_a_row(server, tmp_path):
    speaker, _display = equipment(tmp_path, loudspeaker="alsa:default").outputs
    for _ in range(2):
        feed = OutputFeed(speaker, None)
        feed.start()
        with server.listening() as ear, Talker(feed):
            assert eventually(lambda: ear.hears(TONE), 20.0)
        assert feed.errors == ()
        feed.close()


def test_a_device_of_the_server_is_found_by_its_name_and_heard_through_conversion(
    pulseaudio, tmp_path
):
    # which has two channels at 44.1 kHz
    source = equipment(tmp_path, microphone="alsa:pulse:robot.monitor").audio
    with pulseaudio.playing(TONE):
        source.start()
        assert microphone_hears(source, TONE)
        source.stop()


@pytest.mark.nightly
def test_a_card_that_is_pulled_out_is_said_and_heard_again_when_it_is_back(pulseaudio, tmp_path):
    heard: list[bytes] = []
    feed = MicrophoneFeed(
        equipment(tmp_path, microphone="alsa:default").audio,
        lambda payload, _ticks: heard.append(payload),
    )
    feed.start()
    feed.listen(1)
    try:
        for _ in range(2):
            with pulseaudio.playing(TONE):
                assert eventually(lambda: feed.state.status == "live" and bool(heard), 30.0)
                pulseaudio.unplug()
                assert eventually(lambda: feed.state.reason != "", 30.0)
                assert feed.state.reason.startswith("the microphone default cannot be used: ")
            pulseaudio.plug()
            heard.clear()
            with pulseaudio.playing(TONE):
                assert eventually(lambda: feed.state.status == "live" and bool(heard), 30.0)
    finally:
        feed.listen(-1)
        feed.close()


@pytest.mark.nightly
@pytest.mark.parametrize("way", ["killed", "frozen"])
def test_a_loudspeaker_whose_server_goes_is_said_and_plays_again_when_it_is_back(
    pulseaudio, tmp_path, way
):
    feed = OutputFeed(equipment(tmp_path, loudspeaker="alsa:default").outputs[0], None)
    feed.start()
    with Talker(feed):
        with pulseaudio.listening() as ear:
            assert eventually(lambda: ear.hears(TONE), 30.0)
        (pulseaudio.kill if way == "killed" else pulseaudio.freeze)()
        assert eventually(
            lambda: any("the loudspeaker default" in error for error in feed.errors), 30.0
        )
        (pulseaudio.start if way == "killed" else pulseaudio.thaw)()
        with pulseaudio.listening() as ear:
            assert eventually(lambda: ear.hears(TONE) and feed.errors == (), 30.0)
    feed.close()


@pytest.mark.nightly
def test_a_microphone_whose_server_freezes_is_said_and_heard_again(pulseaudio, tmp_path):
    feed = MicrophoneFeed(
        equipment(tmp_path, microphone="alsa:default").audio, lambda _payload, _ticks: None
    )
    feed.start()
    feed.listen(1)
    try:
        assert eventually(lambda: feed.state.status == "live", 30.0)
        pulseaudio.freeze()
        assert eventually(lambda: feed.state.reason != "", 30.0)
        pulseaudio.thaw()
        assert eventually(lambda: feed.state.status == "live", 30.0)
    finally:
        feed.listen(-1)
        feed.close()


def test_a_device_that_is_not_there_is_said_with_those_that_are(pulseaudio, tmp_path):
    found = equipment(tmp_path, microphone="alsa:basement", loudspeaker="alsa:hw:7,0")
    for _ in range(2):
        found.audio.start()
        with pytest.raises(
            AdapterError,
            match=(
                r"^the microphone basement cannot be used: there is no such device; available:"
                r" default, pulse$"
            ),
        ):
            [found.audio.read(0.5) for _ in range(60)]
        found.audio.stop()
        speaker = found.outputs[0]
        speaker.start()
        with pytest.raises(
            AdapterError,
            match=(
                r"^the loudspeaker hw:7,0 cannot be used: there is no such device; available:"
                r" default, pulse$"
            ),
        ):
            [speaker.play(sine(TONE, BLOCK)) for _ in range(500)]
        speaker.stop()


def test_a_computer_without_a_sound_server_uses_alsa_alone(tmp_path, monkeypatch):
    """`~/.asoundrc` is read by the system's alsa.conf; what it calls `default` here is a file in
    the place of a card.
    """
    use_environment(monkeypatch, environment_of(tmp_path))
    sine(TONE, 20 * BLOCK * 50).tofile(tmp_path / "said.raw")
    (tmp_path / ".asoundrc").write_text(
        f'pcm.!default {{ type file slave.pcm null file "{tmp_path}/heard.raw" infile'
        f' "{tmp_path}/said.raw" format raw }}\n'
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
    assert is_tone(np.fromfile(tmp_path / "heard.raw", np.int16)[-24_000:], TONE)


def test_a_computer_without_alsa_utils_is_told_what_to_install(tmp_path, monkeypatch):
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
    before = children()
    found.audio.start()
    found.outputs[0].start()
    assert len(children() - before) == 2
    found.audio.stop()
    found.outputs[0].stop()
    assert children() <= before


def children() -> set[str]:
    return set(
        Path(f"/proc/{os.getpid()}/task/{threading.get_native_id()}/children").read_text().split()
    )
