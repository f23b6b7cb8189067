"""MQTT topics and filters (OASIS MQTT 3.1.1, section 4.7): what is well formed, what matches, what
covers what.
"""

MAX_LENGTH = 512  # characters; ours are far shorter
MAX_LEVELS = 32


def is_topic(topic: str) -> bool:
    """Tell whether a message can be published there."""
    return (
        0 < len(topic) <= MAX_LENGTH
        and topic.count("/") < MAX_LEVELS
        and not set(topic) & {"+", "#", "\0"}
    )


def is_filter(text: str) -> bool:
    """Tell whether one can subscribe to it: `+` fills a level, `#` only the last one."""
    if not 0 < len(text) <= MAX_LENGTH or text.count("/") >= MAX_LEVELS or "\0" in text:
        return False
    *front, last = text.split("/")
    return all("#" not in level and ("+" not in level or level == "+") for level in front) and (
        last == "#" or ("#" not in last and ("+" not in last or last == "+"))
    )


def matches(filter_: str, topic: str) -> bool:
    """Tell whether a topic falls under a filter; `a/#` also means `a`, and wildcards in front do
    not reach `$…`.
    """
    return not (topic.startswith("$") and filter_[:1] in {"+", "#"}) and covers(filter_, topic)


def covers(permission: str, filter_: str) -> bool:
    """Tell whether every topic under `filter_` falls under `permission` too."""
    # Every topic has a level: "#" is "+/#".
    allowed, wanted = permission.split("/"), ("+/#" if filter_ == "#" else filter_).split("/")
    for index, level in enumerate(allowed):
        if level == "#":
            return True
        if (
            index >= len(wanted)
            or wanted[index] == "#"
            or (level != "+" and level != wanted[index])
        ):
            return False
        # What remains of `wanted` may be one level shorter only when `allowed` ends in `#`.
        if index == len(wanted) - 1:
            return allowed[index + 1 :] in ([], ["#"])
    return len(allowed) == len(wanted)
