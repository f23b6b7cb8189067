"""Mosquitto as our child: the same users, hashes, permissions and limits, written into its own
files.

The files lie in a directory of ours. When the database says something new they are written again
and Mosquitto is told by SIGHUP, upon which it disconnects whoever is no longer welcome. It dies
with us, also when we are killed (Linux: PR_SET_PDEATHSIG).

Three differences from the embedded broker are Mosquitto's own (2.0): it hangs up on a client that
publishes with QoS 1 what it may not; whoever knows a client id takes its session over, also another
user, so client ids are random, or made from a secret; and it retains on every topic that a robot
may write to, not only where the topic table says so.
"""

import asyncio
import os
import shutil
import signal
import socket
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import structlog

from robots.api.private_files import write_private
from robots.broker.hub import WINDOW
from robots.broker.permissions import (
    MAX_PACKET,
    SERVER_ALLOWANCE,
    SESSION_SECONDS,
    BrokerUser,
    of_robot,
)
from robots.broker.users import POLL_SECONDS, ReadUsers, UsersUnavailableError
from robots.processes import tied_to_parent

logger = structlog.stdlib.get_logger(__name__)

START_SECONDS = 10.0
STOP_SECONDS = 5.0
# Debian and macOS keep it off the PATH of ordinary users
SBIN = ("/usr/sbin", "/usr/local/sbin", "/opt/homebrew/sbin")
EVERYWHERE = {
    "0.0.0.0": "127.0.0.1",  # noqa: S104 -- where to find who listens anywhere
    "::": "::1",
}


class MosquittoError(Exception):
    """Mosquitto did not start, or ended by itself; the message is for the operator."""


@dataclass(frozen=True)
class Tls:
    """Paths of the server's certificate chain and its key, PEM."""

    certificate: Path
    key: Path


def find() -> str | None:
    """Return the path of the mosquitto program, or None when it is not installed."""
    return shutil.which("mosquitto", path=os.pathsep.join([os.environ.get("PATH", ""), *SBIN]))


def configuration(
    host: str,
    port: int,
    directory: Path,
    tls: Tls | None = None,
    user: str | None = None,
    websockets: tuple[str, int] | None = None,
) -> str:
    """Return mosquitto.conf; `user` is whom to run as when started by root, `websockets` a second
    address, without TLS, for the proxy.
    """
    lines = [
        f"listener {port} {host}",
        "allow_anonymous false",
        f"password_file {directory / 'passwords'}",
        f"acl_file {directory / 'permissions'}",
        "persistence true",
        f"persistence_location {directory}/",
        "autosave_interval 60",
        f"persistent_client_expiration {int(SESSION_SECONDS // 3600)}h",
        # For every user: Mosquitto has no bound for some. Its bytes are those of payloads, so that
        # empty messages need the count.
        f"max_queued_messages {SERVER_ALLOWANCE.queue_messages}",
        f"max_queued_bytes {SERVER_ALLOWANCE.queue_bytes}",
        f"max_inflight_messages {WINDOW}",
        f"max_packet_size {MAX_PACKET}",
        "set_tcp_nodelay true",
        "log_dest stderr",
        *(f"log_type {kind}" for kind in ("error", "warning", "notice")),
        "connection_messages true",
    ]
    if tls is not None:
        lines += [f"certfile {tls.certificate}", f"keyfile {tls.key}"]
    if user is not None:
        lines.append(f"user {user}")
    if websockets is not None:  # after the certificate, which is that of the listener above it
        lines += [f"listener {websockets[1]} {websockets[0]}", "protocol websockets"]
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


