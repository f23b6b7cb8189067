"""System checks: a wrong setting is told when a command starts, not by a visitor.

Errors (E) make the site unusable. Warnings (W) are risks; those that only matter on a real server
come with `check --deploy`.
"""

import ipaddress
import os
import stat
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from django.conf import settings
from django.core.checks import (
    CheckMessage,
    Error,
    Tags,
    Warning,  # noqa: A004 -- Django's name
    register,
)
from django.db import connections
from django.db.migrations.loader import MigrationLoader
from django.db.migrations.recorder import MigrationRecorder

from robots.api.disk_space import MIB, DiskSpace
from robots.ice import relays_by_region

LEAST_TOKEN = 24  # characters
LAST_BEFORE_SQUASH = "49d7e7bb"  # has every migration that a later one replaces
LOOPBACK_NAMES = {"localhost", "127.0.0.1", "[::1]", "::1", "testserver"}
MQTT_SCHEMES = {"mqtt", "mqtts", "ws", "wss"}
ENCRYPTED_SCHEMES = {"mqtts", "wss"}
LOCAL_SUFFIXES = (".local", ".lan", ".internal", ".localhost")


def check_mqtt(**_: Any) -> list[CheckMessage]:
    """The broker's addresses are addresses (E001), and tokens cross no public network in the clear
    (W001).
    """
    found: list[CheckMessage] = []
    urls = [
        *(("MQTT_URL", url.strip()) for url in settings.MQTT_URL.split(",")),
        *(("MQTT_PUBLIC_URL", url.strip()) for url in settings.MQTT_PUBLIC_URL.split(",")),
    ]
    for name, url in urls:
        if not getattr(settings, name):
            continue
        if not _is_mqtt_url(url):
            found.append(
                Error(
                    f"{name} is not an MQTT address: {url!r}.",
                    hint="Use an address such as mqtts://broker.example.org:8883.",
                    id="telepresence.E001",
                )
            )
        elif urlsplit(url).scheme not in ENCRYPTED_SCHEMES and not _is_near(
            urlsplit(url.replace("{host}", "host.example")).hostname or ""
        ):
            hint = "Use mqtts:// (run_broker takes --certificate and --key) or wss://."
            found.append(
                Warning(
                    f"{name} sends the robots' tokens unencrypted over a public network.",
                    hint=hint,
                    id="telepresence.W001",
                )
            )
    return found


def check_ice(**_: Any) -> list[CheckMessage]:
    """STUN and TURN servers are such (E002), and a TURN server has its secret (E003)."""
    found: list[CheckMessage] = []
    relays = [url for urls in relays_by_region(settings.TURN_URLS).values() for url in urls]
    for name, urls, schemes in (
        ("STUN_URLS", settings.STUN_URLS, ("stun:", "stuns:")),
        ("TURN_URLS", relays, ("turn:", "turns:")),
    ):
        found += [
            Error(
                f"{name} contains {url!r}.",
                hint=f"It must begin with {' or '.join(schemes)}",
                id="telepresence.E002",
            )
            for url in urls
            if not url.startswith(schemes)
        ]
    if settings.TURN_URLS and not settings.TURN_SECRET:
        message = (
            "TURN_URLS is set and TURN_SECRET is not: visitors behind firewalls would see no video."
        )
        found.append(
            Error(message, hint="Set it to coturn's static-auth-secret.", id="telepresence.E003")
        )
    return found


def check_sfu(**_: Any) -> list[CheckMessage]:
    """The SFU's address is that of a WebSocket (E009)."""
    if not settings.JANUS_URL or settings.JANUS_URL.startswith(("ws://", "wss://")):
        return []
    return [
        Error(
            f"JANUS_URL is {settings.JANUS_URL!r}.",
            hint="It must begin with ws:// or wss://",
            id="telepresence.E009",
        )
    ]


def check_mail(**_: Any) -> list[CheckMessage]:
    """The word for verification is one (E004), and mail that everybody must
    receive is sent (W002).
    """
    word = settings.ACCOUNT_EMAIL_VERIFICATION
    if word not in {"none", "optional", "mandatory"}:
        return [
            Error(
                f"EMAIL_VERIFICATION is {word!r}.",
                hint="Set it to none, optional or mandatory.",
                id="telepresence.E004",
            )
        ]
    if word == "mandatory" and not settings.EMAIL_HOST:
        hint = f"Set EMAIL_HOST; until then messages are only kept in {settings.EMAIL_FILE_PATH}."
        return [
            Warning(
                "Sign-up asks for a confirmed e-mail address, but no mail server is set.",
                hint=hint,
                id="telepresence.W002",
            )
        ]
    return []


