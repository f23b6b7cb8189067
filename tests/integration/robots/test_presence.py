"""What a robot's messages make of its row."""

import datetime

import pytest
from django.db import DataError
from django.db import connection as database
from django.test.utils import CaptureQueriesContext

from robots.api.messages import (
    Battery,
    Connection,
    Factsheet,
    Limits,
    Pose,
    PoseUpdate,
    State,
    Velocity,
)
from robots.models import Robot, RobotPresence
from robots.presence import writer as writing
from robots.presence.report import trouble_of
from robots.presence.writer import PresenceWriter, changes
from sessions.shards.ownership import EVERYTHING
from tests.support.robots import create_robots, unsaved_robot

NOW = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)


def after(seconds):
    return NOW + datetime.timedelta(seconds=seconds)


def connection(state, boot="b1"):
    return Connection(boot=boot, state=state, stamp=1.0)


def state(seq, boot="b1", **fields):
    return State(
        **fields,
        stamp=1.0,
        boot=boot,
        seq=seq,
        pose=Pose(x=1.0, y=2.0, theta=0.0),
        velocity=Velocity(linear=0.0, angular=0.0),
        battery=Battery(charge=0.5),
    )


FACTSHEET = Factsheet(
    name="giraff",
    series="Giraff",
    rca="simulator",
    agent_version="1",
    boot="b1",
    capabilities=("velocity",),
    watchdog=0.3,
    footprint=((0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2)),
    limits=Limits(
        linear=0.7,
        reverse=0.3,
        angular=0.7,
        linear_acceleration=0.2,
        angular_acceleration=0.4,
        linear_braking=0.8,
        angular_braking=1.0,
    ),
)


class Heard(PresenceWriter):
    """Looks after every message, as often as a session manager that has nothing else to do."""

    def take(self, name, message, now, **how):
        super().take(name, message, now, **how)
        self.write(now)


def row(**fields):
    return RobotPresence(**fields)


def test_a_robot_that_says_online_is_online():
    found = changes(row(), connection("ONLINE"), NOW)
    assert found == {"connection": "ONLINE", "boot": "b1", "last_seen_at": NOW}


@pytest.mark.parametrize("word", ["OFFLINE", "CONNECTIONBROKEN"])
def test_the_end_of_the_same_boot_counts(word):
    assert changes(row(connection="ONLINE", boot="b1"), connection(word), NOW)["connection"] == word


@pytest.mark.parametrize("word", ["OFFLINE", "CONNECTIONBROKEN"])
def test_the_late_end_of_an_earlier_boot_is_ignored(word):
    assert changes(row(connection="ONLINE", boot="b2"), connection(word, boot="b1"), NOW) == {}


def test_a_retained_message_says_nothing_about_now():
    assert "last_seen_at" not in changes(row(), connection("ONLINE"), NOW, retained=True)


def test_a_state_that_comes_after_the_will_does_not_raise_the_dead():
    assert "connection" not in changes(row(connection="CONNECTIONBROKEN", boot="b1"), state(5), NOW)
    assert "connection" not in changes(row(connection="OFFLINE", boot="b1"), state(5), NOW)


def test_a_state_that_was_sent_again_does_not_replace_a_newer_one():
    known = row(connection="ONLINE", boot="b1", report=changes(row(), state(9), NOW)["report"])
    assert changes(known, state(9), NOW) == {}
    assert changes(known, state(3), NOW) == {}
    assert changes(known, state(10), NOW)["report"]["seq"] == 10
    assert changes(known, state(1, boot="b2"), NOW)["report"]["boot"] == "b2"


def test_a_message_for_pages_alone_does_not_change_the_presence():
    message = PoseUpdate(
        stamp=1.0, pose=Pose(x=0.0, y=0.0, theta=0.0), velocity=Velocity(linear=0.0, angular=0.0)
    )
    assert changes(row(), message, NOW) == {}


