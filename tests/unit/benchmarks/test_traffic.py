"""The light robots' and visitors' side of the wire, and how the load benchmark reads what they
measured.
"""

import asyncio
import random
import time

import pytest

from benchmarks import load
from benchmarks.traffic import mqtt_line, packets, robots, viewers
from benchmarks.traffic.every import Timers
from benchmarks.traffic.packets import PublishPacket
from robots.api import codec, messages as m, topics


class Owner:
    """Notes what a line hands on."""

    def __init__(self):
        self.said = []

    def opened(self):
        self.said.append("opened")

    def on_message(self, topic, payload, *, retained):
        self.said.append((topic, payload, retained))

    def acknowledged(self, packet_id):
        self.said.append(packet_id)

    def closed(self):
        self.said.append("closed")


class Wire:
    """A transport that notes what is written."""

    def __init__(self):
        self.written = b""
        self.aborted = False

    def write(self, data):
        self.written += data

    def abort(self):
        self.aborted = True


ACCEPTED, BAD_PASSWORD = b"\x20\x02\x00\x00", b"\x20\x02\x00\x04"
SUBSCRIBED, REFUSED = b"\x90\x03\x00\x01\x01", b"\x90\x04\x00\x01\x01\x80"


async def opened_line():
    owner, wire = Owner(), Wire()
    line = mqtt_line.MqttLine(owner, b"hello", [("a/#", 1)])
    line.connection_made(wire)
    line.data_received(ACCEPTED + SUBSCRIBED)
    assert wire.written.startswith(b"hello")
    wire.written = b""
    return line, owner, wire


def test_a_line_writes_the_packets_of_the_standard():
    will = PublishPacket("r/connection", b"x" * 100, 1, retain=True)
    assert mqtt_line.hello("client", "robot", "token", will, keep_alive=30) == (
        b"\x10\x94\x01\x00\x04MQTT\x04\xee\x00\x1e\x00\x06client\x00\x0cr/connection\x00\x64"
        + b"x" * 100
        + b"\x00\x05robot\x00\x05token"
    )
    assert mqtt_line.subscribe([("a/#", 1), ("b", 0)]) == (
        b"\x82\x0c\x00\x01\x00\x03a/#\x01\x00\x01b\x00"
    )


async def test_a_line_hands_on_what_comes_however_it_is_cut_and_confirms_it():
    line, owner, wire = await opened_line()
    stream = b"".join(
        packets.publish(PublishPacket("a/b", bytes([n]) * 300, n % 2, n == 3, n if n % 2 else 0))
        for n in range(4)
    )
    for at in range(0, len(stream), 7):
        line.data_received(stream[at : at + 7])
    assert owner.said == ["opened", *(("a/b", bytes([n]) * 300, n == 3) for n in range(4))]
    assert wire.written == b"\x40\x02\x00\x01\x40\x02\x00\x03"
    line.connection_lost(None)
    assert owner.said[-1] == "closed"


async def test_a_line_that_is_refused_hangs_up():
    owner, wire = Owner(), Wire()
    line = mqtt_line.MqttLine(owner, b"", [])
    line.connection_made(wire)
    line.data_received(BAD_PASSWORD)
    assert wire.aborted
    assert owner.said == []


async def test_a_line_whose_subscription_is_refused_hangs_up_as_a_real_agent_does():
    owner, wire = Owner(), Wire()
    line = mqtt_line.MqttLine(owner, b"", [("a/#", 1), ("b", 0)])
    line.connection_made(wire)
    line.data_received(ACCEPTED + REFUSED)
    assert wire.aborted
    assert owner.said == []


@pytest.fixture
async def robot():
    robot = robots.LightRobot(
        "light-0", "token", robots.RobotMeasurements(), Timers(), random.Random(1)
    )
    line = mqtt_line.MqttLine(robot, b"", [])
    robot.wire = Wire()
    line.connection_made(robot.wire)
    robot._line = line
    robot.opened()
    robot.wire.written = b""
    return robot


def lease(epoch, session="s1", renewal=1):
    return codec.encode(
        m.Lease(session=session, epoch=epoch, peer="p", who="ana", renewal=renewal, stamp=1.0)
    )


def said(robot):
    """Everything that the robot has published since the last time, by suffix."""
    reader = Owner()
    line = mqtt_line.MqttLine(reader, b"", [])
    line.connection_made(Wire())
    line.data_received(robot.wire.written)
    found = [
        (topics.parse(topic)[1], payload)
        for topic, payload, _ in (one for one in reader.said if isinstance(one, tuple))
    ]
    robot.wire.written = b""
    return [(suffix, codec.decode(suffix, payload)) for suffix, payload in found]


async def test_a_robot_that_hears_its_own_will_says_that_it_is_there(robot):
    topic = topics.of(robot.name, "connection")
    robot.on_message(topic, robot._presence("ONLINE"), retained=False)
    robot.on_message(topic, robot._presence("CONNECTIONBROKEN"), retained=True)
    assert said(robot) == []
    robot.on_message(topic, robot._presence("CONNECTIONBROKEN"), retained=False)
    assert [(suffix, word.state) for suffix, word in said(robot)] == [("connection", "ONLINE")]


