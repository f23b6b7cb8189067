"""Messages of a session besides states: recorded, and sent to other apps."""

import msgspec
import pytest
from aiomqtt import Message, Topic

from accounts.models import User
from robots.api import codec, topics
from robots.api import messages as m
from robots.models import Robot
from sessions import protocol, signals
from sessions.manager import notices
from sessions.manager.dispatch import send_all
from sessions.manager.ingest import Intake
from sessions.models import Session, SessionEvent
from sessions.recording.builder import RecordBuilder
from sessions.recording.items import ActionItem, EventItem, PhotoItem
from sessions.recording.store import RecordStore
from tests.support import words

pytestmark = pytest.mark.django_db
NOW = 1_766_000_000.0


class Kept(list):
    """A recorder that keeps what it is given."""

    put = list.append


@pytest.fixture
def session():
    robot = Robot.objects.create(name="giraff", title="Giraff")
    made = Session.objects.create(
        robot=robot,
        visitor=User.objects.create(username="ana"),
        live_key="x",
        queued_at="2026-01-01T00:00Z",
    )
    return str(made.pk)


@pytest.fixture
def intake():
    return Intake(Kept(), lambda: NOW, wake_signals=lambda: None, wake_scheduler=lambda: None)


def hears(intake: Intake, topic: str, message: m.Message) -> None:
    intake.receive(
        Message(Topic(topic), codec.encode(message), 1, retain=False, mid=1, properties=None)
    )


def from_robot(intake: Intake, suffix: str, message: m.Message) -> None:
    hears(intake, topics.of("giraff", suffix), message)


@pytest.fixture
def published():
    last_received = []
    receiver = lambda **news: last_received.append(
        (news["robot"], news["session"], news["message"], news["received_at"])
    )
    signals.message_received.connect(receiver, weak=False, dispatch_uid="test")
    yield last_received
    signals.message_received.disconnect(dispatch_uid="test")


def test_an_action_that_has_ended_belongs_to_the_session_that_the_robot_is_in(
    intake, session, published
):
    failed = m.ActionStatus(
        action_id="a1", status="FAILED", stamp=NOW, type="photo", reason="no_picture"
    )
    from_robot(intake, "action", failed)  # no session yet
    from_robot(intake, "state", words.state(1, session=session, epoch=1))
    from_robot(
        intake, "action", m.ActionStatus(action_id="a1", status="RUNNING", stamp=NOW, type="photo")
    )
    from_robot(intake, "action", failed)
    assert [item for item in intake._recorder if isinstance(item, ActionItem)] == [
        ActionItem("giraff", session, failed, NOW)
    ]
    send_all(intake.fresh(), {})
    assert published == [("giraff", session, failed, NOW)]


def test_a_picture_that_only_showed_that_the_camera_works_is_not_kept(intake, session):
    from_robot(intake, "state", words.state(1, session=session, epoch=1))
    for action in ("home-1", "p1"):
        from_robot(
            intake,
            "event",
            m.Event(
                stamp=NOW,
                boot="b1",
                seq=2,
                session=session,
                epoch=1,
                type="photo",
                action_id=action,
                sha256="ab",
            ),
        )
        intake.receive(
            Message(
                Topic(topics.of("giraff", f"photo/{action}")),
                b"\xff\xd8",
                1,
                retain=False,
                mid=1,
                properties=None,
            )
        )
    kept = [item for item in intake._recorder if isinstance(item, EventItem | PhotoItem)]
    assert [
        item.event.action_id if isinstance(item, EventItem) else item.action_id for item in kept
    ] == ["p1", "p1"]


def test_frequently_repeated_actions_are_not_recorded(intake, session):
    from_robot(intake, "state", words.state(1, session=session, epoch=1))
    for kind in ("stop", "estop", "resend_states", ""):
        from_robot(
            intake,
            "action",
            m.ActionStatus(action_id="a1", status="FINISHED", stamp=NOW, type=kind),
        )
    assert not [item for item in intake._recorder if isinstance(item, ActionItem)]


def test_an_ended_action_stands_once_in_the_record(session):
    builder, store = RecordBuilder(RecordStore(), lambda *_: None), RecordStore()
    status = m.ActionStatus(
        action_id="g1", status="CANCELLED", stamp=NOW, type="goto", reason="manual\0"
    )
    for _ in range(2):
        builder.take(ActionItem("giraff", session, status, NOW))
    builder.take(ActionItem("rhodon", session, status, NOW))  # another robot has no say
    store.insert(builder.rows)
    row = SessionEvent.objects.get()
    assert (row.source, row.type, row.stamp) == ("robot", "action", NOW)
    assert row.data == {"actionId": "g1", "status": "CANCELLED", "type": "goto", "reason": "manual"}


