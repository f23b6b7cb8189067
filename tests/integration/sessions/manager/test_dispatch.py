"""Messages of a session besides states: recorded, and sent to other apps."""

import msgspec
import pytest
from aiomqtt import Message, Topic

from accounts.models import User
from robots.api import codec, messages as m, topics
from robots.models import Robot
from sessions import protocol, signals
from sessions.manager import notices
from sessions.manager.dispatch import send_all
from sessions.manager.ingest import Intake
from sessions.models import SessionEvent
from sessions.recording.builder import RecordBuilder
from sessions.recording.items import ActionItem, EventItem, PhotoItem
from sessions.recording.store import RecordStore
from tests.support import words
from tests.support.sessions.rows import session_row

pytestmark = pytest.mark.django_db
NOW = 1_766_000_000.0


class Kept(list):
    """A recorder that keeps what it is given."""

    put = list.append


@pytest.fixture
def session():
    robot = Robot.objects.create(name="giraff", title="Giraff")
    return str(session_row(robot, User.objects.create(username="ana")).pk)


@pytest.fixture
def intake():
    return Intake(Kept(), lambda: NOW, wake_signals=lambda: None, wake_scheduler=lambda: None)


def receive(intake: Intake, topic: str, payload: bytes) -> None:
    intake.receive(Message(Topic(topic), payload, 1, retain=False, mid=1, properties=None))


def from_page(intake: Intake, session: str, message: m.Message | bytes) -> None:
    suffix = "page/network" if isinstance(message, protocol.PageNetwork) else "page/event"
    raw = msgspec.Raw(message if isinstance(message, bytes) else codec.encode(message))
    report = protocol.PageReport(suffix=suffix, session=session, message=raw)
    receive(intake, protocol.page_reports(session), codec.encode(report))


def from_robot(intake: Intake, suffix: str, message: m.Message) -> None:
    receive(intake, topics.of("giraff", suffix), codec.encode(message))


@pytest.fixture
def published():
    received = []

    def receiver(robot, session, message, received_at, **_news):
        received.append((robot, session, message, received_at))

    signals.message_received.connect(receiver)
    yield received
    signals.message_received.disconnect(receiver)


def test_ended_action_belongs_to_the_current_session_of_the_robot(intake, session, published):
    failed = m.ActionStatus(
        action_id="a1", status="FAILED", stamp=NOW, type="photo", reason="no_picture"
    )
    from_robot(intake, "action", failed)  # no session yet
    from_robot(intake, "state", words.state(1, session=session, epoch=1))
    from_robot(intake, "action", msgspec.structs.replace(failed, status="RUNNING"))
    from_robot(intake, "action", failed)
    assert [item for item in intake._recorder if isinstance(item, ActionItem)] == [
        ActionItem("giraff", session, failed, NOW)
    ]
    send_all(intake.fresh(), {})
    assert published == [("giraff", session, failed, NOW)]


def test_picture_of_the_camera_check_is_not_recorded(intake, session):
    from_robot(intake, "state", words.state(1, session=session, epoch=1))
    for action in ("home-1", "p1"):
        photo = {"type": "photo", "action_id": action, "sha256": "ab"}
        event = m.Event(stamp=NOW, boot="b1", seq=2, session=session, epoch=1, **photo)
        from_robot(intake, "event", event)
        receive(intake, topics.of("giraff", f"photo/{action}"), b"\xff\xd8")
    events = [item.event for item in intake._recorder if isinstance(item, EventItem)]
    photos = [item for item in intake._recorder if isinstance(item, PhotoItem)]
    assert [one.action_id for one in events + photos] == ["p1", "p1"]


def test_frequently_repeated_actions_are_not_recorded(intake, session):
    from_robot(intake, "state", words.state(1, session=session, epoch=1))
    for kind in ("stop", "estop", "resend_states", ""):
        finished = m.ActionStatus(action_id="a1", status="FINISHED", stamp=NOW, type=kind)
        from_robot(intake, "action", finished)
    assert not [item for item in intake._recorder if isinstance(item, ActionItem)]


