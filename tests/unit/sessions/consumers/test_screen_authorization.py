"""The rules of a robot's screen, without a connection."""

import msgspec
import pytest

from robots.api import codec, messages as m
from sessions import protocol
from sessions.consumers.authorization import DenyFrame, Publish
from sessions.consumers.screen_authorization import ScreenAuthorization
from tests.support import words

ICE = (m.IceServer(urls=("stun:stun.example.org",)),)
FORGED = {"session": "other", "epoch": 999, "role": "owner", "user": "Mallory"}
STAMPED = {"session": None, "epoch": 0, "role": "screen", "user": "Giraff"}


@pytest.fixture
def authorization():
    return ScreenAuthorization("peer-1", "Giraff", ice_servers=lambda: ICE)


def say(authorization, suffix, message):
    (effect,) = authorization.receive(codec.encode_frame(suffix, message), None, 0.0)
    return effect


def asked(kind, **fields):
    return kind(**{"action_id": "a1", "stamp": 1.0, **fields})


@pytest.mark.parametrize(
    "message",
    [
        asked(m.Say, text="hello"),
        asked(m.AnswerCall, accept=True),
        asked(m.ConfirmWords, target="a0", state="shown"),
        asked(m.ClearEStop),
    ],
    ids=lambda m: type(m).__name__,
)
def test_messages_of_a_screen_have_the_role_screen(authorization, message):
    effect = say(authorization, "command/action", msgspec.structs.replace(message, **FORGED))
    assert isinstance(effect, Publish)
    assert {name: getattr(effect.message, name) for name in STAMPED} == STAMPED


def test_the_number_of_a_screens_stop_kills_no_command_of_the_driver(authorization):
    assert say(authorization, "command/action", asked(m.Stop, seq=40)).message.seq == 0


def test_an_offer_of_a_screen_is_an_offer_of_a_screen(authorization):
    forged = m.SdpOffer(sdp="v=0", role="driver", session="s", epoch=9, who="Mallory")
    own = m.SdpOffer(sdp="v=0", role="screen", who="Giraff", ice_servers=ICE)
    assert say(authorization, "signal", forged) == Publish("signal/peer-1", own)


def test_a_screen_points_as_the_screen_and_twenty_times_a_second(authorization):
    forged = m.PointCommand(
        stamp=5.0, at=(0.5, 0.25), role="driver", peer="p1", session="s", epoch=9
    )
    stamped = m.PointCommand(stamp=5.0, at=(0.5, 0.25), role="screen", peer="peer-1")
    publish = Publish("command/point", stamped, wanted=False)
    assert say(authorization, "command/point", forged) == publish
    frame = codec.encode_frame("command/point", forged)
    effects = [authorization.receive(frame, None, 1.0 + n / 50) for n in range(500)]
    assert effects.count((publish,)) == pytest.approx(210, abs=2)


@pytest.mark.parametrize(
    ("suffix", "message"),
    [
        ("command/velocity", words.velocity()),
        ("command/action", asked(m.Goto, x=1.0, y=1.0)),
        ("command/action", asked(m.Call, audio=True)),
        ("command/action", asked(m.Photo)),
        ("command/picture", m.PictureRequest(stamp=1.0)),
        ("session/take", protocol.Take()),
        ("session/observe", protocol.Observe()),
        ("page/event", protocol.PageEvent(stamp=1.0, type="x")),
    ],
)
def test_a_screen_neither_drives_nor_visits_nor_reports(authorization, suffix, message):
    assert say(authorization, suffix, message) == DenyFrame(suffix, "not_allowed")


@pytest.mark.parametrize("signal", [m.Candidate(candidate="c", sdp_mid="0"), m.Bye(reason="left")])
def test_candidates_and_the_end_of_a_screens_connection_go_to_its_own(authorization, signal):
    assert say(authorization, "signal", signal) == Publish("signal/peer-1", signal)