async def test_a_light_robot_says_what_a_real_one_says_and_counts_its_states(robot):
    robot.on_message(topics.of("light-0", "lease"), lease(1), retained=False)
    assert [message.type for suffix, message in said(robot) if suffix == "event"] == ["lease_taken"]
    command = m.VelocityCommand(
        session="s1", epoch=1, seq=1, stamp=time.time(), linear=0.1, angular=0.0, method="keyboard"
    )
    robot.on_message(
        topics.of("light-0", "command/velocity"), codec.encode(command), retained=False
    )
    robot._say_state()
    ((_, state),) = said(robot)
    assert (state.session, state.epoch, [applied.seq for applied in state.applied]) == (
        "s1",
        1,
        [1],
    )
    robot.on_message(topics.of("light-0", "lease"), b"", retained=False)
    assert [suffix for suffix, _ in said(robot)] == ["state", "event"], (
        "its last state, and that it was the last"
    )
    robot._say_state()
    assert robot.states == {"s1": 2}


async def test_a_light_robot_keeps_states_without_broker_and_resends_old_ones(
    robot,
):
    robot.on_message(topics.of("light-0", "lease"), lease(1), retained=False)
    robot.closed()
    robot.wire.written = b""
    robot._say_state()
    robot._say_pose()
    assert robot.wire.written == b""
    robot.opened()
    kept = [message.seq for suffix, message in said(robot) if suffix == "state"]
    assert kept[-1:] == [1], "and the pose, which is of its moment, is gone"
    again = m.ResendStates(
        action_id="r", stamp=1.0, role="server", boot=robot.boot, first=1, last=1
    )
    robot.on_message(topics.of("light-0", "command/action"), codec.encode(again), retained=False)
    assert [message.seq for suffix, message in said(robot) if suffix == "state"] == [1]


async def test_a_light_robot_leaves_a_node_that_confirms_nothing(robot, monkeypatch):
    robot.acknowledged(1)
    robot.acknowledged(2)  # presence and factsheet
    monkeypatch.setattr(robots, "WORD", -1.0)
    robot._leave_a_mute_node()
    assert not robot.wire.aborted, "nothing waits for its word"
    robot._say_state()
    robot._leave_a_mute_node()
    assert robot.wire.aborted


async def test_commands_that_are_missing_are_counted_by_their_numbers(robot):
    robot.on_message(topics.of("light-0", "lease"), lease(1), retained=False)
    for seq in (5, 6, 9):
        command = m.VelocityCommand(
            session="s1", epoch=1, seq=seq, stamp=1.0, linear=0.1, angular=0.0, method="keyboard"
        )
        robot.on_message(
            topics.of("light-0", "command/velocity"), codec.encode(command), retained=False
        )
    assert robot._measured.counts["commands_missing"] == 2
    assert len(robot._measured.delays) == 3


KEY, DELTA = b"\x50\x00", b"\x51\x00"


async def test_a_viewer_counts_from_the_first_key_frame_and_asks_again_without_frames(
    monkeypatch,
):
    asked, clock = [], [100.0]
    monkeypatch.setattr(viewers.time, "time", lambda: clock[0])
    viewer = viewers.LightViewer("http://127.0.0.1/ws/robots/giraff/", "cookie")
    monkeypatch.setattr(viewer, "take", lambda _peer, message: asked.append(message))
    viewer.look()
    assert not asked, "the server has not said yet that it watches"
    viewer._hear('session/observing\n{"sfu":true}')
    viewer.look()
    for data in (DELTA, KEY, DELTA):
        clock[0] += 1.0
        viewer.page._count_frame(data, 0)
        viewer.look()
    assert viewer.page.seen == [102.0, 103.0]
    assert len(asked) == 1
    clock[0] += viewers.BLIND + 0.1
    viewer.look()
    viewer.page._count_frame(DELTA, 0)
    assert len(asked) == 2
    assert len(viewer.page.seen) == 2, "what a new connection begins with is no whole picture"
    clock[0] += viewers.BLIND + 0.1
    viewer.look()
    assert len(asked) == 2, "it may still come"
    viewer._hear('signal/reply\n{"type":"bye","reason":"sfu_lost"}')
    viewer.look()
    assert len(asked) == 3


async def test_timers_go_on_and_note_how_late_they_are():
    timers, step = Timers(), asyncio.Event()
    count = 0

    def ring():
        nonlocal count
        count += 1
        if count == 3:
            step.set()

    timers.every(0.001, 0.5, ring)
    await asyncio.wait_for(step.wait(), 60)
    assert len(timers.late) >= 3
    assert min(timers.late) >= 0.0


def step(**changed):
    quiet = {"p50": 2.0, "p99": 9.0, "max": 20.0}
    usual = {
        "sessions": 40,
        "driving": 40,
        "to_robot": quiet,
        "to_page": quiet,
        "late": quiet,
        "messages_per_second": 2000.0,
        "missing": 0,
        "record_behind": 0.5,
        "shares": {"web": 0.6, "broker": 0.2, "visitors": 0.1, "others": 0.9},
    }
    return load.LoadStep(**usual | changed)


def test_a_step_breaks_by_delay_loss_a_late_record_or_visitors_who_do_not_drive():
    assert step().breaks == ""
    late = {"p50": 9.0, "p99": load.BOUND_MS + 1, "max": 90.0}
    assert step(to_page=late).breaks == step(to_robot=late).breaks == "late"
    assert step(driving=39).breaks == "only 39 drive"
    assert step(missing=2).breaks == "2 missing"
    assert step(record_behind=99.0).breaks == "record behind"


def test_the_full_part_is_a_process_without_room_or_the_computer():
    assert "web (95 %" in step(shares={"web": 0.95, "broker": 0.2, "others": 0.0}).full
    assert "visitors" in step(shares={"web": 0.5, "visitors": 0.97, "others": 0.0}).full, (
        "also when it is the generator"
    )
    assert step().full.startswith("the computer")


def test_no_sample_at_all_is_no_quick_one():
    assert load.quantiles([])["p99"] == float("inf")
