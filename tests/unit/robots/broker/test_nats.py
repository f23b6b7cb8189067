"""The users and permissions that NATS reads."""

import json
import re

import pytest

from robots.api import topics
from robots.broker.engines import ENGINES
from robots.broker.nats import subjects, user_file
from robots.broker.permissions import BrokerUser, of_robot, of_server

GIRAFF = BrokerUser("giraff", "$7$…", of_robot("giraff"), "$2b$04$hash")


def rows(users):
    text = user_file({user.name: user for user in users})
    return {
        row["user"]: row
        for row in map(json.loads, re.findall(r"^ {4}(\{.*\})$", text, re.MULTILINE))
    }


@pytest.mark.parametrize(
    ("filter_", "wanted"),
    [
        ("telepresence/v1/giraff/lease", ["telepresence.v1.giraff.lease"]),
        ("telepresence/v1/+/signal/+/reply", ["telepresence.v1.*.signal.*.reply"]),
        ("telepresence/v1/#", ["telepresence.v1", "telepresence.v1.>"]),
        ("#", [">"]),
    ],
)
def test_a_filter_becomes_subjects_that_match_the_same_topics(filter_, wanted):
    assert subjects([filter_]) == wanted


def test_a_robots_user_publishes_its_outputs_and_reads_its_inputs_alone():
    allowed = rows([GIRAFF])["giraff"]["permissions"]
    outputs = [topic for topic in topics.TABLE if topic.direction == "from_robot"]
    assert len(allowed["publish"]["allow"]) == len(outputs)
    everything = allowed["publish"]["allow"] + allowed["subscribe"]["allow"]
    assert all(
        subject.startswith("telepresence.v1.giraff.") or subject == "$MQTT.sub.>"
        for subject in everything
    )


def test_every_user_connects_by_mqtt_alone():
    """NATS's own protocol would show the messages of all users."""
    users = rows([GIRAFF, BrokerUser("web", "$7$…", of_server(), "$2b$04$web")])
    assert {tuple(row["allowed_connection_types"]) for row in users.values()} == {
        ("MQTT", "MQTT_WS")
    }


def test_a_user_whose_token_has_no_bcrypt_hash_is_left_out():
    assert set(rows([GIRAFF, BrokerUser("rhodon", "$7$…", of_robot("rhodon"))])) == {"giraff"}


def test_each_engine_has_files_and_no_two_engines_write_the_same_one():
    names = [name for engine in ENGINES.values() for name in engine.files({"giraff": GIRAFF})]
    assert len(names) == len(set(names)) == 3
