"""`manage.py run_broker`: the MQTT broker between robots and server, with users and permissions
from the database.
"""

import asyncio
import contextlib
import os
import signal
import ssl
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError

from robots.broker.engines import ENGINES
from robots.broker.listeners import Listeners, Tls
from robots.broker.server import BrokerError, BrokerServer
from robots.broker.users import POLL_SECONDS, UsersUnavailableError, read_users
from robots.process import logs
from robots.process.cancellation import until_one_ends


class Command(BaseCommand):
    help = "Run the MQTT broker: Mosquitto if it is installed, otherwise NATS."
    # of the settings; to check every page takes a second
    requires_system_checks: list[str] = ["telepresence", "security"]

    def add_arguments(self, parser: ArgumentParser) -> None:
        parser.add_argument("--host", default="127.0.0.1", help="address to listen on (127.0.0.1)")
        parser.add_argument(
            "--port", type=int, default=1883, help="port (1883; 0 picks a free one)"
        )
        parser.add_argument("--engine", choices=tuple(ENGINES), help="use this broker, or fail")
        parser.add_argument("--certificate", type=Path, help="certificate chain (PEM), for TLS")
        parser.add_argument("--key", type=Path, help="key of the certificate (PEM)")
        parser.add_argument(
            "--websockets",
            metavar="HOST:PORT",
            help=("also listen here for MQTT over WebSocket, without TLS, which the proxy adds"),
        )
        parser.add_argument(
            "--poll",
            type=float,
            default=POLL_SECONDS,
            help="seconds between two checks of the database (2)",
        )

    def handle(self, *_args: Any, **options: Any) -> None:
        listeners = Listeners(
            options["host"],
            options["port"],
            _tls(options["certificate"], options["key"]),
            _address(options["websockets"]),
        )
        engine = options["engine"] or ("mosquitto" if ENGINES["mosquitto"].find() else "nats")
        broker = BrokerServer(
            ENGINES[engine],
            read_users,
            settings.VAR_DIR / "broker",
            poll=options["poll"],
        )
        logs.write_in_a_thread()  # bounded, and a full pipe delays nothing
        try:
            asyncio.run(self._serve(broker, listeners, engine))
        except KeyboardInterrupt:
            return
        except (BrokerError, UsersUnavailableError) as error:
            raise CommandError(str(error)) from error
        except OSError as error:
            raise CommandError(
                f"The broker cannot listen on {options['host']}:{options['port']}:"
                f" {_reason(error)}."
            ) from error

    async def _serve(self, broker: BrokerServer, listeners: Listeners, engine: str) -> None:
        ended = asyncio.Event()
        _end_on_signals(ended)
        try:
            port = await broker.start(listeners)
            scheme = "mqtt" if listeners.tls is None else "mqtts"
            shown = f"[{listeners.host}]" if ":" in listeners.host else listeners.host
            self.stdout.write(f"broker listening {scheme}://{shown}:{port} ({engine})")
            self.stdout.flush()
            await until_one_ends(broker.wait(), ended.wait())
        finally:
            await broker.stop()


def _reason(error: OSError) -> str:
    """Return the system's own word; asyncio wraps it in one with the address, which we have said
    already.
    """
    return os.strerror(error.errno) if error.errno else str(error)


def _tls(certificate: Path | None, key: Path | None) -> Tls | None:
    if (certificate is None) != (key is None):
        raise CommandError("TLS needs both --certificate and --key.")
    if certificate is None or key is None:
        return None
    for path in (certificate, key):
        if not path.is_file():
            raise CommandError(f"There is no file {path}.")
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
    except ssl.SSLError as error:
        raise CommandError(f"The certificate and key cannot be used: {error}") from error
    return Tls(certificate.resolve(), key.resolve())


def _address(text: str | None) -> tuple[str, int] | None:
    if text is None:
        return None
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal():
        raise CommandError(f"--websockets must be HOST:PORT, not {text}.")
    return host.strip("[]"), int(port)


def _end_on_signals(ended: asyncio.Event) -> None:
    loop = asyncio.get_running_loop()
    # Windows has neither SIGHUP nor signal handlers of loops: there Ctrl-C arrives as
    # KeyboardInterrupt.
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        with contextlib.suppress(NotImplementedError, AttributeError):
            loop.add_signal_handler(getattr(signal, name), ended.set)
