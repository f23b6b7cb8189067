"""How a robot's messages change its presence."""

import datetime

import msgspec
import pytest
from django.db import DataError, OperationalError, connection as database
from django.test.utils import CaptureQueriesContext

from accounts import interventions
from accounts.models import AuditEntry
from robots.api.messages import Connection
from robots.models import Robot, RobotPresence
from robots.presence import writer as writing
from robots.presence.report import trouble_of
from robots.presence.writer import PresenceWriter, changes
from sessions.shards.ownership import EVERYTHING
from tests.support import words
from tests.support.robots import create_robot, create_robots, unsaved_robot

NOW = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)


def after(seconds):
    return NOW + datetime.timedelta(seconds=seconds)


def connection(state, boot="b1"):
    return Connection(boot=boot, state=state, stamp=1.0)


class ImmediateWriter(PresenceWriter):
    """Writes after every message, as an idle session manager does."""

    def take(self, name, message, now, **how):
        super().take(name, message, now, **how)
        self.write(now)


@pytest.fixture
def giraff(db):
    return Robot.objects.create(name="giraff", title="Giraff")


@pytest.fixture
def writer(giraff):
    """The writer of a robot that is online."""
    writer = ImmediateWriter(EVERYTHING)
    writer.take("giraff", connection("ONLINE"), NOW)
    return writer


def test_online_message_sets_connection_boot_and_last_seen():
    found = changes(RobotPresence(), connection("ONLINE"), NOW)
    assert found == {"connection": "ONLINE", "boot": "b1", "last_seen_at": NOW}


@pytest.mark.parametrize("ended", ["OFFLINE", "CONNECTIONBROKEN"])
def test_end_of_the_current_boot_is_stored_and_that_of_an_earlier_one_ignored(ended):
    online = RobotPresence(connection="ONLINE", boot="b2")
    assert changes(online, connection(ended, boot="b2"), NOW)["connection"] == ended
    assert changes(online, connection(ended, boot="b1"), NOW) == {}


def test_retained_message_does_not_change_last_seen():
    assert "last_seen_at" not in changes(RobotPresence(), connection("ONLINE"), NOW, retained=True)


def test_state_after_the_will_does_not_change_the_connection():
    for ended in ("CONNECTIONBROKEN", "OFFLINE"):
        presence = RobotPresence(connection=ended, boot="b1")
        assert "connection" not in changes(presence, words.state(5), NOW)


def test_repeated_state_does_not_replace_a_newer_one():
    known = RobotPresence(
        connection="ONLINE",
        boot="b1",
        report=changes(RobotPresence(), words.state(9), NOW)["report"],
    )
    assert changes(known, words.state(9), NOW) == {}
    assert changes(known, words.state(3), NOW) == {}
    assert changes(known, words.state(10), NOW)["report"]["seq"] == 10
    assert changes(known, words.state(1, boot="b2"), NOW)["report"]["boot"] == "b2"


def test_pose_update_does_not_change_the_presence():
    assert changes(RobotPresence(), words.pose(), NOW) == {}


def test_presence_follows_the_connection(writer):
    assert Robot.objects.get().is_online(after(5))
    writer.take("giraff", connection("CONNECTIONBROKEN"), after(2))
    assert RobotPresence.objects.get().connection == "CONNECTIONBROKEN"
    assert not Robot.objects.get().is_online(after(2))


def test_factsheet_is_stored_as_on_the_wire(writer):
    writer.take("giraff", words.factsheet(), NOW)
    kept = RobotPresence.objects.get().factsheet
    assert kept["agentVersion"] == "1"
    assert kept["limits"]["linearBraking"] == 1.0


def test_states_at_4_hz_are_written_every_2_s(writer):
    with CaptureQueriesContext(database) as queries:
        for number in range(40):
            writer.take("giraff", words.state(number), after(0.25 * (number + 1)))
    assert sum("UPDATE" in query["sql"] for query in queries) == 5
    kept = RobotPresence.objects.get()
    assert kept.last_seen_at >= after(8)
    assert kept.report["seq"] >= 30


def test_last_state_before_a_silence_is_written(writer):
    writer.take("giraff", words.state(1), after(0.1))
    writer.take("giraff", words.state(2), after(0.2))
    writer.write(after(0.5))
    assert RobotPresence.objects.get().report["seq"] == 1
    writer.write(after(2.5))
    assert RobotPresence.objects.get().report["seq"] == 2


def test_robot_is_online_until_it_was_silent_for_45_s(writer):
    assert Robot.objects.get().is_online(after(40))
    assert not Robot.objects.get().is_online(after(46))


@pytest.mark.parametrize("enabled", [True, False])
@pytest.mark.parametrize("link", ["ONLINE", "OFFLINE", "CONNECTIONBROKEN"])
@pytest.mark.parametrize("silence", [None, 0, 44, 45, 46])
def test_a_query_counts_the_same_robots_online_as_the_model(db, enabled, link, silence):
    seen_at = None if silence is None else NOW - datetime.timedelta(seconds=silence)
    robot = create_robot(enabled=enabled, connection=link, last_seen_at=seen_at)
    (found,) = Robot.objects.annotate(online=Robot.online_at(NOW))
    assert found.online is robot.is_online(NOW)


def test_rolled_back_change_is_written_again_after_forget(writer):
    RobotPresence.objects.update(connection="OFFLINE")  # as if it had been rolled back
    writer.forget({"giraff"})
    writer.take("giraff", connection("ONLINE"), after(1))
    assert Robot.objects.get().is_online(after(1))


