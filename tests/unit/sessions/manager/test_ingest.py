"""Messages that a session manager takes: of its robots, and of robots that become its own."""

from unittest import mock

import msgspec
import pytest
from aiomqtt import Message, Topic

from robots.api import codec, messages as m, topics
from robots.bridge.known import DOUBT_SECONDS
from sessions import protocol
from sessions.manager import ingest as module
from sessions.manager.ingest import Intake, PresenceNews
from sessions.manager.intake_gate import IntakeGate
from sessions.shards.foreign_messages import EARLY_SECONDS
from sessions.shards.hashing import shard_of
from sessions.shards.ownership import Ownership
from tests.support import words

ONLINE = words.online()


class Manager:
    """An intake with a clock, without robots until `own` names some."""

    def __init__(self):
        self.now, self.recorded, self.woken = 1000.0, [], 0
        self.ownership = Ownership(lambda: self.now)
        self.intake = Intake(
            mock.Mock(put=self.recorded.append),
            lambda: self.now,
            wake_signals=lambda: None,
            wake_scheduler=self._wake,
            monotonic=lambda: self.now,
        )
        self.gate = IntakeGate(self.intake, self.ownership, lambda: self.now)

    def _wake(self):
        self.woken += 1

    def own(self, *robots):
        self.ownership.become({shard_of(robot): 1 for robot in robots})
        self.gate.follow()

    def hear(self, topic, payload):
        data = payload if isinstance(payload, bytes) else codec.encode(payload)
        self.gate.receive(Message(Topic(topic), data, 1, retain=False, mid=1, properties=None))

    def robot_says(self, suffix, message, robot="giraff"):
        self.hear(topics.of(robot, suffix), message)

    def page_says(self, session, kind):
        event = msgspec.Raw(codec.encode(protocol.PageEvent(stamp=1.0, type=kind)))
        report = protocol.PageReport(suffix="page/event", session=session, message=event)
        self.hear(protocol.page_reports(session), report)


@pytest.fixture
def manager():
    return Manager()


def event(seq):
    return m.Event(stamp=1.0, boot="b1", seq=seq, type="docked")


def test_recent_messages_of_a_robot_are_taken_when_it_becomes_ours(manager):
    manager.robot_says("event", event(1))
    manager.now += EARLY_SECONDS - 1.0
    manager.robot_says("event", event(2))
    manager.robot_says("event", event(3), robot="rhodon")
    assert manager.recorded == []
    manager.own("giraff")
    assert [(item.event.seq, item.received_at) for item in manager.recorded] == [
        (1, 1000.0),
        (2, manager.now),
    ]
    manager.own("giraff", "rhodon")
    assert manager.recorded[-1].robot == "rhodon"
    assert len(manager.recorded) == 3


def test_older_messages_are_not_taken(manager):
    manager.robot_says("event", event(1))
    manager.now += EARLY_SECONDS + 1.0
    manager.robot_says("event", event(2), robot="rhodon")
    manager.now += 1.0
    manager.own("giraff", "rhodon")
    assert [item.robot for item in manager.recorded] == ["rhodon"]
    manager.own()
    manager.robot_says("event", event(3))
    manager.now += EARLY_SECONDS + 1.0
    manager.own("giraff")
    assert len(manager.recorded) == 1


def test_without_a_change_of_owners_no_robot_is_taken_over_again(manager):
    manager.own("giraff")
    manager.robot_says("event", event(1))
    manager.gate.follow()
    assert len(manager.recorded) == 1


def test_bytes_that_were_no_message_are_counted_when_their_robot_becomes_ours(manager):
    manager.robot_says("event", b"nonsense")
    manager.robot_says("event", event(1))
    manager.own("giraff")
    assert manager.intake.counts == {"malformed": 1}
    assert len(manager.recorded) == 1


def test_a_robot_that_is_anothers_by_now_is_forgotten(manager):
    manager.own("giraff", "rhodon")
    for robot in ("giraff", "rhodon"):
        manager.robot_says("state", words.state(1), robot)
    manager.own("rhodon")
    assert set(manager.intake.liveness) == {"rhodon"}
    assert [news.robot for news in manager.intake.presence_news()] == ["rhodon"]


