"""Which node of the broker comes next, and after how long."""

import random

import pytest

from robots.bridge.broker_address import BadAddress, BrokerAddress
from robots.bridge.failover import Failover, parse_nodes

A, B, C = (BrokerAddress(host, 1883) for host in "abc")


def failover(*nodes):
    return Failover(nodes, random.Random(1))


def test_several_addresses_are_separated_by_commas():
    assert parse_nodes("mqtt://a, mqtt://b:1883,mqtt://c") == (A, B, C)


@pytest.mark.parametrize("urls", ["", "mqtt://a,", "mqtt://a,b"])
def test_one_bad_address_among_several_is_named(urls):
    with pytest.raises(BadAddress, match="broker's address"):
        parse_nodes(urls)


def test_nodes_are_tried_in_turn_and_a_lost_one_last():
    broker = failover(A, B, C)
    tried = [broker.node]
    for was_up in (False, False, False, True, False, False):
        broker.ended(was_up=was_up)
        tried.append(broker.node)
    assert tried == [A, B, C, A, B, C, A]


def test_every_node_is_tried_once_before_the_waits_become_longer():
    broker = failover(A, B, C)
    waits = [broker.ended(was_up=True), *(broker.ended(was_up=False) for _ in range(8))]
    assert all(0.1 <= wait < 0.2 for wait in waits[:3])
    assert all(0.2 <= wait < 0.4 for wait in waits[3:6])
    assert all(0.4 <= wait < 0.8 for wait in waits[6:])
    assert 0.1 <= broker.ended(was_up=True) < 0.2


def test_clients_reconnect_at_different_times():
    waits = {Failover((A, B), random.Random(seed)).ended(was_up=True) for seed in range(20)}
    assert len(waits) == 20


def test_a_silent_node_is_detected_sooner_if_there_is_another():
    assert failover(A, B).keepalive_seconds < failover(A).keepalive_seconds
