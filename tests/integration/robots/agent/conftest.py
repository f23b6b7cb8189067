"""A real broker, and a client that receives what a robot publishes there."""

import pytest

from tests.support.architectures.mqtt_ear import Ear
from tests.support.programs.mosquitto import Mosquitto


@pytest.fixture
def broker(tmp_path):
    with Mosquitto(tmp_path) as broker:
        yield broker


@pytest.fixture
def ear(broker):
    with Ear(broker.port) as ear:
        yield ear