@pytest.mark.django_db
def test_a_robot_comes_and_goes_and_the_row_tells():
    Robot.objects.create(name="giraff", title="Giraff")
    writer = Heard(EVERYTHING)
    writer.take("giraff", connection("ONLINE"), NOW)
    assert Robot.objects.get().is_online(after(5))
    writer.take("giraff", connection("CONNECTIONBROKEN"), after(2))
    assert RobotPresence.objects.get().connection == "CONNECTIONBROKEN"
    assert not Robot.objects.get().is_online(after(2))


@pytest.mark.django_db
def test_the_factsheet_is_kept_as_it_stands_on_the_wire():
    Robot.objects.create(name="giraff", title="Giraff")
    Heard(EVERYTHING).take("giraff", FACTSHEET, NOW)
    kept = RobotPresence.objects.get().factsheet
    assert kept["agentVersion"] == "1"
    assert kept["limits"]["linearBraking"] == 0.8


@pytest.mark.django_db
def test_four_states_a_second_are_written_once_in_two():
    Robot.objects.create(name="giraff", title="Giraff")
    writer = Heard(EVERYTHING)
    writer.take("giraff", connection("ONLINE"), NOW)
    with CaptureQueriesContext(database) as queries:
        for number in range(40):
            writer.take("giraff", state(number), after(0.25 * (number + 1)))
    assert sum("UPDATE" in query["sql"] for query in queries) == 5
    kept = RobotPresence.objects.get()
    assert kept.last_seen_at >= after(8)
    assert kept.report["seq"] >= 30


@pytest.mark.django_db
def test_the_last_state_before_a_silence_is_written_too():
    Robot.objects.create(name="giraff", title="Giraff")
    writer = Heard(EVERYTHING)
    writer.take("giraff", connection("ONLINE"), NOW)
    writer.take("giraff", state(1), after(0.1))
    writer.take("giraff", state(2), after(0.2))
    writer.write(after(0.5))
    assert RobotPresence.objects.get().report["seq"] == 1
    writer.write(after(2.5))
    assert RobotPresence.objects.get().report["seq"] == 2


@pytest.mark.django_db
def test_a_robot_that_is_silent_for_half_a_minute_is_online_and_after_that_it_is_not():
    Robot.objects.create(name="giraff", title="Giraff")
    Heard(EVERYTHING).take("giraff", connection("ONLINE"), NOW)
    assert Robot.objects.get().is_online(after(40))
    assert not Robot.objects.get().is_online(after(46))


@pytest.mark.django_db
def test_a_change_that_was_rolled_back_is_written_again_after_forget():
    Robot.objects.create(name="giraff", title="Giraff")
    writer = Heard(EVERYTHING)
    writer.take("giraff", connection("ONLINE"), NOW)
    RobotPresence.objects.update(connection="OFFLINE")  # as if it had been rolled back
    writer.forget({"giraff"})
    writer.take("giraff", connection("ONLINE"), after(1))
    assert Robot.objects.get().is_online(after(1))


@pytest.mark.django_db
def test_that_a_robot_is_not_reached_any_more_is_written_at_once_with_the_reason():
    Robot.objects.create(name="giraff", title="Giraff")
    writer = Heard(EVERYTHING)
    writer.take("giraff", connection("ONLINE"), NOW)
    writer.take("giraff", state(1), after(0.1))
    assert trouble_of(RobotPresence.objects.get().report) == ""
    writer.take(
        "giraff",
        state(2, errors=("lens dirty", "adapter_lost: no ROS master at http://robot:11311")),
        after(0.2),
    )
    assert trouble_of(RobotPresence.objects.get().report) == "no ROS master at http://robot:11311"
    writer.take("giraff", state(3), after(0.3))
    assert trouble_of(RobotPresence.objects.get().report) == ""
    starting = "adapter_starting: the agent is connecting to the robot"
    assert trouble_of({"errors": [starting]}) == "the agent is connecting to the robot"


