"""System checks: a wrong setting is reported when a command starts, before a visitor meets it.

Errors (E) make the site unusable. Warnings (W) are risks; those that only matter on a real server
are reported by `check --deploy`.
"""

import ipaddress
import os
import stat
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

from django.conf import settings
from django.core.checks import CheckMessage, Error, Tags, Warning as Risk, register
from django.db import connections
from django.db.migrations.loader import MigrationLoader
from django.db.migrations.recorder import MigrationRecorder

from robots.api.disk_space import MIB, DiskSpace
from robots.ice import relays_by_region

SETTINGS = "telepresence"  # the tag of checks that look at settings alone
MIN_TOKEN_LENGTH = 24
LAST_BEFORE_SQUASH = "49d7e7bb"  # has every migration that a later one replaces
LOOPBACK_NAMES = {"localhost", "127.0.0.1", "[::1]", "::1", "testserver"}
MQTT_SCHEMES = {"mqtt", "mqtts", "ws", "wss"}
ENCRYPTED_SCHEMES = {"mqtts", "wss"}
LOCAL_SUFFIXES = (".local", ".lan", ".internal", ".localhost")
POSITIVE = (
    "TURN_MINUTES",
    "START_SECONDS",
    "GRACE_SECONDS",
    "SOCKETS_PER_ADDRESS",
    "SOCKETS_PER_USER",
    "DISK_LOW_MB",
)
Found = Iterator[CheckMessage]


def _error(number: str, text: str, hint: str | None = None) -> CheckMessage:
    return Error(text, hint=hint, id=f"telepresence.{number}")


def _risk(number: str, text: str, hint: str) -> CheckMessage:
    return Risk(text, hint=hint, id=f"telepresence.{number}")


@register(Tags.security)
def check_mqtt(**_: Any) -> Found:
    """The broker's addresses are valid (E001), and no token crosses a public network unencrypted
    (W001).
    """
    for name in ("MQTT_URL", "MQTT_PUBLIC_URL"):
        urls = getattr(settings, name)
        for url in (url.strip() for url in urls.split(",") if urls):
            if not _is_mqtt_url(url):
                hint = "Use an address such as mqtts://broker.example.org:8883."
                yield _error("E001", f"{name} is not an MQTT address: {url!r}.", hint)
            elif urlsplit(url).scheme not in ENCRYPTED_SCHEMES and not _is_near(
                urlsplit(url.replace("{host}", "host.example")).hostname or ""
            ):
                yield _risk(
                    "W001",
                    f"{name} sends the robots' tokens unencrypted over a public network.",
                    "Use mqtts:// (run_broker takes --certificate and --key) or wss://.",
                )


@register(SETTINGS)
def check_ice(**_: Any) -> Found:
    """STUN and TURN servers have the right schemes (E002), and TURN servers a secret (E003)."""
    relays = [url for urls in relays_by_region(settings.TURN_URLS).values() for url in urls]
    for name, urls, schemes in (
        ("STUN_URLS", settings.STUN_URLS, ("stun:", "stuns:")),
        ("TURN_URLS", relays, ("turn:", "turns:")),
    ):
        for url in urls:
            if not url.startswith(schemes):
                hint = f"It must begin with {' or '.join(schemes)}"
                yield _error("E002", f"{name} contains {url!r}.", hint)
    if settings.TURN_URLS and not settings.TURN_SECRET:
        yield _error(
            "E003",
            "TURN_URLS is set and TURN_SECRET is not: visitors behind firewalls would see no"
            " video.",
            "Set it to coturn's static-auth-secret.",
        )


@register(SETTINGS)
def check_sfu(**_: Any) -> Found:
    """The SFU's address is that of a WebSocket (E009)."""
    if settings.JANUS_URL and not settings.JANUS_URL.startswith(("ws://", "wss://")):
        hint = "It must begin with ws:// or wss://"
        yield _error("E009", f"JANUS_URL is {settings.JANUS_URL!r}.", hint)


@register(SETTINGS)
def check_mail(**_: Any) -> Found:
    """EMAIL_VERIFICATION is a known word (E004), and mandatory mail can be sent (W002)."""
    word = settings.ACCOUNT_EMAIL_VERIFICATION
    if word not in {"none", "optional", "mandatory"}:
        hint = "Set it to none, optional or mandatory."
        yield _error("E004", f"EMAIL_VERIFICATION is {word!r}.", hint)
    if word == "mandatory" and not settings.EMAIL_HOST:
        yield _risk(
            "W002",
            "Sign-up asks for a confirmed e-mail address, but no mail server is set.",
            f"Set EMAIL_HOST; until then messages are only kept in {settings.EMAIL_FILE_PATH}.",
        )


@register(SETTINGS)
def check_numbers(**_: Any) -> Found:
    """Times and limits are positive (E005); IDLE_SECONDS may also be 0."""
    for name in POSITIVE:
        value = getattr(settings, name)
        if not value > 0:
            yield _error("E005", f"{name} must be positive, not {value}.")
    if not settings.IDLE_SECONDS >= 0:
        text = f"IDLE_SECONDS must be positive, or 0 for never, not {settings.IDLE_SECONDS}."
        yield _error("E005", text)


@register(SETTINGS)
def check_proxies(**_: Any) -> Found:
    """Trusted proxies are addresses or networks (E006)."""
    yield from _check_networks("E006", "TRUSTED_PROXIES")


