"""Every test that takes `rig` runs with NATS and with Mosquitto; a missing program is a failure. In
the soak run those of test_behaviour.py also run with brokers of three nodes.
"""

import pytest

from tests.support.clustered_brokers import engines
from tests.support.clustered_brokers.known_failures import KNOWN_FAILURES
from tests.support.sessions.broker_rig import KINDS, BrokerRig, ClusterRig

BEHAVIOUR = "test_behaviour"


def pytest_generate_tests(metafunc):
    if "rig" not in metafunc.fixturenames:
        return
    others = engines.KINDS if metafunc.module.__name__.endswith(BEHAVIOUR) else ()
    name = metafunc.function.__name__
    marked = [pytest.param(kind, marks=_marks(kind, name)) for kind in (*KINDS, *others)]
    metafunc.parametrize("rig", marked, indirect=True)


def _marks(kind, name):
    marks = [pytest.mark.soak] if kind in engines.KINDS else []
    reason = KNOWN_FAILURES.get(kind, {}).get(name)
    return marks if reason is None else [*marks, pytest.mark.xfail(reason=reason, strict=True)]


@pytest.fixture
async def rig(request, tmp_path):
    kind = request.param
    make = ClusterRig if kind in engines.KINDS else BrokerRig
    rig = make(kind, tmp_path / "broker")
    await rig.start()
    yield rig
    await rig.stop()
