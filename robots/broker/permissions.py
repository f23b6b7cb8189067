"""Who may say and hear what at the broker, and how much: pure, and the same for both brokers but
for the bounds that Mosquitto lacks.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

from robots.api import topics
from robots.broker.filters import covers, is_topic, matches

MIB = 1024 * 1024
# The largest payload of the Robot API, and room for its topic and header.
MAX_PACKET = max(topic.limit for topic in topics.TABLE) + topics.KIB
SESSION_SECONDS = 24 * 3600.0  # how long a persistent session waits for its client


@dataclass(frozen=True)
class BrokerAllowance:
    """How much the broker does for one user. A packet costs one for each 4 KiB that it has begun,
    SUBSCRIBE one for each filter as well.
    """

    # of all connections together, and as many at once after a second of silence
    packets_per_s: float
    connections: int
    queue_messages: int  # of one session: what waits for it or was not acknowledged by it
    queue_bytes: int


# An agent at its busiest (4 states, 30 poses, 10 scans, 5 heartbeats, 10 pictures of 48 kB a
# second) takes less than a third, by one connection.
ROBOT_ALLOWANCE = BrokerAllowance(
    packets_per_s=1000.0, connections=8, queue_messages=1000, queue_bytes=4 * MIB
)
# The server's own processes have the site's secret key: they are bounded only where a slow one
# would take the broker's memory.
SERVER_ALLOWANCE = BrokerAllowance(
    packets_per_s=math.inf, connections=500, queue_messages=100_000, queue_bytes=64 * MIB
)


@dataclass(frozen=True)
class Permissions:
    """The filters that a user may `write` to and `read` from; nothing else exists for them."""

    write: tuple[str, ...]
    read: tuple[str, ...]
    allowance: BrokerAllowance

    def may_publish(self, topic: str) -> bool:
        """Tell whether a message to this topic is accepted."""
        return is_topic(topic) and any(matches(allowed, topic) for allowed in self.write)

    def may_subscribe(self, filter_: str) -> bool:
        """Tell whether all that this filter could ever match may be read."""
        return any(covers(allowed, filter_) for allowed in self.read)


@dataclass(frozen=True)
class BrokerUser:
    """Somebody who may connect; `credential_hash` in Mosquitto's `$7$` form, `bcrypt_hash` for
    NATS, or "" for a token that was made before there was one.
    """

    name: str
    credential_hash: str
    permissions: Permissions
    bcrypt_hash: str = ""


@lru_cache(maxsize=4096)
def of_robot(robot: str) -> Permissions:
    """Return what a robot's own user may do: write its outputs, read its inputs."""
    allowed = topics.robot_permissions(robot)
    return Permissions(write=allowed["write"], read=allowed["read"], allowance=ROBOT_ALLOWANCE)


def of_server() -> Permissions:
    """Return what a server process may do: write every robot's inputs and the servers' own tree,
    read everything.
    """
    inputs = tuple(
        topics.of("+", topic.suffix) for topic in topics.TABLE if topic.direction == "to_robot"
    )
    return Permissions(
        write=(*inputs, f"{topics.SERVER}/#"),
        read=(f"{topics.ROOT}/#",),
        allowance=SERVER_ALLOWANCE,
    )
