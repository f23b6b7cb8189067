"""A broker of two nodes, one of which fails: one connection at a time, to a node that answers."""

import asyncio
import random

import pytest

from robots.bridge.bridge import Bridge
from tests.support.browsers.pages import until
from tests.support.patience import patient
from tests.support.programs.mosquitto import Mosquitto

pytestmark = pytest.mark.broker


@pytest.fixture
def nodes(tmp_path):
    folders = [tmp_path / name for name in ("a", "b")]
    for folder in folders:
        folder.mkdir()
    with Mosquitto(folders[0]) as first, Mosquitto(folders[1]) as second:
        yield first, second


@pytest.fixture
async def bridge(nodes):
    urls = ",".join(node.url for node in nodes)
    bridge = Bridge(urls, ("web", "any"), random.Random(1))
    assert await bridge.wait_connected(patient(10))
    yield bridge
    await bridge.close()


def port_of(bridge):
    return bridge._failover.node.port if bridge.connected else None


async def test_web_process_connects_to_the_other_node_when_its_node_is_lost(nodes, bridge):
    first, second = nodes
    assert port_of(bridge) == first.port
    await asyncio.to_thread(first.kill)
    await until(lambda: port_of(bridge) == second.port)
    await asyncio.to_thread(first.start)
    assert port_of(bridge) == second.port, "the node that answers is kept"
    await asyncio.to_thread(second.kill)
    await until(lambda: port_of(bridge) == first.port)


@pytest.mark.nightly
async def test_hung_node_is_left_within_seconds(nodes, bridge):
    first, second = nodes
    first.freeze(on=True)
    await until(lambda: port_of(bridge) == second.port)
