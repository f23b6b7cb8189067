"""The publishers and subscribers of a ROS system's topics, with their types, and which are missing.
Pure.

Types are written as in ROS 1. In either ROS, publishers and subscribers of different types do not
connect, and neither gets an error.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

TWIST, TWIST_STAMPED = "geometry_msgs/Twist", "geometry_msgs/TwistStamped"
VELOCITIES = (TWIST, TWIST_STAMPED)
MOST_NAMED = 3
MOST_NODES = 6


@dataclass(frozen=True)
class TopicPeers:
    """The other nodes of a topic: their types, and how many; None when unknown."""

    kinds: frozenset[str] = frozenset()
    subscribers: int | None = None
    publishers: int | None = None


Graph = Mapping[str, TopicPeers]


@dataclass(frozen=True)
class TopicNeed:
    """A topic that we subscribe to: its type, and the option that names it."""

    topic: str
    kind: str
    option: str


def chosen_stamped(graph: Graph | None, topic: str, *, stamped: bool) -> bool:
    """Return whether to send TwistStamped: as the topic's only type, else `stamped`."""
    known = graph.get(topic) if graph is not None else None
    kinds = set(VELOCITIES) & known.kinds if known is not None else set()
    return kinds == {TWIST_STAMPED} if len(kinds) == 1 else stamped


def no_subscriber(graph: Graph | None, topic: str, *, stamped: bool) -> str:
    """Return the sentence about velocities without a subscriber: the types and topics in use, and
    the option to set.
    """
    ours, graph = TWIST_STAMPED if stamped else TWIST, graph or {}
    there = sorted(graph.get(topic, TopicPeers()).kinds - {ours})
    if there:
        remedy = (
            f"set stamped={'false' if stamped else 'true'}"
            if set(there) & set(VELOCITIES)
            else "set cmd_vel to another topic"
        )
        return f"nobody listens on {topic} for {ours}: there it is {' and '.join(there)}; {remedy}"
    others = [
        f"{name} ({' and '.join(sorted(each.kinds & set(VELOCITIES)))})"
        for name, each in sorted(graph.items())
        if each.kinds & set(VELOCITIES) and each.subscribers != 0 and name != topic
    ]
    here = f"; here are {', '.join(others[:MOST_NAMED])}" if others else ""
    return f"nobody listens on {topic} ({ours}): set cmd_vel to the topic of the robot's base{here}"


def unpublished(graph: Graph | None, needs: Iterable[TopicNeed]) -> tuple[str, ...]:
    """Return a sentence about each of our subscriptions without a publisher, or with one of another
    type.
    """
    if graph is None:
        return ()
    found = []
    for need in needs:
        known = graph.get(need.topic, TopicPeers(publishers=0))
        if known.kinds and need.kind not in known.kinds:
            found.append(
                f"{need.topic} is {' and '.join(sorted(known.kinds))}, not {need.kind}: set"
                f" {need.option} to another topic"
            )
        elif known.publishers == 0:
            others = [
                name
                for name, each in sorted(graph.items())
                if need.kind in each.kinds and each.publishers != 0 and name != need.topic
            ]
            here = f"; here are {', '.join(others[:MOST_NAMED])}" if others else ""
            found.append(
                f"nobody publishes {need.topic} ({need.kind}): set {need.option} to the robot's"
                f" topic, or to nothing{here}"
            )
    return tuple(found)


def master_restarted(nodes: Collection[str]) -> str:
    """Return the sentence about running nodes of ROS 1 that a restarted master does not know."""
    more = f" and {len(nodes) - MOST_NODES} more" if len(nodes) > MOST_NODES else ""
    return (
        "the ROS master was restarted. Nodes that started before it are no longer known to it;"
        f" restart them: {', '.join(sorted(nodes)[:MOST_NODES])}{more}"
    )