def check_numbers(**_: Any) -> list[CheckMessage]:
    """Times and bounds are positive (E005), and how long a driver may do nothing is at least not
    negative.
    """
    names = (
        "TURN_MINUTES",
        "START_SECONDS",
        "GRACE_SECONDS",
        "SOCKETS_PER_ADDRESS",
        "SOCKETS_PER_USER",
        "DISK_LOW_MB",
    )
    values = {name: getattr(settings, name) for name in names}
    wrong = [
        Error(f"{name} must be positive, not {value}.", id="telepresence.E005")
        for name, value in values.items()
        if not value > 0
    ]
    if not settings.IDLE_SECONDS >= 0:
        wrong.append(
            Error(
                f"IDLE_SECONDS must be positive, or 0 for never, not {settings.IDLE_SECONDS}.",
                id="telepresence.E005",
            )
        )
    return wrong


def check_proxies(**_: Any) -> list[CheckMessage]:
    """Trusted proxies are addresses or networks (E006)."""
    wrong = [word for word in settings.TRUSTED_PROXIES if not _is_network(word)]
    return [
        Error(
            f"TRUSTED_PROXIES contains {word!r}, which is neither an address nor a network.",
            id="telepresence.E006",
        )
        for word in wrong
    ]


def check_metrics(**_: Any) -> list[CheckMessage]:
    """Who reads the figures is named by addresses (E007) or a token that nobody guesses (W007), and
    the format of logs exists (E008).
    """
    found: list[CheckMessage] = [
        Error(
            f"METRICS_ALLOWED contains {word!r}, which is neither an address nor a network.",
            id="telepresence.E007",
        )
        for word in settings.METRICS_ALLOWED
        if not _is_network(word)
    ]
    if settings.METRICS_TOKEN and len(settings.METRICS_TOKEN) < LEAST_TOKEN:
        hint = "Use a random one, such as from: openssl rand -hex 32."
        found.append(
            Warning(
                "METRICS_TOKEN is short enough to be guessed.", hint=hint, id="telepresence.W007"
            )
        )
    if settings.LOG_FORMAT not in {"text", "json"}:
        found.append(
            Error(
                f"LOG_FORMAT is {settings.LOG_FORMAT!r}.",
                hint="Set it to text or json.",
                id="telepresence.E008",
            )
        )
    return found


def check_plain_http(**_: Any) -> list[CheckMessage]:
    """Cookies over plain http stay on this machine (W003)."""
    far = [host for host in settings.ALLOWED_HOSTS if host not in LOOPBACK_NAMES]
    if not settings.HTTP_ONLY or not far:
        return []
    hint = (
        "HTTP_ONLY=1 is for 127.0.0.1. Browsers also refuse camera and microphone to a page"
        " that was loaded over plain http."
    )
    return [
        Warning(
            f"HTTP_ONLY is set and the site answers to {', '.join(far)}.",
            hint=hint,
            id="telepresence.W003",
        )
    ]


def check_secret_key(**_: Any) -> list[CheckMessage]:
    """On a server the secret key is set by its operator (W004)."""
    if os.environ.get("SECRET_KEY"):
        return []
    hint = (
        "A process on another machine would generate a different one, and its broker password and"
        " sessions would be refused."
    )
    return [
        Warning(
            "SECRET_KEY is not set; a new one was generated and saved in VAR_DIR.",
            hint=hint,
            id="telepresence.W004",
        )
    ]


def check_cache(**_: Any) -> list[CheckMessage]:
    """On a server the limits on attempts are counted together (W005)."""
    backend = (
        settings.CACHES.get("default", {}).get("BACKEND", "") if hasattr(settings, "CACHES") else ""
    )
    if "locmem" not in backend and "dummy" not in backend:
        return []
    return [
        Warning(
            "Each web process counts attempts separately.",
            hint="Set REDIS_URL if you run more than one.",
            id="telepresence.W005",
        )
    ]