@pytest.mark.parametrize(
    "report",
    [None, "x", [], {"errors": 3}, {"errors": None}, {"errors": [7, None, "adapter_lost"]}],
)
def test_a_report_that_makes_no_sense_tells_of_no_trouble(report):
    assert trouble_of(report) == ""


@pytest.mark.django_db
def test_presence_leaves_what_people_edit_alone():
    robot = Robot.objects.create(name="giraff", title="Giraff")
    writer = Heard(EVERYTHING)
    writer.take("giraff", connection("ONLINE"), NOW)
    Robot.objects.filter(pk=robot.pk).update(title="Renamed", enabled=False)
    writer.take("giraff", connection("OFFLINE"), after(5))
    robot.refresh_from_db()
    assert (robot.title, robot.enabled, robot.presence.connection) == ("Renamed", False, "OFFLINE")


@pytest.mark.django_db
def test_an_unknown_robot_is_ignored_without_asking_the_database_each_time(
    django_assert_num_queries,
):
    writer = Heard(EVERYTHING)
    with django_assert_num_queries(1):
        for number in range(10):
            writer.take("nobody", state(number), after(number / 4))


@pytest.mark.django_db
def test_a_robot_deleted_and_made_anew_is_found_again():
    Robot.objects.create(name="giraff", title="Giraff")
    writer = Heard(EVERYTHING)
    writer.take("giraff", connection("ONLINE"), NOW)
    Robot.objects.all().delete()
    writer.take("giraff", connection("OFFLINE"), after(1))
    Robot.objects.create(name="giraff", title="Giraff")
    writer.take("giraff", connection("ONLINE", boot="b2"), after(2))
    assert RobotPresence.objects.get().connection == "ONLINE"


@pytest.mark.django_db
def test_many_robots_are_read_and_written_together(django_assert_num_queries):
    create_robots(*(unsaved_robot(name=f"r{n}", title=f"R{n}") for n in range(50)))
    writer = PresenceWriter(EVERYTHING)
    names = [f"r{n}" for n in range(50)] + ["nobody"]
    with django_assert_num_queries(4):  # read, savepoint, write, its release
        writer.read(names, NOW)
        for name in names:
            writer.take(name, connection("ONLINE", boot=f"boot-{name}"), NOW)
            writer.take(name, FACTSHEET, NOW)
            writer.take(name, state(1, boot=f"boot-{name}"), NOW)
        writer.write(NOW)
    kept = RobotPresence.objects.get(robot__name="r7")
    assert (kept.connection, kept.boot, kept.report["boot"]) == ("ONLINE", "boot-r7", "boot-r7")
    assert kept.factsheet["series"] == "Giraff"
    assert kept.last_seen_at == NOW


@pytest.mark.django_db
def test_a_row_that_the_database_refuses_costs_no_other_robot_its_presence(monkeypatch):
    create_robots(*(unsaved_robot(name=name, title=name) for name in ("giraff", "rhodon")))
    together = writing.update_each

    def strict(rows, fields):
        if any(row.robot.name == "rhodon" for row in rows):
            raise DataError("unsupported Unicode escape sequence")
        return together(rows, fields)

    monkeypatch.setattr(writing, "update_each", strict)
    writer = PresenceWriter(EVERYTHING)
    for name in ("giraff", "rhodon"):
        writer.take(name, connection("ONLINE"), NOW)
    writer.write(NOW)
    writer.write(after(1))
    assert RobotPresence.objects.get(robot__name="giraff").connection == "ONLINE"
    assert RobotPresence.objects.get(robot__name="rhodon").connection != "ONLINE"


def test_text_that_postgresql_cannot_hold_is_left_out():
    found = changes(row(), state(1, errors=("lens\0 dirty",)), NOW)
    assert found["report"]["errors"] == ["lens dirty"]
