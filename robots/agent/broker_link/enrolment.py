"""How an agent gets its credentials: by its owner's one-time token, and later by renewal.

Both are a POST to the server, over HTTPS; unencrypted only to this very machine.
"""

import ipaddress
import json
import os
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import structlog

from robots.agent.broker_link.broker_discovery import (
    LARGEST_ANSWER,
    TIMEOUT,
    ServerAwayError,
    reason_of,
    trust,
)
from robots.agent.config import AgentConfig, ConfigError, credentials_path, load
from robots.api import credentials_file
from robots.api.private_files import write_private

log = structlog.stdlib.get_logger(__name__)

ENROL_PATH, RENEW_PATH = "/api/v1/agent/enrol/", "/api/v1/agent/renew/"
RENEW_EVERY = 1800.0  # s between two questions whether new credentials are wanted
KEPT = ("robot", "user", "token")
REFUSALS = (
    HTTPStatus.BAD_REQUEST,
    HTTPStatus.UNAUTHORIZED,
    HTTPStatus.FORBIDDEN,
    HTTPStatus.NOT_FOUND,
    HTTPStatus.GONE,
    HTTPStatus.MISDIRECTED_REQUEST,
)


def enrol_if_asked(
    arguments: Mapping[str, Any],
    environment: Mapping[str, str] | None = None,
    *,
    check: Callable[[AgentConfig], object] = lambda _: None,
) -> None:
    """Enrol when the command line, or TELEPRESENCE_ENROL, has a one-time token; everything else is
    checked before it is spent.

    Args:
        arguments: what `config.add_arguments` parsed.
        environment: the process's own by default.
        check: raises ConfigError when the agent could not start like this with the credentials that
            come.

    Raises:
        ConfigError: as `enrol`, `config.load` and `check`, or no server is named.
    """
    environment = os.environ if environment is None else environment
    token = arguments.get("enrol") or environment.get(f"{credentials_file.ENVIRONMENT}ENROL")
    if not token:
        return
    server = arguments.get("server") or environment.get(f"{credentials_file.ENVIRONMENT}SERVER")
    if not server:
        raise ConfigError("--enrol needs --server URL: the site where the token was created")
    config = load(arguments, environment, enrolling=True)
    check(config)
    enrol(
        config.robot, str(server), str(token), credentials_path(arguments, environment), config.ca
    )


def enrol(robot: str, server: str, token: str, path: Path, ca: str | None = None) -> None:
    """Exchange a one-time token for credentials and keep them in a file, which is tried before the
    token is spent.

    Raises:
        ConfigError: the server does not know the token (any more), is not reached, or the file
            cannot be written.
    """
    check_private(server)
    try:
        credentials_file.rehearse(path)
        answer = _post(
            f"{server.rstrip('/')}{ENROL_PATH}", {"robot": robot, "token": token}, {}, ca
        )
        write_private(
            path, credentials_file.toml(_lines(answer, robot) | {"server": server.rstrip("/")})
        )
    except ServerAwayError as error:
        raise ConfigError(f"the request to {server} failed: {error}") from error
    except OSError as error:
        raise ConfigError(
            f"the credentials cannot be saved in {path}: {error.strerror or error}"
        ) from error
    log.info("agent_enrolled", robot=robot, file=path)


def renew(config: AgentConfig) -> dict[str, str] | None:
    """Ask for new credentials when the server wants that, and keep them in the file that the
    present ones came from.

    Returns:
        `robot`, `user` and `token` as they are now, or None when nothing changed: not wanted, or
            not kept in a file that can be written.

    Raises:
        ServerAwayError: no answer; the present ones still hold.
        ConfigError: the server refused the present ones, or the new ones cannot be kept.
    """
    if (
        not config.server
        or config.credentials is None
        or not config.token
        or not os.access(config.credentials.parent, os.W_OK)
    ):
        return None
    check_private(config.server)
    bearer = {"Authorization": f"Bearer {config.robot}:{config.token}"}
    answer = _post(f"{config.server}{RENEW_PATH}", {}, bearer, config.ca)
    if not answer.get("token"):
        return None
    lines = _lines(answer, config.robot)
    try:
        write_private(
            config.credentials,
            credentials_file.changed(config.credentials.read_text(encoding="utf-8"), lines),
        )
    except OSError as error:
        raise ConfigError(
            f"new credentials cannot be saved in {config.credentials}: {error.strerror or error}"
        ) from error
    log.info("agent_credentials_renewed", robot=config.robot, file=config.credentials)
    return lines


def keep_renewing(
    config: AgentConfig, renewed: Callable[[dict[str, str]], None], pause: Callable[[float], bool]
) -> None:
    """Ask now and then until `pause` returns True; hand new credentials to `renewed`."""
    while not pause(RENEW_EVERY):
        try:
            fresh = renew(config)
        except (ServerAwayError, ConfigError) as error:
            log.warning("agent_credentials_not_renewed", robot=config.robot, reason=str(error))
            continue
        if fresh is not None:
            renewed(fresh)
            return  # `config` is old by now; the next renewal follows the next start


def check_private(server: str) -> None:
    """Refuse, by ConfigError, to send credentials over a network in the clear."""
    parts = urlsplit(server)
    if parts.scheme == "https" or (
        parts.scheme == "http" and _is_this_machine(parts.hostname or "")
    ):
        return
    raise ConfigError(f"credentials are sent over https:// only, not to {server!r}")


def _is_this_machine(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _lines(answer: Mapping[str, Any], robot: str) -> dict[str, str]:
    lines = {name: answer[name] for name in KEPT if isinstance(answer.get(name), str)}
    if lines.get("robot") != robot or not lines.get("token"):
        raise ServerAwayError("its answer is invalid")
    return lines


def _post(
    url: str, content: Mapping[str, str], headers: Mapping[str, str], ca: str | None
) -> dict[str, Any]:
    request = urllib.request.Request(
        url,
        data=json.dumps(content).encode(),
        headers={"Content-Type": "application/json", "Accept": "application/json", **headers},
        method="POST",
    )
    try:
        with urllib.request.urlopen(request, timeout=TIMEOUT, context=trust(url, ca)) as response:
            answer = json.loads(response.read(LARGEST_ANSWER))
    except urllib.error.HTTPError as error:
        if error.code in REFUSALS:
            raise ConfigError(f"the server refused the request: {reason_of(error)}") from error
        raise ServerAwayError(f"it answered with HTTP status {error.code}") from error
    except (OSError, ValueError) as error:
        raise ServerAwayError(str(getattr(error, "reason", error))) from error
    if not isinstance(answer, dict):
        raise ServerAwayError("its answer is invalid")
    return answer
