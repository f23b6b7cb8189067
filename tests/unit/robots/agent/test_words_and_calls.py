"""Words and calls between a visitor and the people at the robot, through the whole control loop."""

import pytest

from robots.agent.ramp import ZERO
from robots.api import messages as m


def asked(number, **fields):
    return {"action_id": f"a{number}", "stamp": 0.0, "session": "s1", "epoch": 1, **fields}


def at_screen(number, **fields):
    return {"action_id": f"a{number}", "stamp": 0.0, "role": "screen", "user": "Giraff", **fields}


def outcome(rig, number):
    """Wait for the answer to an action; return its last status and reason."""
    rig.link.wait("action", lambda one: one.action_id == f"a{number}")
    last = [one for one in rig.link.all("action") if one.action_id == f"a{number}"][-1]
    return last.status, last.reason


def say(rig, number=1, **fields):
    rig.act(m.Say(**asked(number, **fields), text="Hello"), way="datachannel")
    assert outcome(rig, number) == ("FINISHED", "")


def test_drivers_words_are_sent_under_the_name_of_the_lease(rig):
    say(rig, user="Mallory")
    words = rig.link.all("words")[-1]
    assert (words.by, words.who, words.aloud, words.session) == ("driver", "Ada", True, "s1")
    assert words.text == "Hello"


def test_words_from_the_screen_are_shown_and_never_spoken(rig):
    rig.act(m.Say(**at_screen(1), text="Come in", aloud=True))
    assert outcome(rig, 1) == ("FINISHED", "")
    words = rig.link.all("words")[-1]
    assert (words.by, words.who, words.aloud) == ("screen", "Giraff", False)


def receipts(rig):
    return [(one.action_id, one.session, one.state) for one in rig.link.all("receipt")]


def test_driver_gets_a_receipt_when_a_display_has_shown_and_read_the_words(rig):
    say(rig)
    assert rig.link.all("words")[-1].receipts is True
    assert receipts(rig) == [], "sent is not shown"
    rig.act(m.ConfirmWords(**at_screen(2), target="a1", state="shown"))
    rig.act(m.ConfirmWords(**at_screen(3), target="a1", state="shown"))
    rig.act(m.ConfirmWords(**at_screen(4), target="a1", state="spoken"))
    assert outcome(rig, 4) == ("FINISHED", "")
    assert receipts(rig) == [("a1", "s1", "shown"), ("a1", "s1", "spoken")]


def test_repeated_words_are_spoken_once_and_answered_with_the_newest_receipt(rig):
    say(rig)
    rig.act(m.ConfirmWords(**at_screen(2), target="a1", state="shown"))
    assert outcome(rig, 2) == ("FINISHED", "")
    say(rig)
    rig.wait(lambda: len(receipts(rig)) == 2)
    assert receipts(rig) == [("a1", "s1", "shown")] * 2
    assert len(rig.link.all("words")) == 1


def test_only_displays_confirm_words_and_only_those_of_the_driver(rig):
    say(rig)
    rig.act(m.ConfirmWords(**asked(2), target="a1", state="shown"), way="datachannel")
    assert outcome(rig, 2) == ("FAILED", "role")
    rig.act(m.Say(**at_screen(3), text="Come in"))
    assert outcome(rig, 3) == ("FINISHED", "")
    assert rig.link.all("words")[-1].receipts is False
    rig.act(m.ConfirmWords(**at_screen(4), target="a3", state="shown"))
    assert outcome(rig, 4) == ("FAILED", "unknown_words")
    assert receipts(rig) == []


@pytest.mark.parametrize("kind", [m.Say, m.Call])
@pytest.mark.parametrize(
    ("way", "role"), [("datachannel", "driver"), ("datachannel", "screen"), ("mqtt", "observer")]
)
def test_viewer_neither_speaks_nor_calls_with_any_role(rig, kind, way, role):
    fields = {"text": "I am the driver"} if kind is m.Say else {"audio": True}
    rig.act(kind(**asked(2, role=role), **fields), way=way, peer="somebody")
    assert outcome(rig, 2) == ("FAILED", "observer")
    assert rig.link.all("words") == []
    assert rig.media.passing == []


def has_call(rig, **fields):
    call = m.CallState(status="accepted", **fields)
    rig.wait(lambda: rig.link.all("state")[-1].call == call)


def test_call_passes_at_once_and_ends_with_the_session(rig):
    rig.act(m.Call(**asked(1), audio=True, volume=0.5), way="datachannel")
    rig.wait(lambda: rig.media.passing)
    assert rig.media.passing == [{"audio": True, "video": False, "volume": 0.5}]
    has_call(rig, audio=True, volume=0.5)
    rig.link.say("lease", None)
    rig.wait(lambda: rig.media.passing[-1]["audio"] is False)


def test_screen_accepts_a_call_and_hangs_up(rig):
    rig.link.say("config", m.Config(stamp=rig.unix(), calls="ask"))
    rig.act(m.Call(**asked(1), video=True), way="datachannel")
    rig.wait(lambda: (call := rig.link.all("state")[-1].call) and call.status == "ringing")
    assert rig.media.passing == []
    rig.act(m.AnswerCall(**asked(2), accept=True), way="datachannel")
    assert outcome(rig, 2) == ("FAILED", "role"), "nobody answers their own call"
    rig.act(m.AnswerCall(**at_screen(3), accept=True))
    rig.wait(lambda: rig.media.passing)
    assert rig.media.passing[-1]["video"] is True
    rig.act(m.AnswerCall(**at_screen(4), accept=False))
    rig.wait(lambda: rig.media.passing[-1] == {"audio": False, "video": False, "volume": 1.0})


