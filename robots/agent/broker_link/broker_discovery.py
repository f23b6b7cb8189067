"""Asking the server where its broker is: `GET /api/v1/agent/` with the robot's credentials."""

import json
import ssl
import urllib.error
import urllib.request
from collections.abc import Callable
from http import HTTPStatus

import structlog

from robots.agent.config import AgentConfig, ConfigError
from robots.agent.timing import Backoff

log = structlog.stdlib.get_logger(__name__)

PATH = "/api/v1/agent/"
TIMEOUT = 10.0
LARGEST_ANSWER = 1 << 16
REFUSALS = (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN)


class ServerAwayError(Exception):
    """The server did not answer; the message is one sentence."""


def broker_urls(
    config: AgentConfig, backoff: Backoff, pause: Callable[[float], bool]
) -> tuple[str, ...] | None:
    """Return the broker's addresses, the best first, asking the server for ever if need be.

    Args:
        config: names the broker itself, or the server and the credentials.
        backoff: how long to wait between two attempts.
        pause: waits that many seconds and returns True when the agent is to end instead.

    Returns:
        The addresses, of which one is enough, or None when the agent is to end.

    Raises:
        ConfigError: the server refused the credentials, or this is not such a server.
    """
    if config.mqtt_url:
        return tuple(url.strip() for url in config.mqtt_url.split(","))
    while True:
        try:
            return ask(config)
        except ServerAwayError as error:
            wait = backoff.failed()
            log.warning(
                "server_away",
                server=config.server,
                reason=str(error),
                again_in=round(wait, 1),
            )
            if pause(wait):
                return None


def ask(config: AgentConfig) -> tuple[str, ...]:
    """Ask once; blocks up to TIMEOUT seconds.

    Raises:
        ServerAwayError: no answer, or one that may be another next time.
        ConfigError: asking again is of no use.
    """
    request = urllib.request.Request(
        f"{config.server}{PATH}",
        headers={
            "Authorization": f"Bearer {config.robot}:{config.token}",
            "Accept": "application/json",
        },
    )
    try:
        with urllib.request.urlopen(
            request, timeout=TIMEOUT, context=trust(str(config.server), config.ca)
        ) as response:
            answer = response.read(LARGEST_ANSWER)
    except urllib.error.HTTPError as error:
        if error.code in REFUSALS:
            raise ConfigError(
                f"the server refused the credentials of {config.robot!r}: create new "
                "ones in its administration"
            ) from error
        if error.code == HTTPStatus.MISDIRECTED_REQUEST:
            raise ConfigError(f"the server refused the request: {reason_of(error)}") from error
        if error.code == HTTPStatus.NOT_FOUND:
            raise ConfigError(
                f"{config.server} is not a telepresence server: it has no {PATH}"
            ) from error
        raise ServerAwayError(f"it answered with HTTP status {error.code}") from error
    except (OSError, ValueError) as error:
        raise ServerAwayError(str(getattr(error, "reason", error))) from error
    return _urls_in(answer, config)


def _urls_in(answer: bytes, config: AgentConfig) -> tuple[str, ...]:
    try:
        content = json.loads(answer)
        robot, urls = content["robot"], content.get("mqttUrls") or [content["mqttUrl"]]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ServerAwayError("its answer is invalid") from error
    if robot != config.robot:
        raise ConfigError(f"these credentials are for {robot!r}, not for {config.robot!r}")
    if not isinstance(urls, list) or not all(isinstance(url, str) and url for url in urls):
        raise ConfigError(
            f"{config.server} names no usable broker: the addresses must be texts such as"
            f" mqtts://host:8883, not {json.dumps(urls)[:200]}; correct MQTT_PUBLIC_URL there"
        )
    return tuple(urls)


def reason_of(error: urllib.error.HTTPError) -> str:
    """Return the server's own reason for its refusal."""
    try:
        content = json.loads(error.read(LARGEST_ANSWER))
        return str(content["detail"])[:300]
    except (OSError, ValueError, KeyError, TypeError):
        return f"it answered {error.code}"


def trust(server: str, ca: str | None) -> ssl.SSLContext | None:
    """Return whose certificates are believed: the system's, and those in the file `ca`; None for
    plain HTTP.

    Raises:
        ConfigError: the file cannot be read.
    """
    if not server.startswith("https://"):
        return None
    return believed(ca)


def believed(ca: str | None) -> ssl.SSLContext:
    """Trust the system's certificates and those in the file `ca`; raises ConfigError."""
    context = ssl.create_default_context()
    try:
        if ca:
            context.load_verify_locations(ca)
    except OSError as error:
        raise ConfigError(
            f"the certificates in {ca} cannot be read: {error.strerror or error}"
        ) from error
    return context
