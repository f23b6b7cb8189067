"""The brokers that the behaviour tests know besides ours, by name.

A failure that is listed in `known_failures.py` and does not happen is a failure of the test: the
table in docs/explanation/brokers.md says what is so.
"""

from tests.support.clustered_brokers.bridges import BridgedMosquittos
from tests.support.clustered_brokers.nats import NatsCluster

MAKERS = {
    "nats-cluster": lambda read, folder, poll: NatsCluster(read, folder, poll=poll),
    "mosquitto-bridges": lambda read, folder, poll: BridgedMosquittos(read, folder, poll=poll),
}
KINDS = tuple(MAKERS)


def make(kind, read_users, directory, poll):
    """Return a broker with `start`, `wait`, `stop` and `ports`, like those of the project."""
    return MAKERS[kind](read_users, directory, poll)