def test_a_robot_that_sends_nonsense_for_ever_fills_no_log(manager, caplog):
    manager.own("giraff")
    for _ in range(1000):
        manager.robot_says("event", b"{")
    assert manager.intake.counts["malformed"] == 1000
    assert caplog.text.count("message_rejected") == 101


@pytest.mark.parametrize(
    ("topic", "payload", "reason"),
    [
        ("somewhere/else", b"{}", "unknown_topic"),
        (topics.session_notices("s1"), b"x" * (protocol.MAX_FRAME + 1), "oversized"),
        (protocol.page_reports("s1"), b"x" * (protocol.MAX_FRAME + 1), "oversized"),
    ],
)
def test_malformed_messages_are_counted_by_reason(manager, topic, payload, reason):
    manager.hear(topic, payload)
    assert manager.intake.counts == {reason: 1}


def test_only_a_session_that_a_web_process_has_ended_wakes_the_scheduler(manager):
    task = protocol.Task(session="s1", stamp=1.0, cue="dock_now")
    manager.hear(topics.session_notices("s1"), protocol.notice_frame(task).encode())
    assert manager.woken == 0
    ended = protocol.Ended(session="s1", outcome="completed", reason="left")
    manager.hear(topics.session_notices("s1"), protocol.notice_frame(ended).encode())
    assert manager.woken == 1


def test_presence_that_was_not_stored_is_repeated_in_order(manager):
    manager.own("giraff")
    sheet = words.factsheet()
    manager.robot_says("connection", ONLINE)
    manager.robot_says("factsheet", sheet)
    news = manager.intake.presence_news()
    assert news == [PresenceNews("giraff", ONLINE), PresenceNews("giraff", sheet)]
    manager.robot_says("connection", words.broken())
    manager.intake.repeat_news(news)
    assert manager.intake.presence_news() == [*news, PresenceNews("giraff", words.broken())]


def test_a_robot_with_heartbeats_stays_online_after_a_late_will(manager):
    manager.own("giraff")
    manager.robot_says("connection", ONLINE)
    manager.robot_says("connection", words.broken())
    manager.now += DOUBT_SECONDS - 0.1
    manager.robot_says("heartbeat", m.Heartbeat(n=1, stamp=1.0))
    assert manager.intake.presence_news()[-1] == PresenceNews("giraff", words.broken())
    for n in (2, 3):
        manager.now += 0.2
        manager.robot_says("heartbeat", m.Heartbeat(n=n, stamp=1.0))
    found = [news.message for news in manager.intake.presence_news()]
    assert [(message.state, message.boot) for message in found] == [("ONLINE", ONLINE.boot)]


def test_a_robot_that_went_and_beats_no_more_is_gone(manager):
    manager.own("giraff")
    manager.robot_says("connection", ONLINE)
    manager.robot_says("heartbeat", m.Heartbeat(n=1, stamp=1.0))
    manager.robot_says("connection", words.broken())
    manager.now += 2 * DOUBT_SECONDS
    manager.robot_says("state", words.state())  # which the broker had kept
    last = [news.message for news in manager.intake.presence_news()][-2:]
    assert last == [words.broken(), words.state()]


def test_of_signs_of_pages_the_newest_are_kept(manager, monkeypatch):
    monkeypatch.setattr(module, "MAX_SIGNS", 2)
    for session in ("s1", "s2", "s1", "s3"):
        manager.now += 1.0
        manager.page_says(session, protocol.HERE)
    assert manager.intake.signs == {"s1": 1003.0, "s3": 1004.0}


def test_while_news_cannot_be_stored_only_the_newest_of_each_robot_is_kept(manager):
    manager.own("giraff")
    for number in range(1000):
        manager.robot_says("factsheet", words.factsheet(agent_version=str(number)))
        manager.robot_says("connection", words.broken() if number % 2 else ONLINE)
        manager.intake.repeat_news(manager.intake.presence_news())
    news = [one.message for one in manager.intake.presence_news()]
    assert news == [ONLINE, words.factsheet(agent_version="999"), words.broken()]


def test_photos_of_robots_that_are_not_ours_take_a_bounded_amount_of_memory(manager):
    photo = bytes(512 * 1024)
    for number in range(200):
        manager.hear(topics.of("rhodon", f"photo/a{number}"), photo)
    manager.own("rhodon")
    assert 0 < sum(len(item.jpeg) for item in manager.recorded) <= 32 * 1024 * 1024
