"""A broker as our child process, with users and permissions from the database.

Its files are in a directory of ours. When the database changes they are written again, and the
broker reads them upon SIGHUP and disconnects every client that is no longer permitted. Windows has
no SIGHUP: there the broker is started again, and all clients reconnect. It is also started again
after the disk was full, because NATS then keeps nothing more, even when there is room. The broker
ends with this process, also when this one is killed (Linux: PR_SET_PDEATHSIG).
"""

import asyncio
import contextlib
import logging
import re
import shutil
import signal
import sys
from pathlib import Path

import structlog

from robots.api.private_files import write_private
from robots.broker.engines import Engine
from robots.broker.listeners import Listeners
from robots.broker.permissions import BrokerUser
from robots.broker.users import POLL_SECONDS, ReadUsers, UsersUnavailableError
from robots.process.ending import tied_to_parent

logger = structlog.stdlib.get_logger(__name__)

START_SECONDS = 30.0
STOP_SECONDS = 5.0
LINE_CHARACTERS = 500
LINE_BYTES = 1024 * 1024  # more than any line, which may name a client's id of 64 KiB
DISK_FULL = "no space left on device"  # in a line of NATS's log
ROOM_BYTES = 64 * 1024 * 1024  # on the disk, for a broker that is started again
# NATS begins a line with "[123] 2026/11/27 19:04:35.406 [ERR] ", Mosquitto with "1764270275: "
LINE = re.compile(r"(?:\[\d+\] [\d/]+ [\d:.]+ \[(?P<level>\w+)\] ?|\d+: )?(?P<message>.*)")
LEVELS = {
    "INF": logging.DEBUG,
    "WRN": logging.WARNING,
    "ERR": logging.WARNING,
    "FTL": logging.ERROR,
}


class BrokerError(Exception):
    """The broker did not start, or ended by itself; the message is for the operator."""


class BrokerServer:
    """A broker on these listeners, with its files in `directory`."""

    def __init__(
        self,
        engine: Engine,
        read_users: ReadUsers,
        directory: Path,
        *,
        poll: float = POLL_SECONDS,
    ) -> None:
        self._engine, self._read_users = engine, read_users
        self._directory, self._poll = directory, poll
        self._users: dict[str, BrokerUser] = {}
        self._child: asyncio.subprocess.Process | None = None
        self._last_line = ""
        self._disk_was_full = False

    async def start(self, listeners: Listeners) -> int:
        """Start the broker, wait until it answers, and return its port.

        Raises:
            BrokerError: it is not installed, its files cannot be written, or it did not start.
            OSError: an address is not available.
            UsersUnavailableError: the database cannot be read.
        """
        program = self._engine.find()
        if program is None:
            raise BrokerError(
                f"{self._engine.program} is not installed: {self._engine.installation}."
            )
        self._listeners = listeners.bound()
        users = await self._read_users()
        configuration = self._directory / f"{self._engine.name}.conf"
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            self._directory.chmod(0o700)
            self._write_users(users)
            write_private(
                configuration, self._engine.configuration(self._listeners, self._directory)
            )
        except OSError as error:
            raise BrokerError(
                f"The broker's files cannot be written: {error.filename or self._directory}:"
                f" {error.strerror}."
            ) from error
        self._command = [program, "-c", str(configuration)]
        await self._run()
        return self._listeners.port

    async def wait(self) -> None:
        """Keep the broker's users and permissions as the database has them.

        Raises:
            BrokerError: it ended by itself.
        """
        while True:
            await asyncio.wait([self._output], timeout=self._poll)
            await self._must_live()
            if self._disk_was_full and shutil.disk_usage(self._directory).free > ROOM_BYTES:
                logger.warning("broker_starts_again_after_full_disk")
                await self._restart()
            try:
                users = await self._read_users()
            except UsersUnavailableError as error:
                logger.warning("broker_users_unavailable", reason=str(error))
                continue
            if users != self._users:
                self._write_users(users)
                logger.info("broker_users_changed", users=len(users))
                await self._reload()

    async def stop(self) -> None:
        """End the broker, which saves its sessions first."""
        if self._child is None or self._child.returncode is not None:
            return
        self._child.terminate()
        await asyncio.wait([self._output], timeout=STOP_SECONDS)
        if not self._output.done():
            self._child.kill()
        await self._child.wait()

    def _write_users(self, users: dict[str, BrokerUser]) -> None:
        for name, text in self._engine.files(users).items():
            write_private(self._directory / name, text)
        self._users = users

    async def _run(self) -> None:
        # A session of its own: Ctrl-C reaches only us, and we end the broker in order.
        self._child = await asyncio.create_subprocess_exec(
            *self._command,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            limit=LINE_BYTES,
            start_new_session=True,
            preexec_fn=tied_to_parent(),
        )
        assert self._child.stdout is not None, "a pipe was requested"
        self._output = asyncio.create_task(self._log_lines(self._child.stdout))
        loop = asyncio.get_running_loop()
        deadline = loop.time() + START_SECONDS
        while not await self._listeners.answer():
            await self._must_live()
            if loop.time() > deadline:
                await self.stop()
                raise BrokerError(
                    f"{self._engine.program} does not answer on port {self._listeners.port}."
                )
            await asyncio.sleep(0.02)
        # Another program may own the port: the broker then ends at once.
        await asyncio.sleep(0.05)
        await self._must_live()

    async def _reload(self) -> None:
        if sys.platform == "win32":
            await self._restart()
        elif self._child is not None:
            with contextlib.suppress(ProcessLookupError):  # `wait` will raise an error
                self._child.send_signal(signal.SIGHUP)

    async def _restart(self) -> None:
        await self.stop()
        self._disk_was_full = False
        await self._run()

    async def _must_live(self) -> None:
        if self._child is not None and self._output.done():
            code = await self._child.wait()
            reason = f"with code {code}: {self._last_line}"
            if code < 0:
                reason = f"by {signal.Signals(-code).name}."
            raise BrokerError(f"{self._engine.program} ended {reason}")

    async def _log_lines(self, output: asyncio.StreamReader) -> None:
        """Write the broker's lines into our log, and note a full disk, until the broker ends."""
        async for line in output:
            found = LINE.fullmatch(line.decode(errors="replace").strip()[:LINE_CHARACTERS])
            assert found is not None, "a line without line feeds always matches"
            message, level = found["message"], LEVELS.get(found["level"], logging.INFO)
            self._last_line = message
            self._disk_was_full = self._disk_was_full or DISK_FULL in message
            event = f"{self._engine.name}_{logging.getLevelName(level).lower()}"
            logger.log(level, event, message=message)
