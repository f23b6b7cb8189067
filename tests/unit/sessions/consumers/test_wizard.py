"""What a hidden operator's page may send and receives, and what the participant's page may not."""

import msgspec
import pytest

from docs.robot_api import examples
from robots.api import codec, messages as m
from robots.bridge.delivery import ReceivedMessage
from sessions import protocol as pages
from sessions.consumers.authorization import Authorization, DenyFrame, Halt, Publish, Verb
from sessions.consumers.relay import for_driver
from sessions.consumers.wizard_authorization import WizardAuthorization
from sessions.consumers.wizard_relay import for_wizard, participant_view
from sessions.wizard import protocol

SESSION = "session-1"
DRIVER = {"session": SESSION, "epoch": 7, "peer": "participant", "who": "Ada"}
LEASE = m.Lease(renewal=1, stamp=1.0, kind="wizard", wizard="wizard", wizard_epoch=3, **DRIVER)
WITHOUT_WIZARD = msgspec.structs.replace(LEASE, wizard=None, wizard_epoch=4)


def wizard(**options):
    authorization = WizardAuthorization("wizard")
    authorization.operate(SESSION, 3, **({"by_hand": True} | options))
    return authorization


def participant():
    authorization = Authorization("participant", "Ada")
    authorization.drive(SESSION, 7, "participant")
    return authorization


def say(authorization, suffix, message, lease=LEASE, now=0.0):
    (effect,) = authorization.receive(codec.encode_frame(suffix, message), lease, now)
    return effect


def velocity(method="keyboard", linear=0.3):
    return m.VelocityCommand(
        session="forged", epoch=99, seq=5, stamp=1.0, linear=linear, angular=0.0, method=method
    )


def action(kind, **fields):
    return kind(action_id="a1", stamp=1.0, **fields)


def test_the_wizard_drives_with_an_epoch_of_its_own_and_the_participant_does_not_drive():
    sent = say(wizard(), "command/velocity", velocity())
    assert isinstance(sent, Publish)
    assert (sent.message.session, sent.message.epoch) == (SESSION, 3)
    refused = say(participant(), "command/velocity", velocity())
    assert refused == DenyFrame("command/velocity", "not_driver")


ANOTHER = msgspec.structs.replace(LEASE, wizard="another")


@pytest.mark.parametrize("lease", [None, WITHOUT_WIZARD, ANOTHER])
def test_a_page_that_the_lease_does_not_name_drives_nothing(lease):
    refused = say(wizard(), "command/velocity", velocity(), lease)
    assert refused == DenyFrame("command/velocity", "observer")


def test_wizard_drives_by_hand_only_where_the_study_allows_it_and_may_always_stop():
    page = wizard(by_hand=False)
    assert say(page, "command/velocity", velocity()) == DenyFrame("command/velocity", "not_allowed")
    assert isinstance(say(page, "command/velocity", velocity(linear=0.0)), Publish)


def test_the_velocities_of_a_step_pass_while_it_lasts_and_no_longer():
    page = wizard(by_hand=False)
    page.script_until = 10.0
    assert isinstance(say(page, "command/velocity", velocity("script"), now=9.9), Publish)
    late = say(page, "command/velocity", velocity("script"), now=10.0)
    assert late == DenyFrame("command/velocity", "not_allowed")


def test_a_stop_of_the_wizard_is_the_drivers_and_that_of_the_participant_an_observers():
    stop = action(m.Stop, seq=8)
    mine = say(wizard(), "command/action", stop)
    assert isinstance(mine, Halt)
    assert (mine.message.role, mine.message.epoch, mine.message.seq) == ("driver", 3, 8)
    theirs = say(participant(), "command/action", stop).message
    assert (theirs.role, theirs.session, theirs.seq) == ("observer", None, 0)
    assert isinstance(say(wizard(), "command/action", stop, lease=None), Halt)


def test_the_participant_speaks_and_takes_photos_as_the_visitor_and_does_not_drive():
    for kind, fields in ((m.Photo, {}), (m.Say, {"text": "Hi"}), (m.Call, {}), (m.Knock, {})):
        sent = say(participant(), "command/action", action(kind, **fields))
        assert (sent.message.role, sent.message.epoch) == ("visitor", 7)
    refused = say(participant(), "command/action", action(m.Dock))
    assert refused == DenyFrame("command/action", "not_driver")


def test_the_wizards_page_requests_steps_and_no_actions_of_its_own():
    refused = say(wizard(), "command/action", action(m.Goto, place="desk"))
    assert refused == DenyFrame("command/action", "not_allowed")
    step = protocol.BeginStep(step="hello", action_id="a1", stamp=1.0)
    assert say(wizard(), "wizard/step", step) == Verb("wizard/step", step)


def test_the_wizards_offer_has_no_name():
    offer = say(wizard(), "signal", m.SdpOffer(sdp="v=0", role="driver", who="Eve"))
    assert (offer.message.role, offer.message.who) == ("wizard", "")


