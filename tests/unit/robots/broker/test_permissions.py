"""The same permissions for both brokers, made from the topic table."""

import pytest

from robots.api import topics
from robots.broker.mosquitto import permission_file
from robots.broker.permissions import BrokerUser, of_robot, of_server

GIRAFF, SERVER = of_robot("giraff"), of_server()
CONCRETE = {topic.suffix: topic.suffix.replace("+", "p1") for topic in topics.TABLE}


@pytest.mark.parametrize("topic", topics.TABLE, ids=lambda topic: topic.suffix)
def test_a_robot_writes_its_outputs_and_a_server_writes_its_inputs(topic):
    concrete = topics.of("giraff", CONCRETE[topic.suffix])
    assert GIRAFF.may_publish(concrete) == (topic.direction == "from_robot")
    assert SERVER.may_publish(concrete) == (topic.direction == "to_robot")


@pytest.mark.parametrize("topic", topics.TABLE, ids=lambda topic: topic.suffix)
def test_a_robot_reads_its_inputs_and_its_own_presence(topic):
    own = topic.direction == "to_robot" or topic.suffix == "connection"
    assert GIRAFF.may_subscribe(topics.of("giraff", CONCRETE[topic.suffix])) == own
    assert GIRAFF.may_subscribe(topics.of("giraff", topic.suffix)) == own


@pytest.mark.parametrize("topic", topics.TABLE, ids=lambda topic: topic.suffix)
def test_a_robot_has_nothing_to_do_with_another_robots_topics(topic):
    concrete = topics.of("rhodon", CONCRETE[topic.suffix])
    assert not GIRAFF.may_publish(concrete)
    assert not GIRAFF.may_subscribe(concrete)


@pytest.mark.parametrize(
    "filter_",
    [
        "#",
        "+/#",
        "telepresence/v1/#",
        "telepresence/v1/giraff/#",
        "telepresence/v1/+/lease",
        "telepresence/v1/giraff/+",
    ],
)
def test_a_robot_cannot_widen_what_it_reads_by_wildcards(filter_):
    assert not GIRAFF.may_subscribe(filter_)


def test_an_agents_own_subscriptions_are_permitted():
    assert all(GIRAFF.may_subscribe(filter_) for filter_, _ in topics.subscriptions("giraff"))


def test_only_servers_use_the_servers_tree():
    assert SERVER.may_publish(topics.session_notices("s1"))
    assert SERVER.may_subscribe(f"{topics.SERVER}/#")
    assert not GIRAFF.may_publish(topics.session_notices("s1"))
    assert not GIRAFF.may_subscribe(topics.session_notices("s1"))


def test_a_server_reads_everything_of_ours_and_nothing_else():
    assert SERVER.may_subscribe("telepresence/v1/#")
    assert SERVER.may_subscribe("telepresence/v1/+/state")
    assert not SERVER.may_subscribe("#")
    assert not SERVER.may_subscribe("$SYS/#")


def test_a_published_topic_with_a_wildcard_is_refused():
    assert not GIRAFF.may_publish("telepresence/v1/giraff/signal/+/reply")


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
