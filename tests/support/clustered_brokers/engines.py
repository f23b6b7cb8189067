"""The brokers that the behaviour tests know besides ours, by name.

A test fails if a failure that is listed in `known_failures.py` does not happen: they are the table
in docs/explanation/brokers.md.
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