def check_visitors_addresses(**_: Any) -> list[CheckMessage]:
    """On a server visitors are told apart by their addresses, also behind a proxy (W008)."""
    if not settings.SECURE_PROXY_SSL_HEADER or settings.TRUSTED_PROXIES:
        return []
    hint = (
        "Set it to the proxy's address. Without it, all visitors have the proxy's address and share"
        " its limits."
    )
    return [
        Warning(
            "BEHIND_TLS_PROXY is set, but TRUSTED_PROXIES is not.",
            hint=hint,
            id="telepresence.W008",
        )
    ]


def check_private_folder(**_: Any) -> list[CheckMessage]:
    """On a server nobody else reads what was made at run time (W009)."""
    if os.name != "posix" or not settings.VAR_DIR.stat().st_mode & stat.S_IRWXO:
        return []
    hint = (
        f"Run chmod o-rwx {settings.VAR_DIR}. If a proxy serves STATIC_ROOT, set it to a folder"
        " elsewhere."
    )
    return [
        Warning("Every user of this machine can read VAR_DIR.", hint=hint, id="telepresence.W009")
    ]


def check_disk(**_: Any) -> list[CheckMessage]:
    """There is room for what is recorded (W010)."""
    space = DiskSpace(settings.VAR_DIR, settings.DISK_LOW_MB)
    if space.state() == "ok":
        return []
    hint = f"Free some space, or lower DISK_LOW_MB ({settings.DISK_LOW_MB:g})."
    return [
        Warning(
            f"Only {space.free() // MIB} MB are free on the disk of VAR_DIR.",
            hint=hint,
            id="telepresence.W010",
        )
    ]


def check_demo(**_: Any) -> list[CheckMessage]:
    """On a server nobody logs in by the demo's link (W006)."""
    if not getattr(settings, "DEMO_TOKEN", ""):
        return []
    return [
        Warning(
            "DEMO_TOKEN is set: anybody with the demo's link is logged in.",
            hint="Only `manage.py demo` sets it.",
            id="telepresence.W006",
        )
    ]


def check_squashed_migrations(*, databases: list[str] | None, **_: Any) -> list[CheckMessage]:
    """A database has applied all or none of the migrations that another replaces (E010). Django
    alone would skip both, and `migrate` would report success.
    """
    squashed = [
        migration
        for migration in MigrationLoader(None, ignore_no_migrations=True).disk_migrations.values()
        if migration.replaces
    ]
    found: list[CheckMessage] = []
    for alias in databases or ():
        applied = MigrationRecorder(connections[alias]).applied_migrations()
        found += [
            Error(
                f"The database has only some of the migrations that {migration} replaces.",
                hint=f"Check out commit {LAST_BEFORE_SQUASH}, run manage.py migrate there, then"
                " check out this version and run it again. No data is lost.",
                id="telepresence.E010",
            )
            for migration in squashed
            if 0
            < sum(replaced in applied for replaced in migration.replaces)
            < len(migration.replaces)
        ]
    return found


ALWAYS: dict[str, tuple[Callable[..., list[CheckMessage]], ...]] = {
    "telepresence": (
        check_disk,
        check_ice,
        check_sfu,
        check_mail,
        check_metrics,
        check_numbers,
        check_proxies,
    ),
    Tags.security: (check_mqtt, check_plain_http),
    Tags.database: (check_squashed_migrations,),  # run by manage.py migrate
}
ON_A_SERVER = (
    check_secret_key,
    check_cache,
    check_visitors_addresses,
    check_private_folder,
    check_demo,
)


def register_all() -> None:
    """Tell Django of the checks; called once when the site's app is ready."""
    for tag, checks in ALWAYS.items():
        for check in checks:
            register(check, tag)
    for check in ON_A_SERVER:
        register(check, Tags.security, deploy=True)


def _is_mqtt_url(url: str) -> bool:
    try:
        parts = urlsplit(url.replace("{host}", "host"))
        return (
            parts.scheme in MQTT_SCHEMES
            and bool(parts.hostname)
            and (parts.port is None or parts.port > 0)
        )
    except ValueError:
        return False


def _is_near(host: str) -> bool:
    """Tell whether a host is on this machine or in a private network, by its look alone: nothing is
    asked of a name server.
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host in LOOPBACK_NAMES or "." not in host or host.endswith(LOCAL_SUFFIXES)
    return address.is_loopback or address.is_private


def _is_network(word: str) -> bool:
    try:
        ipaddress.ip_network(word, strict=False)
    except ValueError:
        return False
    return True
