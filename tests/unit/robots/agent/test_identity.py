"""Client ids and credentials of an agent at the broker."""

import random

from robots.agent.agent import Agent
from robots.agent.broker_link.mqtt import Endpoint, MqttLink
from robots.agent.config import load
from tests.support import words

BOOT = "not hexadecimal"  # so that no random id can hold it by chance


def link(**identity: str) -> MqttLink:
    endpoint = Endpoint.of("mqtt://127.0.0.1:1", **identity)
    return MqttLink(endpoint, words.factsheet(boot=BOOT), rng=random.Random(1))


async def test_a_client_id_is_random_and_does_not_contain_the_boot():
    """With Mosquitto a client that knows the id takes the connection over, and every page knows the
    boot.
    """
    ids = {client.identifier for client in (link()._client(), link()._client())}
    assert len(ids) == 2
    assert not [name for name in ids if BOOT in name]


async def test_a_link_keeps_its_client_id_over_its_connections():
    one = link()
    assert one._client().identifier == one._client().identifier


async def test_new_credentials_are_used_from_the_next_connection():
    one = link(username="giraff", password="old")
    one.credentials_changed("giraff.1", "new")
    fresh = one._client()._client
    assert (fresh._username, fresh._password) == (b"giraff.1", b"new")


async def test_new_credentials_are_used_at_once_and_after_a_restart(
    tmp_path,
):
    given = {"robot": "giraff", "server": "https://site.example", "adapter": "simulator"}
    agent = Agent(load({**given, "var": tmp_path}, {"TELEPRESENCE_TOKEN": "old"}))
    assert agent._endpoints(("mqtt://127.0.0.1:1",))[0].username == "giraff"
    agent._link = link(username="giraff", password="old")
    agent._renewed({"robot": "giraff", "user": "giraff.1", "token": "new"})
    after = agent._endpoints(("mqtt://127.0.0.1:1",))[0]
    assert (after.username, after.password) == ("giraff.1", "new")
    assert agent._link._client()._client._username == b"giraff.1"
