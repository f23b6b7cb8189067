"""Every test that takes `rig` runs against both brokers; a missing Mosquitto is a failure."""

import pytest

from tests.support.broker_rig import KINDS, BrokerRig


@pytest.fixture(params=KINDS)
async def rig(request, tmp_path):
    rig = BrokerRig(request.param, tmp_path / "broker")
    await rig.start()
    yield rig
    await rig.stop()
