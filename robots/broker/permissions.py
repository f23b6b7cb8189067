"""Users of the broker, what they may publish and subscribe to, and limits: the same for NATS and
Mosquitto.
"""

from dataclasses import dataclass
from functools import lru_cache

from robots.api import topics

MIB = 1024 * 1024
# The largest payload of the Robot API, and room for its topic and header.
MAX_PACKET = max(topic.limit for topic in topics.TABLE) + topics.KIB
SESSION_SECONDS = 24 * 3600.0  # how long a persistent session waits for its client

# For every user of a broker, because the brokers have no limits for some of them.
QUEUED_MESSAGES = 100_000  # of one session: what waits for it or was not acknowledged by it
QUEUED_BYTES = 64 * MIB
IN_FLIGHT = 200  # messages at QoS 1 sent to one client and not yet acknowledged


@dataclass(frozen=True)
class Permissions:
    """The topic filters that a user may `write` to and `read` from, and nothing else."""

    write: tuple[str, ...]
    read: tuple[str, ...]


@dataclass(frozen=True)
class BrokerUser:
    """A user of the broker: `credential_hash` has Mosquitto's `$7$` form, `bcrypt_hash` is for NATS
    ("": the token is older than the first bcrypt hash).
    """

    name: str
    credential_hash: str
    permissions: Permissions
    bcrypt_hash: str = ""


@lru_cache(maxsize=4096)
def of_robot(robot: str) -> Permissions:
    """Return what a robot's user may do: write its outputs, read its inputs and its presence."""
    outputs = (topic.suffix for topic in topics.TABLE if topic.direction == "from_robot")
    return Permissions(
        write=tuple(topics.of(robot, suffix) for suffix in outputs),
        read=topics.subscriptions(robot),
    )


def of_server() -> Permissions:
    """Return what a server process may do: write every robot's inputs and the servers' own tree,
    read everything.
    """
    inputs = tuple(
        topics.of("+", topic.suffix) for topic in topics.TABLE if topic.direction == "to_robot"
    )
    return Permissions(write=(*inputs, f"{topics.SERVER}/#"), read=(f"{topics.ROOT}/#",))