def usable_port(host: str, port: int) -> int:
    """Return the port, or a free one for 0, which Mosquitto itself cannot choose.

    Raises:
        OSError: the address cannot be had; Mosquitto would only say so in its log.
    """
    family, kind, _, _, address = socket.getaddrinfo(
        host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    with socket.socket(family, kind) as probe:
        # connections that ended a moment ago do not count
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(address)
        probe.listen()
        return int(probe.getsockname()[1])


class MosquittoBroker:
    """A Mosquitto on one port, with its files in `directory`; and for MQTT over WebSocket on the
    address `websockets`.
    """

    name = "mosquitto"

    def __init__(
        self,
        read_users: ReadUsers,
        directory: Path,
        *,
        poll: float = POLL_SECONDS,
        websockets: tuple[str, int] | None = None,
    ) -> None:
        self._read_users, self._directory, self._poll = read_users, directory, poll
        self._websockets = websockets
        self._users: dict[str, BrokerUser] = {}
        self._child: subprocess.Popen[bytes] | None = None

    async def start(self, host: str, port: int, tls: Tls | None = None) -> int:
        """Start Mosquitto, wait until it answers, and return the port (a free one when asked for
        0).

        Raises:
            MosquittoError: it is not installed, or did not start.
            OSError: the address cannot be had.
            UsersUnavailableError: the database cannot be read.
        """
        program = find()
        if program is None:
            raise MosquittoError("mosquitto is not installed (Debian: apt install mosquitto)")
        port = usable_port(host, port)
        self._directory.mkdir(parents=True, exist_ok=True)
        self._directory.chmod(0o700)
        self._write_users(await self._read_users())
        # By itself it would become the user `mosquitto` when started by root, who cannot read our
        # directory.
        user = "root" if sys.platform != "win32" and os.geteuid() == 0 else None
        write_private(
            self._directory / "mosquitto.conf",
            configuration(host, port, self._directory, tls, user, self._websockets),
        )
        # A session of its own: Ctrl-C reaches us, and we end it in order.
        self._child = subprocess.Popen(  # noqa: ASYNC220 -- it dies with this thread
            [program, "-c", str(self._directory / "mosquitto.conf")],
            start_new_session=True,
            preexec_fn=tied_to_parent(),
        )
        for bound in [(host, port), *([self._websockets] if self._websockets else [])]:
            await self._answering(*bound)
        return port

    async def wait(self) -> None:
        """Keep Mosquitto's files as the database has it.

        Raises:
            MosquittoError: it ended by itself.
        """
        while True:
            await asyncio.sleep(self._poll)
            self._must_live()
            try:
                users = await self._read_users()
            except UsersUnavailableError as error:
                logger.warning("broker_users_unavailable", reason=str(error))
                continue
            if users != self._users:
                self._write_users(users)
                self._reload()

    async def stop(self) -> None:
        """End Mosquitto, which saves its sessions first."""
        child, self._child = self._child, None
        if child is None or child.poll() is not None:
            return
        child.terminate()
        try:
            await asyncio.to_thread(child.wait, STOP_SECONDS)
        except subprocess.TimeoutExpired:
            child.kill()
            await asyncio.to_thread(child.wait)

    def _write_users(self, users: dict[str, BrokerUser]) -> None:
        write_private(self._directory / "passwords", password_file(users))
        write_private(self._directory / "permissions", permission_file(users))
        self._users = users

    def _reload(self) -> None:
        if self._child is not None and sys.platform != "win32":
            logger.info("broker_users_changed", users=len(self._users))
            self._child.send_signal(signal.SIGHUP)

    def _must_live(self) -> None:
        code = self._child.poll() if self._child is not None else None
        if code is not None:
            raise MosquittoError(f"mosquitto ended with code {code}; see its output above")

    async def _answering(self, host: str, port: int) -> None:
        deadline = asyncio.get_running_loop().time() + START_SECONDS
        address = EVERYWHERE.get(host, host)
        while True:
            self._must_live()
            try:
                _, writer = await asyncio.open_connection(address, port)
            except OSError as error:
                if asyncio.get_running_loop().time() > deadline:
                    await self.stop()
                    raise MosquittoError(f"mosquitto does not answer on port {port}") from error
                await asyncio.sleep(0.02)
                continue
            writer.close()
            # Another program may own the port: Mosquitto then ends at once.
            await asyncio.sleep(0.05)
            self._must_live()
            return