def test_only_heartbeats_of_the_page_that_drives_reach_the_robot():
    beat = m.CommandHeartbeat(n=1, stamp=2.0, peer="forged")
    sent = say(wizard(), "command/heartbeat", beat)
    assert (sent.message.peer, sent.message.stamp, sent.wanted) == ("wizard", 2.0, False)
    refused = say(wizard(), "command/heartbeat", beat, WITHOUT_WIZARD)
    assert refused == DenyFrame("command/heartbeat", "observer")


def test_the_wizard_cancels_actions_of_the_script_while_it_drives():
    cancel = action(m.Cancel)
    sent = say(wizard(), "command/action", cancel)
    assert (sent.message.role, sent.message.epoch) == ("driver", 3)
    refused = say(wizard(), "command/action", cancel, WITHOUT_WIZARD)
    assert refused == DenyFrame("command/action", "observer")


@pytest.mark.parametrize("signal", [m.Candidate(candidate="c", sdp_mid="0"), m.Bye(reason="left")])
def test_signals_of_the_wizards_page_go_to_its_own_connection(signal):
    assert say(wizard(), "signal", signal) == Publish("signal/wizard", signal)


@pytest.mark.parametrize(
    ("frame", "reason"),
    [("wizard/nothing\n{}", "unknown_topic"), ('wizard/step\n{"step":1}', "malformed")],
)
def test_frames_that_the_page_does_not_have_are_refused(frame, reason):
    (refused,) = wizard().receive(frame, LEASE, 0.0)
    assert refused.reason == reason


def test_the_last_stop_of_a_closed_page_is_sent_only_while_it_drives():
    assert wizard().last_stop("s1", 1.0, LEASE).epoch == 3
    assert wizard().last_stop("s1", 1.0, WITHOUT_WIZARD) is None


# --- relayed messages -----------------------------------------------------------------------------

STATE = next(one for one in examples()["state"].values() if isinstance(one, m.State))
LAB = m.LabReport(lab=m.NetworkLab(delay=0.123456))
ASSIST = {"assist": "steer", "assist_why": "wall", "assist_point": (0.987654, 0.0)}
REVEALING = msgspec.structs.replace(
    STATE, mode="assisted", control_network=LAB, video_network=LAB, **ASSIST
)


def relayed(message, suffix="state"):
    inbound = ReceivedMessage(suffix, message, codec.encode_frame(suffix, message))
    return for_wizard(inbound, "wizard")


def test_relayed_messages_do_not_reveal_the_condition():
    for word in ("steer", "wall", "assist", "0.123456", "0.987654", "etwork"):
        assert word not in relayed(REVEALING).frame
    pose = m.PoseUpdate(stamp=1.0, pose=STATE.pose, velocity=STATE.velocity, assist_why="wall")
    assert "wall" not in relayed(pose, "pose").frame


@pytest.mark.parametrize("suffix", ["event", "scan", "path", "words", "pointer", "factsheet"])
def test_unlisted_messages_are_not_relayed(suffix):
    assert for_wizard(ReceivedMessage(suffix, STATE, "x"), "wizard") is None


def test_action_statuses_are_relayed_and_answers_only_to_this_page():
    status = m.ActionStatus(action_id="a1", status="RUNNING", stamp=1.0, type="dock")
    assert relayed(status, "action").frame == codec.encode_frame("action", status)
    answer = m.SdpAnswer(sdp="v=0")
    mine = for_wizard(ReceivedMessage("signal/wizard/reply", answer), "wizard")
    assert mine.frame == codec.encode_frame("signal/reply", answer)
    assert for_wizard(ReceivedMessage("signal/participant/reply", answer), "wizard") is None


def test_a_heartbeat_keeps_only_the_echo_of_this_page():
    echoes = tuple(
        m.Echo(peer=peer, n=1, stamp=1.0, received=1.0) for peer in ("participant", "wizard")
    )
    frame = relayed(m.Heartbeat(n=1, stamp=1.0, echoes=echoes), "heartbeat").frame
    assert "wizard" in frame
    assert "participant" not in frame


def test_the_wizards_words_are_not_sent_to_the_participants_page():
    words = {"stamp": 1.0, "action_id": "a1", "session": SESSION, "by": "driver", "text": "Hello"}
    robots = ReceivedMessage("words", m.Words(**words), "frame")
    own = ReceivedMessage("words", m.Words(who="Ada", **words), "frame")
    assert for_driver(robots, LEASE) is None
    assert for_driver(own, LEASE).frame == "frame"


def test_the_operator_sees_the_participants_cue_and_no_other_notice():
    task = pages.Task(session=SESSION, stamp=1.0, cue="go_to_checkpoint", number=2)
    assert participant_view(pages.notice_frame(task)) == protocol.ParticipantView(
        cue="go_to_checkpoint", number=2
    )
    message = pages.OperatorMessage(session=SESSION, text="Hello")
    assert participant_view(pages.notice_frame(message)) is None
