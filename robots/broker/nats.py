"""Users and permissions for NATS, whose MQTT listener works on several machines as one broker.

NATS has subjects where MQTT has topics: a level is a token, `+` is `*` and `#` is `>`, which does
not match the level above it. A user of ours connects by MQTT alone: in NATS's own protocol the
permission to read `$MQTT.sub.>`, without which nothing arrives at QoS 1, would show the messages of
everybody (an MQTT client is refused these topics by NATS itself).
"""

import json
from collections.abc import Iterable

from robots.broker.permissions import BrokerUser

DELIVERIES = "$MQTT.sub.>"  # where NATS brings an MQTT client what it gets at QoS 1
CONNECTIONS = ("MQTT", "MQTT_WS")


def user_file(users: dict[str, BrokerUser]) -> str:
    """Return the block `authorization` of NATS's configuration; users without a bcrypt hash, whose
    token was made before there was one, are left out.
    """
    rows = [_user(user) for user in users.values() if user.bcrypt_hash]
    return "\n".join(["authorization {", "  users: [", *rows, "  ]", "}", ""])


def subjects(filters: Iterable[str]) -> list[str]:
    """Return the NATS subjects that match what these MQTT filters match."""
    found: list[str] = []
    for filter_ in filters:
        above, _, last = filter_.rpartition("/")
        if last == "#" and above:
            found.append(_subject(above))
        found.append(_subject(filter_))
    return found


def _subject(filter_: str) -> str:
    signs = {"+": "*", "#": ">"}
    return ".".join(signs.get(level, level) for level in filter_.split("/"))


def _user(user: BrokerUser) -> str:
    allowed = {
        "publish": {"allow": subjects(user.permissions.write)},
        "subscribe": {"allow": [*subjects(user.permissions.read), DELIVERIES]},
    }
    row = {
        "user": user.name,
        "password": user.bcrypt_hash,
        "allowed_connection_types": CONNECTIONS,
        "permissions": allowed,
    }
    return f"    {json.dumps(row)}"
