"""Every test that takes `rig` runs against both brokers; a missing Mosquitto is a failure. In the
soak run those of test_behaviour.py also run against other brokers, of one node and of three.
"""

import pytest

from tests.support.clustered_brokers import engines
from tests.support.clustered_brokers.known_failures import KNOWN_FAILURES, SOME
from tests.support.sessions.broker_rig import KINDS, BrokerRig, ClusterRig

BEHAVIOUR = "test_behaviour"


def pytest_generate_tests(metafunc):
    if "rig" not in metafunc.fixturenames:
        return
    others = engines.KINDS if metafunc.module.__name__.endswith(BEHAVIOUR) else ()
    name = metafunc.function.__name__
    marked = [pytest.param(kind, marks=_marks(kind, name)) for kind in others]
    metafunc.parametrize("rig", [*KINDS, *marked], indirect=True)


def _marks(kind, name):
    reason = KNOWN_FAILURES.get(kind, {}).get(name)
    if reason is None:
        return [pytest.mark.soak]
    return [pytest.mark.soak, pytest.mark.xfail(reason=reason, strict=name not in SOME)]


@pytest.fixture
async def rig(request, tmp_path):
    kind = request.param
    make = ClusterRig if kind in engines.KINDS else BrokerRig
    rig = make(kind, tmp_path / "broker")
    await rig.start()
    yield rig
    await rig.stop()
