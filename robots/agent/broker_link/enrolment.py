"""An agent's credentials: by its owner's one-time token, and later by renewal.

Both are a POST to the server, over HTTPS; unencrypted only to this computer.
"""

import ipaddress
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import structlog

from robots.agent.broker_link.broker_discovery import ServerAwayError, request_json
from robots.agent.config import AgentConfig, ConfigError, credentials_path, load
from robots.api import credentials_file
from robots.api.private_files import write_private

log = structlog.stdlib.get_logger(__name__)

ENROL_PATH, RENEW_PATH = "/api/v1/agent/enrol/", "/api/v1/agent/renew/"
RENEW_EVERY = 1800.0  # s between two requests for new credentials
KEPT = ("robot", "user", "token")
REFUSALS = dict.fromkeys((400, 401, 403, 404, 410, 421), "")  # with the server's own reason


def enrol_if_asked(
    arguments: Mapping[str, Any],
    environment: Mapping[str, str] | None = None,
    *,
    check: Callable[[AgentConfig], object] = lambda _: None,
) -> None:
    """Enrol when the command line, or TELEPRESENCE_ENROL, has a one-time token; everything else is
    checked before it is spent.

    `arguments` are those of `config.add_arguments`, `environment` is the process's own by default.
    `check` raises ConfigError when the agent could not start with this configuration. Raises
    ConfigError as `enrol` and `config.load` too, and without a server.
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
    """Exchange a one-time token for credentials and save them in a file, which is tested before the
    token is spent. Raises ConfigError when the server does not accept the token or is not reached,
    or the file cannot be written.
    """
    check_private(server)
    server = server.rstrip("/")
    request = {"robot": robot, "token": token}
    try:
        credentials_file.check_writable(path)
        answer = request_json(f"{server}{ENROL_PATH}", {}, ca, REFUSALS, request)
        write_private(path, credentials_file.toml(_lines(answer, robot) | {"server": server}))
    except ServerAwayError as error:
        raise ConfigError(f"the request to {server} failed: {error}") from error
    except OSError as error:
        raise ConfigError(
            f"the credentials cannot be saved in {path}: {error.strerror or error}"
        ) from error
    log.info("agent_enrolled", robot=robot, file=path)


def renew(config: AgentConfig) -> dict[str, str] | None:
    """Request new credentials and save them in the file of the present ones. Return `robot`, `user`
    and `token`, or None when nothing changed: the server offers none, or the present ones are not
    in a writable file.

    Raises ServerAwayError without an answer, when the present ones remain valid, and ConfigError
    when the server refuses the present ones, or the new ones cannot be saved.
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
    answer = request_json(f"{config.server}{RENEW_PATH}", bearer, config.ca, REFUSALS, {})
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
    """Renew every RENEW_EVERY seconds until `pause` returns True or new credentials arrive, which
    are passed to `renewed`.
    """
    while not pause(RENEW_EVERY):
        try:
            fresh = renew(config)
        except (ServerAwayError, ConfigError) as error:
            log.warning("agent_credentials_not_renewed", robot=config.robot, reason=str(error))
            continue
        if fresh is not None:
            renewed(fresh)
            return  # `config` is outdated; the next renewal follows the next start


def check_private(server: str) -> None:
    """Raise ConfigError for a server to which credentials would cross a network unencrypted."""
    parts = urlsplit(server)
    try:
        is_here = ipaddress.ip_address(parts.hostname or "").is_loopback
    except ValueError:
        is_here = parts.hostname == "localhost"
    if parts.scheme != "https" and not (parts.scheme == "http" and is_here):
        raise ConfigError(f"credentials are sent over https:// only, not to {server!r}")


def _lines(answer: Mapping[str, Any], robot: str) -> dict[str, str]:
    lines = {name: answer[name] for name in KEPT if isinstance(answer.get(name), str)}
    if lines.get("robot") != robot or not lines.get("token"):
        raise ServerAwayError("its answer is invalid")
    return lines
