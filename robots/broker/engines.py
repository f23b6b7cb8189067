"""The brokers of other people for which users and permissions are written, one entry each."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robots.broker import mosquitto, nats
from robots.broker.permissions import BrokerUser

Users = dict[str, BrokerUser]


@dataclass(frozen=True)
class Engine:
    """What one broker reads: `files` returns texts by name, in the order in which they are to be
    written; it reads them again upon SIGHUP to the process in `pid_file`.
    """

    files: Callable[[Users], dict[str, str]]
    pid_file: Path


def _of_mosquitto(users: Users) -> dict[str, str]:
    return {
        "passwords": mosquitto.password_file(users),
        "permissions": mosquitto.permission_file(users),
    }


def _of_nats(users: Users) -> dict[str, str]:
    return {"users.conf": nats.user_file(users)}


ENGINES = {
    "mosquitto": Engine(_of_mosquitto, Path("/run/mosquitto/mosquitto.pid")),
    "nats": Engine(_of_nats, Path("/run/nats/nats.pid")),
}