def test_events_and_what_pages_say_reach_the_apps_above_and_nonsense_does_not(
    intake, session, published
):
    event = protocol.PageEvent(stamp=1.0, type="first_frame")
    for message in (event, protocol.PageNetwork(stamp=1.0, way="mqtt")):
        suffix = "page/event" if message is event else "page/network"
        report = protocol.PageReport(
            suffix=suffix, session=session, message=msgspec.Raw(codec.encode(message))
        )
        hears(intake, protocol.page_reports(session), report)
    hears(
        intake,
        protocol.page_reports(session),
        protocol.PageReport(
            suffix="page/event", session=session, message=msgspec.Raw(b'{"stamp":1}')
        ),
    )
    photo = m.Event(stamp=2.0, boot="b1", seq=2, session=session, type="photo", action_id="a1")
    from_robot(intake, "event", photo)
    from_robot(intake, "event", m.Event(stamp=2.0, boot="b1", seq=3, type="docked"))
    send_all(intake.fresh(), {"giraff": 0.5})
    assert published == [("", session, event, NOW), ("giraff", session, photo, NOW)]
    assert intake.fresh() == []


def test_a_state_that_comes_late_is_told_as_such(intake, session):
    seen = []
    receivers = {
        name: lambda name=name, **news: seen.append((name, news["state"].seq))
        for name in ("state_received", "state_recovered")
    }
    for name, receiver in receivers.items():
        getattr(signals, name).connect(receiver, weak=False, dispatch_uid="late")
    try:
        for seq in (1, 4, 2, 4):
            from_robot(intake, "state", words.state(seq, session=session, epoch=1))
        send_all(intake.fresh(), {})
    finally:
        for name in receivers:
            getattr(signals, name).disconnect(dispatch_uid="late")
    assert seen == [
        ("state_received", 1),
        ("state_received", 4),
        ("state_recovered", 2),
        ("state_recovered", 4),
    ]


def test_notices_of_a_task_wait_for_the_next_tick():
    notices.drain()
    task = protocol.Task(session="s1", stamp=NOW, cue="dock_now")
    notices.publish(task)
    assert notices.are_waiting()
    assert notices.drain() == [task]
    assert not notices.are_waiting()


def test_driving_a_call_a_way_of_its_own_a_stop_there_and_a_touch_of_the_page_are_signs(session):
    now = [NOW]
    clock = lambda: now[0]
    intake = Intake(
        Kept(), clock, wake_signals=lambda: None, wake_scheduler=lambda: None, monotonic=clock
    )

    def last_sign():
        return max(
            intake.liveness["giraff"].link(0.0).active_at or 0.0,
            intake.signs.get(session, 0.0),
        )

    def sign_after(suffix, message):
        now[0] += 10.0
        before = last_sign()
        if suffix == "page":
            hears(
                intake,
                protocol.page_reports(session),
                protocol.PageReport(
                    suffix="page/event", session=session, message=msgspec.Raw(codec.encode(message))
                ),
            )
        else:
            from_robot(intake, suffix, message)
        return last_sign() == now[0] != before

    sent = {"session": session, "epoch": 1}
    command = m.AppliedCommand(
        seq=1, stamp=1.0, method="keyboard", way="mqtt", age=0.1, linear=0.2, angular=0.0
    )
    from_robot(intake, "state", words.state(1))
    assert sign_after("state", words.state(2, **sent))  # a page has come
    assert not sign_after("state", words.state(3, **sent))
    assert sign_after("state", words.state(4, applied=(command,), **sent))
    assert sign_after("state", words.state(5, mode="goto", **sent))
    assert sign_after("state", words.state(6, call=m.CallState(status="accepted"), **sent))
    assert not sign_after("state", words.state(7, **sent))
    assert sign_after("state", words.state(8, safety=m.Safety(estop=True), **sent)), (
        "a driver who waits for somebody to release the stop can do nothing"
    )
    assert not sign_after("state", words.state(9, **sent))
    assert sign_after("page", protocol.PageEvent(stamp=1.0, type=protocol.HERE))
    assert not sign_after("page", protocol.PageEvent(stamp=1.0, type="blur"))
    assert not sign_after("state", words.state(10))  # its lease lapsed
    assert sign_after("page", protocol.PageEvent(stamp=1.0, type=protocol.HERE)), (
        "whatever the robot says of the visit just now"
    )
    assert not sign_after("state", words.state(11, **sent))
    # the page was loaded again
    assert sign_after("state", words.state(12, session=session, epoch=2))
