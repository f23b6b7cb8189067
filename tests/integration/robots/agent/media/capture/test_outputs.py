"""A loudspeaker that fails: it is closed and retried after a pause; no error ends the thread."""

import time

import pytest

from robots.agent.media.capture import outputs
from robots.agent.media.capture.outputs import OutputFeed
from robots.agent.media.capture.sound import BLOCK, SoundEncoder
from robots.agent.robot_interface import AdapterError
from robots.simulator.outputs import MeasuringSpeaker
from tests.support.agents.simulators import eventually
from tests.support.programs.sound_server import sine


class Loudspeaker:
    """Refuses calls, as a device that another program uses."""

    def __init__(self) -> None:
        self.refuses: set[str] = set()
        self.starts = self.stops = self.played = 0

    def start(self) -> None:
        self.starts += 1
        self._do("start")

    def stop(self) -> None:
        self.stops += 1
        self._do("stop")

    def play(self, samples) -> None:
        self._do("play")
        self.played += len(samples)

    def _do(self, what: str) -> None:
        if what in self.refuses:
            raise AdapterError(
                "the loudspeaker default cannot be used: another program is using it"
            )


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(outputs, "IDLE", 0.1)
    monkeypatch.setattr(outputs, "FIRST_RETRY", 0.2)
    monkeypatch.setattr(outputs, "STEADY", 0.1)


def talk(feed: OutputFeed, until) -> bool:
    encoder, second = SoundEncoder(), sine(440.0, BLOCK)

    def spoke() -> bool:
        feed.hear(encoder.encode(second)[0])
        time.sleep(0.01)
        return until()

    return eventually(spoke)


@pytest.mark.parametrize("what", ["start", "play"])
def test_loudspeaker_that_fails_is_closed_and_retried_after_a_pause(quick, what):
    speaker = Loudspeaker()
    speaker.refuses = {what}
    feed = OutputFeed(speaker, None)
    feed.start()
    began = time.monotonic()
    assert talk(feed, lambda: speaker.starts == 3)
    assert time.monotonic() - began > 0.2 + 0.4 - 0.01, "the pauses do not grow"
    assert feed.errors == ("the loudspeaker default cannot be used: another program is using it",)
    if what == "play":
        assert speaker.stops >= 2
    speaker.refuses = set()
    assert talk(feed, lambda: speaker.played > 0 and feed.errors == ())
    feed.close()


def test_loudspeaker_that_cannot_be_closed_plays_again(quick):
    speaker = Loudspeaker()
    feed = OutputFeed(speaker, None)
    feed.start()
    for round_ in (1, 2):
        speaker.refuses = set()
        assert talk(feed, lambda round_=round_: speaker.starts == round_ and speaker.played > 0)
        speaker.refuses = {"stop"}
        assert eventually(lambda round_=round_: speaker.stops == round_), "it was not stopped"
        speaker.played = 0
    feed.close()


def test_knock_plays_two_notes_on_the_robots_own_loudspeaker(quick):
    speaker = MeasuringSpeaker()
    feed = OutputFeed(speaker, None)
    feed.start()
    try:
        feed.ring()
        assert eventually(lambda: speaker.played == outputs.chime().size)
        assert speaker.tone == pytest.approx(outputs.NOTES[1], abs=5.0)
        assert 0.0 < speaker.level < 0.2
        feed.ring()
        assert eventually(lambda: speaker.played == 2 * outputs.chime().size)
    finally:
        feed.close()
    assert feed.has_speaker
    assert not OutputFeed(None, None).has_speaker


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_thread_that_a_loudspeaker_kills_is_restarted(monkeypatch) -> None:
    speaker = Loudspeaker()
    feed = OutputFeed(speaker, None)
    feed.start()
    monkeypatch.setattr(speaker, "play", lambda samples: {}["unforeseen"])
    assert talk(feed, lambda: not feed._thread.is_alive())
    monkeypatch.undo()
    feed.start()
    assert talk(feed, lambda: speaker.played > 0)
    feed.close()
