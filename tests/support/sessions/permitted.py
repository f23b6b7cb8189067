"""What a broker lets a user do, by the user's permissions (OASIS MQTT 3.1.1, section 4.7)."""

from paho.mqtt.client import topic_matches_sub


def may_publish(permissions, topic):
    """Tell whether a message to this topic is accepted."""
    return not set(topic) & {"+", "#"} and any(
        topic_matches_sub(allowed, topic) for allowed in permissions.write
    )


def may_subscribe(permissions, filter_):
    """Tell whether all that this filter could ever match may be read."""
    return any(_covers(allowed.split("/"), filter_.split("/")) for allowed in permissions.read)


def _covers(allowed, wanted):
    """Tell whether every topic under `wanted` is under `allowed` too, both split into levels."""
    if allowed == ["#"]:
        return True
    if not allowed or not wanted or wanted[0] == "#":
        return not allowed and not wanted
    return allowed[0] in {"+", wanted[0]} and _covers(allowed[1:], wanted[1:])
