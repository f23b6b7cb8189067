"""Configuration, users and permissions of NATS (nats-server), which speaks MQTT, and which works on
several machines as one broker.

NATS has subjects where MQTT has topics: a level is a token, `+` is `*` and `#` is `>`, which does
not match the level above it. A user of ours connects by MQTT alone: in NATS's own protocol the
permission to read `$MQTT.sub.>`, without which nothing arrives at QoS 1, would show the messages of
everybody (an MQTT client is refused these topics by NATS itself).
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from robots.broker.listeners import Listeners
from robots.broker.permissions import (
    MAX_PACKET,
    QUEUED_BYTES,
    SESSION_SECONDS,
    BrokerUser,
)

USERS = "users.conf"
MIB = 1024 * 1024
HEADER_BYTES = 512  # of a packet of the largest size
# Seconds for a client's TLS handshake, and for its CONNECT: NATS's own 2 s are short for a robot on
# a bad network.
ENTRY_SECONDS = 10
MAX_CONNECTIONS = 10_000
LIMITS = {
    "max_payload": MAX_PACKET - HEADER_BYTES,
    "max_pending": QUEUED_BYTES,  # a client that leaves more unread is disconnected
    "max_connections": MAX_CONNECTIONS,
}
MQTT = {
    "ack_wait": "5s",  # then a message at QoS 1 is sent again
    "max_ack_pending": 1000,
    "consumer_memory_storage": True,
    # how long a persistent session waits for its client
    "consumer_inactive_threshold": f"{SESSION_SECONDS:.0f}s",
}
DELIVERIES = "$MQTT.sub.>"  # where NATS brings an MQTT client what it gets at QoS 1
CONNECTIONS = ("MQTT", "MQTT_WS")


def configuration(listeners: Listeners, directory: Path) -> str:
    """Return the configuration of one node, in JSON, which NATS reads; users and store are in
    `directory`.
    """
    mqtt: dict[str, Any] = {"host": listeners.host, "port": listeners.port, **MQTT}
    if listeners.tls is not None:
        mqtt["tls"] = {
            "cert_file": str(listeners.tls.certificate),
            "key_file": str(listeners.tls.key),
            "timeout": ENTRY_SECONDS,
        }
    settings: dict[str, Any] = {
        "server_name": "telepresence",
        "listen": "127.0.0.1:-1",  # NATS's own protocol, which no user may speak: any free port
        "jetstream": {
            "store_dir": str(directory / "store"),
            "max_memory_store": 256 * MIB,
            "max_file_store": 2048 * MIB,
        },
        "mqtt": mqtt,
        **LIMITS,
    }
    if listeners.websockets is not None:
        host, port = listeners.websockets
        settings["websocket"] = {"host": host, "port": port, "no_tls": True}
    lines = (f"{name}: {json.dumps(value)}" for name, value in settings.items())
    return "\n".join([*lines, f"include {USERS}", ""])


def user_file(users: dict[str, BrokerUser]) -> str:
    """Return the block `authorization` of NATS's configuration; users without a bcrypt hash, whose
    token was made before there was one, are left out.
    """
    rows = [_user(user) for user in users.values() if user.bcrypt_hash]
    return "\n".join(
        ["authorization {", f"  timeout: {ENTRY_SECONDS}", "  users: [", *rows, "  ]", "}", ""]
    )


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