@register(SETTINGS)
def check_metrics(**_: Any) -> Found:
    """METRICS_ALLOWED has addresses or networks (E007), METRICS_TOKEN cannot be guessed (W007), and
    LOG_FORMAT is a known word (E008).
    """
    yield from _check_networks("E007", "METRICS_ALLOWED")
    if settings.METRICS_TOKEN and len(settings.METRICS_TOKEN) < MIN_TOKEN_LENGTH:
        hint = "Use a random one, such as from: openssl rand -hex 32."
        yield _risk("W007", "METRICS_TOKEN is short enough to be guessed.", hint)
    if settings.LOG_FORMAT not in {"text", "json"}:
        yield _error("E008", f"LOG_FORMAT is {settings.LOG_FORMAT!r}.", "Set it to text or json.")


@register(Tags.security)
def check_plain_http(**_: Any) -> Found:
    """Cookies are sent over plain http on this machine only (W003)."""
    far = [host for host in settings.ALLOWED_HOSTS if host not in LOOPBACK_NAMES]
    if settings.HTTP_ONLY and far:
        yield _risk(
            "W003",
            f"HTTP_ONLY is set and the site answers to {', '.join(far)}.",
            "HTTP_ONLY=1 is for 127.0.0.1. Browsers also refuse camera and microphone to a page"
            " that was loaded over plain http.",
        )


@register(Tags.security, deploy=True)
def check_secret_key(**_: Any) -> Found:
    """The operator of a server sets its secret key (W004)."""
    if not os.environ.get("SECRET_KEY"):
        yield _risk(
            "W004",
            "SECRET_KEY is not set; a new one was generated and saved in VAR_DIR.",
            "A process on another machine would generate a different one, and its broker password"
            " and sessions would be refused.",
        )


@register(Tags.security, deploy=True)
def check_cache(**_: Any) -> Found:
    """The web processes of a server count attempts together (W005)."""
    backend = settings.CACHES.get("default", {}).get("BACKEND", "")
    if "locmem" in backend or "dummy" in backend:
        hint = "Set REDIS_URL if you run more than one."
        yield _risk("W005", "Each web process counts attempts separately.", hint)


@register(Tags.security, deploy=True)
def check_visitors_addresses(**_: Any) -> Found:
    """A server distinguishes visitors by address, also behind a proxy (W008)."""
    if settings.SECURE_PROXY_SSL_HEADER and not settings.TRUSTED_PROXIES:
        yield _risk(
            "W008",
            "BEHIND_TLS_PROXY is set, but TRUSTED_PROXIES is not.",
            "Set it to the proxy's address. Without it, all visitors have the proxy's address and"
            " share its limits.",
        )


@register(Tags.security, deploy=True)
def check_private_folder(**_: Any) -> Found:
    """Other users of a server cannot read its run-time data (W009)."""
    if os.name == "posix" and settings.VAR_DIR.stat().st_mode & stat.S_IRWXO:
        yield _risk(
            "W009",
            "Every user of this machine can read VAR_DIR.",
            f"Run chmod o-rwx {settings.VAR_DIR}. If a proxy serves STATIC_ROOT, set it to a folder"
            " elsewhere.",
        )


@register(SETTINGS)
def check_disk(**_: Any) -> Found:
    """The disk has room for recordings (W010)."""
    space = DiskSpace(settings.VAR_DIR, settings.DISK_LOW_MB)
    if space.state() != "ok":
        yield _risk(
            "W010",
            f"Only {space.free() // MIB} MB are free on the disk of VAR_DIR.",
            f"Free some space, or lower DISK_LOW_MB ({settings.DISK_LOW_MB:g}).",
        )


@register(Tags.security, deploy=True)
def check_demo(**_: Any) -> Found:
    """The demo's link does not log visitors in on a server (W006)."""
    if settings.DEMO_TOKEN:
        text = "DEMO_TOKEN is set: anybody with the demo's link is logged in."
        yield _risk("W006", text, "Only `manage.py demo` sets it.")


@register(Tags.database)  # run by manage.py migrate
def check_squashed_migrations(*, databases: list[str] | None, **_: Any) -> Found:
    """A database has applied all or none of the migrations that another replaces (E010). Django
    alone would skip both, and `migrate` would report success.
    """
    known = MigrationLoader(None, ignore_no_migrations=True).disk_migrations.values()
    for alias in databases or ():
        applied = MigrationRecorder(connections[alias]).applied_migrations()
        for migration in known:
            if 0 < sum(old in applied for old in migration.replaces) < len(migration.replaces):
                yield _error(
                    "E010",
                    f"The database has only some of the migrations that {migration} replaces.",
                    f"Check out commit {LAST_BEFORE_SQUASH}, run manage.py migrate there, then"
                    " check out this version and run it again. No data is lost.",
                )


def _is_mqtt_url(url: str) -> bool:
    try:
        parts = urlsplit(url.replace("{host}", "host"))
        has_port = parts.port is None or parts.port > 0
    except ValueError:
        return False
    return parts.scheme in MQTT_SCHEMES and bool(parts.hostname) and has_port


def _is_near(host: str) -> bool:
    """Tell whether a host is on this machine or in a private network, judged by its name alone: no
    name server is asked.
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host in LOOPBACK_NAMES or "." not in host or host.endswith(LOCAL_SUFFIXES)
    return address.is_loopback or address.is_private


def _check_networks(number: str, name: str) -> Found:
    for word in getattr(settings, name):
        try:
            ipaddress.ip_network(word, strict=False)
        except ValueError:
            text = f"{name} contains {word!r}, which is neither an address nor a network."
            yield _error(number, text)
