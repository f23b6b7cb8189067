"""Requests the broker's addresses: `GET /api/v1/agent/` with the robot's credentials."""

import json
import ssl
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from typing import Any

import structlog

from robots.agent.config import AgentConfig, ConfigError
from robots.agent.timing import Backoff

log = structlog.stdlib.get_logger(__name__)

PATH = "/api/v1/agent/"
TIMEOUT = 10.0
LARGEST_ANSWER = 1 << 16


class ServerAwayError(Exception):
    """The server did not answer; the message is one sentence."""


def broker_urls(
    config: AgentConfig, backoff: Backoff, pause: Callable[[float], bool]
) -> tuple[str, ...] | None:
    """Return the broker's addresses, the best first, or None when the agent is to end.

    `config` has the addresses, or the server, which is then asked until it answers, after pauses of
    `backoff`. `pause` waits that many seconds and returns True when the agent is to end. Raises
    ConfigError when the server refuses the credentials, or is not such a server.
    """
    if config.mqtt_url:
        return tuple(url.strip() for url in config.mqtt_url.split(","))
    while True:
        try:
            return ask(config)
        except ServerAwayError as error:
            wait, why = backoff.failed(), str(error)
            log.warning("server_away", server=config.server, reason=why, again_in=round(wait, 1))
            if pause(wait):
                return None


def ask(config: AgentConfig) -> tuple[str, ...]:
    """Ask once; raises ServerAwayError when it may succeed later, ConfigError when it cannot."""
    refused = f"the server refused the credentials of {config.robot!r}: create new ones in its"
    refused += " administration"
    absent = f"{config.server} is not a telepresence server: it has no {PATH}"
    reasons = {401: refused, 403: refused, 404: absent, 421: ""}
    bearer = {"Authorization": f"Bearer {config.robot}:{config.token}"}
    content = request_json(f"{config.server}{PATH}", bearer, config.ca, reasons)
    try:
        robot, urls = content["robot"], content.get("mqttUrls") or [content["mqttUrl"]]
    except KeyError as error:
        raise ServerAwayError("its answer is invalid") from error
    if robot != config.robot:
        raise ConfigError(f"these credentials are for {robot!r}, not for {config.robot!r}")
    if not isinstance(urls, list) or not all(isinstance(url, str) and url for url in urls):
        raise ConfigError(
            f"{config.server} names no usable broker: the addresses must be texts such as"
            f" mqtts://host:8883, not {json.dumps(urls)[:200]}; correct MQTT_PUBLIC_URL there"
        )
    return tuple(urls)


def request_json(
    url: str,
    headers: Mapping[str, str],
    ca: str | None,
    reasons: Mapping[int, str],
    content: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Return the object that the server answers to a GET, or to a POST with `content`; blocks up to
    TIMEOUT seconds.

    `reasons` has the sentences for HTTP statuses that a later request cannot change, "" for the
    server's own; they raise ConfigError. All other failures raise ServerAwayError.
    """
    data = None if content is None else json.dumps(content).encode()
    types = {"Accept": "application/json"} | ({"Content-Type": "application/json"} if data else {})
    request = urllib.request.Request(url, data, {**types, **headers})
    context = tls_context(ca) if url.startswith("https://") else None
    try:
        with urllib.request.urlopen(request, timeout=TIMEOUT, context=context) as response:
            answer = json.loads(response.read(LARGEST_ANSWER))
    except urllib.error.HTTPError as error:
        if error.code in reasons:
            raise ConfigError(reasons[error.code] or _refusal_of(error)) from error
        raise ServerAwayError(f"it answered with HTTP status {error.code}") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ServerAwayError("its answer is invalid") from error
    except (OSError, ValueError) as error:
        raise ServerAwayError(str(getattr(error, "reason", error))) from error
    if not isinstance(answer, dict):
        raise ServerAwayError("its answer is invalid")
    return answer


def _refusal_of(error: urllib.error.HTTPError) -> str:
    try:
        reason = str(json.loads(error.read(LARGEST_ANSWER))["detail"])[:300]
    except (OSError, ValueError, KeyError, TypeError):
        reason = f"it answered {error.code}"
    return f"the server refused the request: {reason}"


def tls_context(ca: str | None) -> ssl.SSLContext:
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
