"""`manage.py mosquitto_files`: users and permissions of a mosquitto that is not our child, or of
another broker (`--engine`), written from the database.
"""

import asyncio
import os
import signal
import sys
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

import structlog
from django.core.management.base import BaseCommand, CommandError

from robots.api.private_files import write_private
from robots.broker.engines import ENGINES, Engine
from robots.broker.permissions import BrokerUser
from robots.broker.users import POLL_SECONDS, UsersUnavailableError, read_users, users_now
from robots.process.ending import interrupted_by_signals

logger = structlog.stdlib.get_logger(__name__)
GROUP_MAY_READ = 0o640


class Command(BaseCommand):
    help = (
        "Write the users and permissions for this machine's own mosquitto, or another broker, "
        "from the database; with --reload, have it read them."
    )
    requires_system_checks: list[str] = []

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument(
            "directory",
            type=Path,
            help=(
                "folder where the broker's configuration looks for them; its group may read them"
            ),
        )
        parser.add_argument(
            "--engine",
            choices=tuple(ENGINES),
            default="mosquitto",
            help="the broker that reads the files (mosquitto)",
        )
        parser.add_argument(
            "--watch",
            action="store_true",
            help="keep running, and write them again whenever robots change",
        )
        parser.add_argument(
            "--reload", action="store_true", help="send it SIGHUP when something has changed"
        )
        parser.add_argument(
            "--pid-file",
            type=Path,
            help=f"file with the process id to signal ({ENGINES['mosquitto'].pid_file})",
        )
        parser.add_argument(
            "--poll",
            type=float,
            default=POLL_SECONDS,
            help="seconds between two checks of the database (2)",
        )

    def handle(self, *_args: Any, **options: Any) -> None:
        engine = ENGINES[options["engine"]]
        pid_file = options["pid_file"] or engine.pid_file
        files = Files(options["directory"], pid_file if options["reload"] else None, engine)
        try:
            if options["watch"]:
                with interrupted_by_signals():
                    asyncio.run(files.follow(options["poll"]))
                return
            users = users_now()
            changed = files.update(users)
        except KeyboardInterrupt:
            return
        except (FilesError, UsersUnavailableError) as error:
            raise CommandError(str(error)) from error
        self.stdout.write(
            f"{len(users)} users {'written to' if changed else 'unchanged in'}"
            f" {options['directory']}"
        )


class FilesError(Exception):
    """The files cannot be written or the broker not signalled; the message is one sentence."""


class Files:
    """The files of one directory, and the file with the process id of the broker that is signalled
    after a change (None: it is not).
    """

    def __init__(
        self, directory: Path, pid_file: Path | None, engine: Engine = ENGINES["mosquitto"]
    ) -> None:
        self._directory, self._pid_file, self._engine = directory, pid_file, engine
        self._users: dict[str, BrokerUser] | None = None

    def update(self, users: dict[str, BrokerUser]) -> bool:
        """Write the files and signal the broker; False when they are up to date.

        Raises:
            FilesError: it could not be done.
        """
        texts = self._engine.files(users)
        if all(_same(self._directory / name, text) for name, text in texts.items()):
            return False
        try:
            for name, text in texts.items():
                write_private(self._directory / name, text, mode=GROUP_MAY_READ)
        except OSError as error:
            raise FilesError(f"{self._directory}: {error.strerror}.") from error
        logger.info("mosquitto_files_written", users=len(users))
        self._tell()
        return True

    async def follow(self, poll: float) -> None:
        """Keep the files as the database has it, until this process is ended; a database that is
        away changes nothing.
        """
        while True:
            try:
                users = await read_users()
            except UsersUnavailableError as error:
                logger.warning("broker_users_unavailable", reason=str(error))
            else:
                if users != self._users:
                    self.update(users)
                    self._users = users
            await asyncio.sleep(poll)

    def _tell(self) -> None:
        if self._pid_file is None:
            return
        if sys.platform == "win32":
            raise FilesError("A broker on Windows reads its files only when it starts: restart it.")
        try:
            os.kill(int(self._pid_file.read_text()), signal.SIGHUP)
        except (FileNotFoundError, ProcessLookupError):
            # it will read them when it starts
            logger.info("broker_not_running", pid_file=self._pid_file)
        except (ValueError, OSError) as error:
            raise FilesError(
                f"The broker could not be signalled ({self._pid_file}): {error}."
            ) from error


def _same(path: Path, text: str) -> bool:
    """Tell whether a file says this already."""
    try:
        return path.read_text() == text
    except OSError:
        return False
