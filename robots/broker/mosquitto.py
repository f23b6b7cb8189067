"""Configuration, passwords and permissions of Mosquitto (2.0).

Three differences from NATS: it disconnects a client that publishes at QoS 1 what it may not; it
drops what exceeds a slow reader's queue instead of disconnecting the reader; and an open connection
outlives its password, so that new credentials have a new user name.
"""

import os
import sys
from pathlib import Path

from robots.broker.listeners import Listeners
from robots.broker.permissions import (
    IN_FLIGHT,
    MAX_PACKET,
    QUEUED_BYTES,
    QUEUED_MESSAGES,
    SESSION_SECONDS,
    BrokerUser,
    of_robot,
)


def configuration(listeners: Listeners, directory: Path) -> str:
    """Return mosquitto.conf; users, permissions and store are in `directory`."""
    lines = [
        f"listener {listeners.port} {listeners.host}",
        "allow_anonymous false",
        f"password_file {directory / 'passwords'}",
        f"acl_file {directory / 'permissions'}",
        "persistence true",
        f"persistence_location {directory}/",
        "autosave_interval 60",
        f"persistent_client_expiration {int(SESSION_SECONDS // 3600)}h",
        # Its bytes are those of payloads, so that empty messages need the count.
        f"max_queued_messages {QUEUED_MESSAGES}",
        f"max_queued_bytes {QUEUED_BYTES}",
        f"max_inflight_messages {IN_FLIGHT}",
        f"max_packet_size {MAX_PACKET}",
        "set_tcp_nodelay true",
        "log_dest stderr",
        *(f"log_type {kind}" for kind in ("error", "warning", "notice")),
        "connection_messages true",
    ]
    if listeners.tls is not None:
        lines += [f"certfile {listeners.tls.certificate}", f"keyfile {listeners.tls.key}"]
    # Otherwise it becomes the user `mosquitto` when root starts it, who cannot read the directory.
    if sys.platform != "win32" and os.geteuid() == 0:
        lines.append("user root")
    if listeners.websockets is not None:  # the certificate is that of the listener above it
        host, port = listeners.websockets
        lines += [f"listener {port} {host}", "protocol websockets"]
    return "\n".join(lines) + "\n"


def password_file(users: dict[str, BrokerUser]) -> str:
    """Return Mosquitto's password file."""
    return "".join(f"{user.name}:{user.credential_hash}\n" for user in users.values())


def permission_file(users: dict[str, BrokerUser]) -> str:
    """Return Mosquitto's ACL file; a user that neither its patterns nor its names cover may do
    nothing.

    Mosquitto searches its list of users once a line, so that ten thousand users with forty lines
    each keep it from its clients for minutes. A robot whose user has the robot's own name is
    covered by patterns (`%u` is the user), and only other users are named: the server's, and those
    of credentials that were rotated.
    """
    own = of_robot("%u")
    lines = [f"pattern write {topic}" for topic in own.write]
    lines += [f"pattern read {topic}" for topic in own.read]
    for user in users.values():
        if user.permissions == of_robot(user.name):
            continue
        lines.append(f"user {user.name}")
        lines += [f"topic write {topic}" for topic in user.permissions.write]
        lines += [f"topic read {topic}" for topic in user.permissions.read]
    return "\n".join(lines) + "\n"