def test_ended_action_is_recorded_once(session):
    builder, store = RecordBuilder(RecordStore(), lambda *_: None), RecordStore()
    status = m.ActionStatus(
        action_id="g1", status="CANCELLED", stamp=NOW, type="goto", reason="manual\0"
    )
    for _ in range(2):
        builder.take(ActionItem("giraff", session, status, NOW))
    builder.take(ActionItem("rhodon", session, status, NOW))  # not of its session
    store.insert(builder.rows)
    row = SessionEvent.objects.get()
    assert (row.source, row.type, row.stamp) == ("robot", "action", NOW)
    assert row.data == {"actionId": "g1", "status": "CANCELLED", "type": "goto", "reason": "manual"}


def test_events_and_page_reports_reach_other_apps_unless_malformed(intake, session, published):
    event = protocol.PageEvent(stamp=1.0, type="first_frame")
    for message in (event, protocol.PageNetwork(stamp=1.0, way="mqtt"), b'{"stamp":1}'):
        from_page(intake, session, message)
    photo = m.Event(stamp=2.0, boot="b1", seq=2, session=session, type="photo", action_id="a1")
    from_robot(intake, "event", photo)
    from_robot(intake, "event", m.Event(stamp=2.0, boot="b1", seq=3, type="docked"))
    send_all(intake.fresh(), {"giraff": 0.5})
    assert published == [("", session, event, NOW), ("giraff", session, photo, NOW)]
    assert intake.fresh() == []


def test_late_state_is_sent_as_a_recovered_one(intake, session):
    seen = []

    def receiver(signal, state, **_news):
        seen.append(("late" if signal is signals.state_recovered else "", state.seq))

    for signal in (signals.state_received, signals.state_recovered):
        signal.connect(receiver)
    for seq in (1, 4, 2, 4):
        from_robot(intake, "state", words.state(seq, session=session, epoch=1))
    send_all(intake.fresh(), {})
    assert seen == [("", 1), ("", 4), ("late", 2), ("late", 4)]


def test_notices_of_a_task_wait_for_the_next_tick():
    notices.drain()
    task = protocol.Task(session="s1", stamp=NOW, cue="dock_now")
    notices.publish(task)
    assert notices.are_waiting()
    assert notices.drain() == [task]
    assert not notices.are_waiting()


def test_driving_calls_autonomy_stops_and_input_of_the_page_are_activity(session):
    now = [NOW]
    clock = lambda: now[0]
    intake = Intake(
        Kept(), clock, wake_signals=lambda: None, wake_scheduler=lambda: None, monotonic=clock
    )

    def last_sign():
        active_at = intake.liveness["giraff"].link(0.0).active_at or 0.0
        return max(active_at, intake.signs.get(session, 0.0))

    def sign_after(suffix, message):
        now[0] += 10.0
        before = last_sign()
        if suffix == "page":
            from_page(intake, session, message)
        else:
            from_robot(intake, suffix, message)
        return last_sign() == now[0] != before

    sent = {"session": session, "epoch": 1}
    from_robot(intake, "state", words.state(1))
    assert sign_after("state", words.state(2, **sent))  # a page has connected
    assert not sign_after("state", words.state(3, **sent))
    assert sign_after("state", words.state(4, applied=(words.applied(),), **sent))
    assert sign_after("state", words.state(5, mode="goto", **sent))
    assert sign_after("state", words.state(6, call=m.CallState(status="accepted"), **sent))
    assert not sign_after("state", words.state(7, **sent))
    assert sign_after("state", words.state(8, safety=m.Safety(estop=True), **sent)), (
        "a driver who waits for the release of the stop can do nothing"
    )
    assert not sign_after("state", words.state(9, **sent))
    assert sign_after("page", protocol.PageEvent(stamp=1.0, type=protocol.HERE))
    assert not sign_after("page", protocol.PageEvent(stamp=1.0, type="blur"))
    assert not sign_after("state", words.state(10))  # its lease lapsed
    assert sign_after("page", protocol.PageEvent(stamp=1.0, type=protocol.HERE)), (
        "although the robot reports no session"
    )
    assert not sign_after("state", words.state(11, **sent))
    # the page was loaded again
    assert sign_after("state", words.state(12, session=session, epoch=2))
