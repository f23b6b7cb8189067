"""Who may say and hear what at the broker: pure, and the same for both brokers."""

from dataclasses import dataclass

from robots.api import topics
from robots.broker.filters import covers, is_topic, matches


@dataclass(frozen=True)
class Permissions:
    """The filters that a user may `write` to and `read` from; nothing else exists for them."""

    write: tuple[str, ...]
    read: tuple[str, ...]

    def may_publish(self, topic: str) -> bool:
        """Tell whether a message to this topic is accepted."""
        return is_topic(topic) and any(matches(allowed, topic) for allowed in self.write)

    def may_subscribe(self, filter_: str) -> bool:
        """Tell whether all that this filter could ever match may be read."""
        return any(covers(allowed, filter_) for allowed in self.read)


@dataclass(frozen=True)
class BrokerUser:
    """Somebody who may connect; `credential_hash` in Mosquitto's `$7$` form."""

    name: str
    credential_hash: str
    permissions: Permissions


def of_robot(robot: str) -> Permissions:
    """Return what a robot's own user may do: write its outputs, read its inputs."""
    allowed = topics.robot_permissions(robot)
    return Permissions(write=allowed["write"], read=allowed["read"])


def of_server() -> Permissions:
    """Return what a server process may do: write every robot's inputs and the servers' own tree, read everything."""
    inputs = tuple(topics.of("+", topic.suffix) for topic in topics.TABLE if topic.direction == "to_robot")
    return Permissions(write=(*inputs, f"{topics.SERVER}/#"), read=(f"{topics.ROOT}/#",))