def knock(rig):
    return rig.link.all("state")[-1].knock


def test_knock_rings_once_and_the_state_reports_its_answer(rig):
    rig.act(m.Knock(**asked(1)), way="datachannel")
    assert outcome(rig, 1) == ("FAILED", "nobody_there")
    assert rig.link.all("state")[-1].knockable is False
    rig.media.audible = True
    rig.wait(lambda: rig.link.all("state")[-1].knockable)
    for number in (2, 2, 3):  # a repetition, and another knock
        rig.act(m.Knock(**asked(number)), way="datachannel")
    assert outcome(rig, 3) == ("FAILED", "too_soon")
    assert rig.media.rings == 1
    rig.wait(lambda: knock(rig) == m.KnockState(action_id="a2", status="ringing"))
    rig.act(m.AnswerCall(**at_screen(4), accept=True, knock="a2"))
    rig.wait(lambda: knock(rig) == m.KnockState(action_id="a2", status="answered"))
    assert rig.media.passing == [], "a knock sends no sound or picture"
    rig.link.say("lease", None)
    rig.wait(lambda: knock(rig) is None)


@pytest.mark.parametrize(
    ("way", "role"), [("datachannel", "driver"), ("mqtt", "observer"), ("mqtt", "screen")]
)
def test_only_the_driver_knocks(rig, way, role):
    rig.media.audible = True
    rig.act(m.Knock(**asked(1, role=role)), way=way, peer="somebody")
    assert outcome(rig, 1) == ("FAILED", "observer")
    assert rig.media.rings == 0


def test_screen_stops_the_robot_and_clears_only_its_own_stop(rig):
    rig.act(m.EStop(**at_screen(1)))
    rig.wait(lambda: rig.kernel.latch is not None)
    rig.act(m.ClearEStop(**at_screen(2)))
    assert outcome(rig, 2) == ("FINISHED", "")
    assert rig.kernel.latch is None
    rig.act(m.EStop(**at_screen(3, role="staff", user="Berta")))
    rig.wait(lambda: rig.kernel.latch is not None)
    rig.act(m.ClearEStop(**at_screen(4)))
    assert outcome(rig, 4) == ("FAILED", "not_yours")


# --- dots on what the driver shares ---------------------------------------------------------------

SCREEN = {"peer": "screen-1", "role": "screen", "session": None, "epoch": 0}


def point(rig, stamp, *, way="datachannel", peer="p1", role="driver", **fields):
    values = {"at": (0.25, 0.75), "session": "s1", "epoch": 1} | fields
    command = m.PointCommand(stamp=stamp, peer=peer, role=role, **values)
    if way == "mqtt":
        rig.link.say("command/point", command)
    else:
        rig.frame("command/point", command, peer=peer, role=role)
    rig.sleep(0.005)  # a busy loop takes only the newest dot


def shares(rig):
    rig.act(m.Call(**asked(1), video=True, shares=True), way="datachannel")
    assert outcome(rig, 1) == ("FINISHED", "")


def dots(rig):
    return [(dot.by, dot.at) for dot in rig.link.all("pointer")]


def test_dots_reach_server_and_pages_and_move_nothing(rig):
    shares(rig)
    has_call(rig, video=True, shares=True)
    point(rig, 10.0)
    point(rig, 10.1, at=None)
    rig.wait(lambda: len(rig.media.pointed) == 2)
    point(rig, 5.0, way="mqtt", **SCREEN, at=(1.0, 0.0))
    rig.wait(lambda: len(rig.media.pointed) == 3)
    point(rig, 5.1, **SCREEN, at=(0.0, 0.0))
    wanted = [("driver", (0.25, 0.75)), ("driver", None)]
    wanted += [("screen", (1.0, 0.0)), ("screen", (0.0, 0.0))]
    rig.wait(lambda: [(dot.by, dot.at) for dot in rig.media.pointed] == wanted)
    assert dots(rig) == wanted
    by_own_clock = [abs(dot.stamp - rig.unix()) < 60.0 for dot in rig.media.pointed]
    assert all(by_own_clock)
    assert "pointer" not in {suffix for suffix, _ in rig.media.told}, "sent to every page"
    assert all(velocity == ZERO for _, velocity in rig.robot.velocities())


def test_pointing_needs_a_shared_screen_that_was_accepted(rig):
    rig.link.say("config", m.Config(stamp=rig.unix(), calls="ask"))
    shares(rig)
    point(rig, 10.0)
    rig.act(m.AnswerCall(**at_screen(2), accept=True))
    rig.wait(lambda: rig.media.passing)
    rig.act(m.Call(**asked(3), video=True), way="datachannel")
    assert outcome(rig, 3) == ("FINISHED", "")
    point(rig, 11.0)
    point(rig, 12.0, way="mqtt", **SCREEN)
    rig.act(m.Call(**asked(4), video=True, shares=True), way="datachannel")
    assert outcome(rig, 4) == ("FINISHED", "")
    point(rig, 13.0, at=(0.5, 0.5))
    rig.wait(lambda: dots(rig))
    assert dots(rig) == [("driver", (0.5, 0.5))]


def test_dots_of_observers_and_stored_dots_are_dropped_and_not_counted_as_refused(rig):
    shares(rig)
    point(rig, 10.0, peer="somebody", role="observer")
    rig.link.say(
        "command/point",
        m.PointCommand(stamp=10.0, at=(0.1, 0.1), session="s1", epoch=1, peer="p1"),
        retained=True,
    )
    point(rig, 11.0)
    rig.wait(lambda: dots(rig))
    assert dots(rig) == [("driver", (0.25, 0.75))]
    assert not any(state.refused for state in rig.link.all("state")[-4:])
