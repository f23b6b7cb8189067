"""The same permissions for both brokers, made from the topic table."""

import pytest

from robots.api import topics
from robots.broker.mosquitto import permission_file
from robots.broker.permissions import BrokerUser, of_robot, of_server
from tests.support.sessions.permitted import may_publish, may_subscribe

GIRAFF, SERVER = of_robot("giraff"), of_server()
CONCRETE = {topic.suffix: topic.suffix.replace("+", "p1") for topic in topics.TABLE}


@pytest.mark.parametrize("topic", topics.TABLE, ids=lambda topic: topic.suffix)
def test_a_robot_writes_its_outputs_and_a_server_writes_its_inputs(topic):
    concrete = topics.of("giraff", CONCRETE[topic.suffix])
    assert may_publish(GIRAFF, concrete) == (topic.direction == "from_robot")
    assert may_publish(SERVER, concrete) == (topic.direction == "to_robot")


@pytest.mark.parametrize("topic", topics.TABLE, ids=lambda topic: topic.suffix)
def test_a_robot_reads_its_inputs_and_its_own_presence(topic):
    own = topic.direction == "to_robot" or topic.suffix == "connection"
    assert may_subscribe(GIRAFF, topics.of("giraff", CONCRETE[topic.suffix])) == own
    assert may_subscribe(GIRAFF, topics.of("giraff", topic.suffix)) == own


@pytest.mark.parametrize("topic", topics.TABLE, ids=lambda topic: topic.suffix)
def test_a_robot_has_nothing_to_do_with_another_robots_topics(topic):
    concrete = topics.of("rhodon", CONCRETE[topic.suffix])
    assert not may_publish(GIRAFF, concrete)
    assert not may_subscribe(GIRAFF, concrete)


def test_an_agents_own_subscriptions_are_permitted():
    assert all(may_subscribe(GIRAFF, filter_) for filter_ in topics.subscriptions("giraff"))


def test_only_servers_use_the_servers_tree():
    assert may_publish(SERVER, topics.session_notices("s1"))
    assert may_subscribe(SERVER, f"{topics.SERVER}/#")
    assert not may_publish(GIRAFF, topics.session_notices("s1"))
    assert not may_subscribe(GIRAFF, topics.session_notices("s1"))


def test_a_server_reads_everything_of_ours_and_nothing_else():
    assert may_subscribe(SERVER, "telepresence/v1/#")
    assert may_subscribe(SERVER, "telepresence/v1/+/state")
    assert not may_subscribe(SERVER, "#")
    assert not may_subscribe(SERVER, "$SYS/#")


def test_mosquittos_file_names_only_users_that_its_patterns_do_not_cover():
    robots = {f"robot-{n}": BrokerUser(f"robot-{n}", "", of_robot(f"robot-{n}")) for n in range(50)}
    others = {
        "robot-3.0a1b": BrokerUser("robot-3.0a1b", "", of_robot("robot-3")),
        "server.web": BrokerUser("server.web", "", of_server()),
    }
    text = permission_file(robots | others)
    assert text.count("pattern write ") == len(of_robot("robot-1").write)
    assert "pattern write telepresence/v1/%u/state" in text.splitlines()
    assert "pattern read telepresence/v1/%u/lease" in text.splitlines()
    named = [line.split()[1] for line in text.splitlines() if line.startswith("user ")]
    assert named == ["robot-3.0a1b", "server.web"]
    assert "topic write telepresence/v1/robot-3/state" in text.splitlines()
