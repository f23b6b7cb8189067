"""The checks that ask other computers: broker, mail server, public address and TURN servers."""

import asyncio
import smtplib
import socket
import ssl
import time
from collections.abc import Iterator
from urllib.parse import parse_qs

import aiomqtt
from django.conf import settings
from django.core import mail
from django.utils.translation import gettext as _

from robots.bridge.broker_address import BadAddress, BrokerAddress
from robots.bridge.failover import parse_nodes
from robots.enrol.credentials import server_credentials
from robots.ice import relays_by_region, turn_credentials
from telepresence_site.checks import LOOPBACK_NAMES
from telepresence_site.ops.doctor.findings import (
    Finding,
    administrator,
    clock,
    configuration,
    database,
    examine,
    session_manager,
    storage,
)

PATIENCE_SECONDS = 5.0
SOON_DAYS = 14.0  # a certificate that ends earlier should have been renewed
DAY_SECONDS = 86400.0
HTTPS = 443


def examine_site() -> list[Finding]:
    """Return the findings of all checks. It takes at most some seconds."""
    here = (database, administrator, session_manager, storage, clock, configuration)
    return examine(here, (broker, mail_server, public_address, turn_servers))


def broker() -> Iterator[Finding]:
    """Whether the site can log in to the broker."""
    part, advice = _("Broker"), _("Start manage.py run_broker, and check MQTT_URL.")
    try:
        node = parse_nodes(settings.MQTT_URL)[0]
        asyncio.run(_log_in(node))
    except BadAddress as error:
        yield Finding(part, "error", str(error), advice)
    except (aiomqtt.MqttError, OSError, TimeoutError) as error:
        detail = _("The site can't log in to it: %(why)s") % {"why": error or _("no answer")}
        yield Finding(part, "error", detail, advice)
    else:
        where = {"host": node.host, "port": node.port}
        yield Finding(part, "ok", _("The site is logged in at %(host)s, port %(port)d.") % where)


async def _log_in(node: BrokerAddress) -> None:
    user, password = server_credentials("web")
    client = aiomqtt.Client(
        node.host,
        node.port,
        username=node.username or user,
        password=node.password or password,
        transport="websockets" if node.websocket else "tcp",
        websocket_path=node.path or None,
        tls_context=ssl.create_default_context() if node.tls else None,
        timeout=PATIENCE_SECONDS,
    )
    async with asyncio.timeout(PATIENCE_SECONDS), client:
        pass


def mail_server() -> Iterator[Finding]:
    part = _("Mail")
    if not settings.EMAIL_HOST:
        where = {"folder": settings.EMAIL_FILE_PATH}
        detail = _("No mail is sent: messages are stored in %(folder)s.") % where
        yield Finding(part, "warning", detail, _("Set EMAIL_HOST and DEFAULT_FROM_EMAIL."))
        return
    try:
        connection = mail.get_connection(timeout=PATIENCE_SECONDS)
        connection.open()
        connection.close()
    except (smtplib.SMTPException, OSError) as error:
        detail = _("%(host)s refuses mail: %(why)s") % {"host": settings.EMAIL_HOST, "why": error}
        advice = _("Check EMAIL_HOST, EMAIL_PORT, EMAIL_HOST_USER and EMAIL_HOST_PASSWORD.")
        yield Finding(part, "error", detail, advice)
    else:
        accepted = _("%(host)s accepts mail.") % {"host": settings.EMAIL_HOST}
        yield Finding(part, "ok", accepted)


def public_address() -> Iterator[Finding]:
    """Whether others reach the site over HTTPS, with a certificate that browsers accept."""
    part = _("Public address")
    names = [name for name in settings.ALLOWED_HOSTS if name not in LOOPBACK_NAMES]
    hosts = [name for name in names if not name.startswith((".", "*"))]
    if not names:
        advice = _("Set ALLOWED_HOSTS to the site's name, and serve it over HTTPS.")
        yield Finding(part, "warning", _("The site answers this computer only."), advice)
    elif settings.HTTP_ONLY:
        advice = _("Serve the site over HTTPS, and remove HTTP_ONLY.")
        detail = _("Pages are sent unencrypted. Browsers allow no microphone and camera there.")
        yield Finding(part, "error", detail, advice)
    for host in [] if settings.HTTP_ONLY else hosts:
        yield _certificate(part, host)


def _certificate(part: str, host: str) -> Finding:
    try:
        days = _days_left(host)
    except ssl.SSLError as error:
        words = {"host": host, "why": getattr(error, "verify_message", "") or error.reason}
        detail = _("Browsers do not accept the certificate of %(host)s: %(why)s") % words
        return Finding(part, "error", detail, _("Get a certificate for this name."))
    except OSError as error:
        detail = _("https://%(host)s does not answer from here: %(why)s")
        advice = _("Check the name's address, the firewall and the proxy.")
        return Finding(part, "error", detail % {"host": host, "why": error}, advice)
    words = {"host": host, "days": int(days)}
    detail = _("The certificate of %(host)s is valid for %(days)d days.") % words
    if days < SOON_DAYS:
        return Finding(part, "warning", detail, _("Check that it is renewed by itself."))
    return Finding(part, "ok", detail)


def _days_left(host: str) -> float:
    context = ssl.create_default_context()
    with (
        socket.create_connection((host, HTTPS), timeout=PATIENCE_SECONDS) as plain,
        context.wrap_socket(plain, server_hostname=host) as encrypted,
    ):
        ends = (encrypted.getpeercert() or {}).get("notAfter", "")
    return (ssl.cert_time_to_seconds(str(ends)) - time.time()) / DAY_SECONDS


def turn_servers() -> Iterator[Finding]:
    """Whether each TURN server gives the site a relay."""
    part = _("TURN server")
    if not settings.TURN_URLS:
        detail = _("None is set: visitors behind strict firewalls see slow video or none.")
        yield Finding(part, "warning", detail, _("Install coturn, and set TURN_URLS."))
        return
    for url in [url for urls in relays_by_region(settings.TURN_URLS).values() for url in urls]:
        try:
            asyncio.run(_allocate(url))
        except (OSError, TimeoutError, ValueError) as error:
            words = {"url": url, "why": str(error) or _("no answer")}
            detail = _("%(url)s gives no relay: %(why)s") % words
            advice = _("Check that coturn runs, its ports are open, and TURN_SECRET is its secret.")
            yield Finding(part, "error", detail, advice)
        else:
            yield Finding(part, "ok", _("%(url)s gives a relay.") % {"url": url})


async def _allocate(url: str) -> None:
    """Get a relay address from a `turn:` or `turns:` server and give it back.

    Raises:
        OSError: it gives none.
        TimeoutError: it does not answer.
        ValueError: its port is not a number.
    """
    from aioice import stun, turn  # noqa: PLC0415 -- needed here alone

    scheme, _colon, rest = url.partition(":")
    place, _mark, query = rest.partition("?")
    host, _separator, port = place.rpartition(":") if ":" in place else (place, "", "")
    is_encrypted = scheme == "turns"
    kind = parse_qs(query).get("transport", ["tcp" if is_encrypted else "udp"])[0]
    user, password = turn_credentials("doctor", settings.TURN_SECRET, time.time())
    try:
        async with asyncio.timeout(PATIENCE_SECONDS):
            transport, _protocol = await turn.create_turn_endpoint(
                asyncio.DatagramProtocol,
                server_addr=(host, int(port or (5349 if is_encrypted else 3478))),
                username=user,
                password=password,
                ssl=is_encrypted,
                transport=kind,
            )
            transport.close()
    except stun.TransactionError as error:
        raise OSError(str(error)) from error