def test_lost_robot_is_written_at_once_with_the_reason(writer):
    writer.take("giraff", words.state(1), after(0.1))
    assert trouble_of(RobotPresence.objects.get().report) == ""
    errors = ("lens dirty", "adapter_lost: no ROS master at http://robot:11311")
    writer.take("giraff", words.state(2, errors=errors), after(0.2))
    assert trouble_of(RobotPresence.objects.get().report) == "no ROS master at http://robot:11311"
    writer.take("giraff", words.state(3), after(0.3))
    assert trouble_of(RobotPresence.objects.get().report) == ""
    starting = "adapter_starting: the agent is connecting to the robot"
    assert trouble_of({"errors": [starting]}) == "the agent is connecting to the robot"


@pytest.mark.parametrize(
    "report",
    [None, "x", [], {"errors": 3}, {"errors": None}, {"errors": [7, None, "adapter_lost"]}],
)
def test_malformed_report_contains_no_trouble(report):
    assert trouble_of(report) == ""


def test_edited_fields_are_not_overwritten(writer, giraff):
    Robot.objects.update(title="Renamed", enabled=False)
    writer.take("giraff", connection("OFFLINE"), after(5))
    giraff.refresh_from_db()
    assert (giraff.title, giraff.enabled) == ("Renamed", False)
    assert giraff.presence.connection == "OFFLINE"


@pytest.mark.django_db
def test_unknown_robot_costs_one_query(django_assert_num_queries):
    writer = ImmediateWriter(EVERYTHING)
    with django_assert_num_queries(1):
        for number in range(10):
            writer.take("unknown", words.state(number), after(number / 4))


def test_robot_that_was_deleted_and_created_again_is_found(writer):
    Robot.objects.all().delete()
    writer.take("giraff", connection("OFFLINE"), after(1))
    Robot.objects.create(name="giraff", title="Giraff")
    writer.take("giraff", connection("ONLINE", boot="b2"), after(2))
    assert RobotPresence.objects.get().connection == "ONLINE"


@pytest.mark.django_db
def test_many_robots_are_read_and_written_together(django_assert_num_queries):
    create_robots(*(unsaved_robot(name=f"r{n}", title=f"R{n}") for n in range(50)))
    writer = PresenceWriter(EVERYTHING)
    names = [f"r{n}" for n in range(50)] + ["unknown"]
    # read, savepoint, write, its release; of the changes what is known, and two parts of the others
    with django_assert_num_queries(7):
        writer.read(names, NOW)
        for name in names:
            writer.take(name, connection("ONLINE", boot=f"boot-{name}"), NOW)
            writer.take(name, words.factsheet(), NOW)
            writer.take(name, words.state(1, boot=f"boot-{name}"), NOW)
        writer.write(NOW)
    kept = RobotPresence.objects.get(robot__name="r7")
    assert (kept.connection, kept.boot, kept.report["boot"]) == ("ONLINE", "boot-r7", "boot-r7")
    assert kept.factsheet["series"] == "Giraff"
    assert kept.last_seen_at == NOW


@pytest.mark.django_db
def test_row_that_the_database_refuses_does_not_affect_other_robots(monkeypatch):
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


def test_characters_that_postgresql_cannot_store_are_removed():
    found = changes(RobotPresence(), words.state(1, errors=("lens\0 dirty",)), NOW)
    assert found["report"]["errors"] == ["lens dirty"]


def noted() -> dict[str, dict]:
    return {entry.act: entry.data for entry in AuditEntry.objects.order_by("at")}


def test_first_factsheet_notes_software_and_profile_and_the_same_again_nothing(writer):
    writer.take("giraff", words.factsheet(), NOW)
    found = noted()
    assert found["agent_changed"]["agentVersion"] == [None, "1"]
    assert found["profile_changed"]["watchdog"] == [None, 0.5]
    writer.take("giraff", words.factsheet(boot="b2"), after(1))
    assert AuditEntry.objects.count() == 2


def test_another_version_and_another_limit_are_noted_with_both_values(writer):
    writer.take("giraff", words.factsheet(), NOW)
    limits = words.factsheet().limits
    slower = msgspec.structs.replace(limits, linear=0.4)
    sheet = words.factsheet(boot="b2", agent_version="2", limits=slower)
    writer.take("giraff", sheet, after(1))
    assert noted()["agent_changed"] == {"agentVersion": ["1", "2"]}
    before, now = noted()["profile_changed"]["limits"]
    assert (before["linear"], now["linear"]) == (0.7, 0.4)


def test_changes_that_the_database_refuses_at_first_are_noted_once(writer, monkeypatch):
    def refuse(_rows):
        raise OperationalError("database is locked")

    with monkeypatch.context() as patch:
        patch.setattr(interventions, "store", refuse)
        with pytest.raises(OperationalError):
            writer.take("giraff", words.factsheet(), NOW)
    writer.forget()
    RobotPresence.objects.update(factsheet=None)
    writer.take("giraff", words.factsheet(), after(1))
    assert AuditEntry.objects.count() == 2


def test_practice_robots_have_no_log_of_interventions(writer):
    Robot.objects.update(practice=True)
    writer.forget()
    writer.take("giraff", words.factsheet(), NOW)
    assert noted() == {}
