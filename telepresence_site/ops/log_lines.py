"""Log lines for machines: one event a line, as JSON or key=value, with the ids of its context and
without secrets. Processors for structlog's formatter; a line of another library becomes the field
`message`.

No code should log a secret. As a second line of defence, the secrets of the settings, passwords in
addresses, cookies, and fields with such names are redacted here, and paths, which can be one-time
links, are replaced by the route that they match.
"""

import functools
import logging
import re
from collections.abc import Iterable, Mapping, MutableMapping
from datetime import UTC, datetime
from typing import Any
from urllib.parse import unquote, urlsplit

import structlog

from robots.process import log_ids
from robots.process.logs import TRACEBACK, pairs
from telepresence_site.web.request_log import route_of

STRUCK = "***"
_SECRET_NAME = re.compile(r"password|secret|token|cookie|authorization|credential$", re.IGNORECASE)
_NAMES = r"sessionid|csrftoken|screen-[a-z0-9-]+|password|token|secret"
_SECRETS = (
    (re.compile(r"(://[^\s/:@]*):[^\s/@]+@"), rf"\1:{STRUCK}@"),
    (
        re.compile(rf"((?:{_NAMES})['\"]?\s*[=:]\s*b?['\"]?)[^\s'\";,&]+", re.IGNORECASE),
        rf"\1{STRUCK}",
    ),
    (re.compile(r"(\b(?:Bearer|Basic)\s+)[\w+/=.~-]+", re.IGNORECASE), rf"\1{STRUCK}"),
)
MIN_SECRET_LENGTH = 6  # a shorter one would redact ordinary words
Fields = MutableMapping[str, Any]


def of_other_libraries(_logger: Any, _name: str, event: Fields) -> Fields:
    """Give a line of another library an event name."""
    record: logging.LogRecord = event["_record"]
    message, arguments = event.pop("event"), event.pop("positional_args")
    if record.name == "django.request" and isinstance(arguments, tuple) and len(arguments) > 1:
        return event | {
            "event": "request_problem",
            "reason": arguments[0],
            "route": route_of(str(arguments[1])),
            "status": getattr(record, "status_code", None),
        }
    return event | {"event": record.name.rpartition(".")[2], "message": message}


def in_order(_logger: Any, _name: str, event: Fields) -> Fields:
    """Put time, level and logger first, then the event, the ids of its context, and its fields."""
    record: logging.LogRecord = event.pop("_record")
    del event["_from_structlog"]
    error = event.pop(TRACEBACK, None)
    at = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
    line = {
        "time": at.replace("+00:00", "Z"),
        "level": record.levelname.lower(),
        "logger": record.name,
        "event": event.pop("event"),
        **log_ids.current(),
        **event,
    }
    # A request that Django's security refuses needs no traceback.
    if error and not record.name.startswith("django.security."):
        line["traceback"] = logging.Formatter().formatException(error)
    return line


class Redaction:
    @functools.cached_property
    def _known(self) -> tuple[str, ...]:
        return known_secrets()  # cached at the first line, after the settings are loaded

    def __call__(self, _logger: Any, _name: str, event: Fields) -> Fields:
        return {name: self._clean(name, value) for name, value in event.items()}

    def _clean(self, name: str, value: Any) -> Any:
        if _SECRET_NAME.search(name) and isinstance(value, str):
            return STRUCK
        if value is None or isinstance(value, bool | int | float):
            return value
        if isinstance(value, Mapping):
            return {str(key): self._clean(str(key), inner) for key, inner in value.items()}
        return without_secrets(str(value), self._known)


def without_secrets(text: str, known: Iterable[str]) -> str:
    """Return a text without these secrets and without what has the form of one."""
    for secret in known:
        text = text.replace(secret, STRUCK)
    for pattern, instead in _SECRETS:
        text = pattern.sub(instead, text)
    return text


def key_value(_logger: Any, _name: str, event: Fields) -> str:
    """Render `key=value` pairs; a traceback follows on lines of its own."""
    traceback = event.pop("traceback", None)
    line = pairs({name: value for name, value in event.items() if value is not None})
    return line if traceback is None else f"{line}\n{traceback}"


def json_lines() -> logging.Formatter:
    return _formatter(structlog.processors.JSONRenderer(ensure_ascii=False, default=str))


def key_value_lines() -> logging.Formatter:
    return _formatter(key_value)


def _formatter(renderer: Any) -> logging.Formatter:
    return structlog.stdlib.ProcessorFormatter(
        processors=[in_order, Redaction(), renderer],
        foreign_pre_chain=[of_other_libraries],
        pass_foreign_args=True,
    )


def known_secrets() -> tuple[str, ...]:
    """Return the secret values of this site's settings, longest first."""
    from django.conf import settings  # noqa: PLC0415 -- the settings name this module

    values = {
        settings.SECRET_KEY,
        settings.TURN_SECRET,
        settings.JANUS_SECRET,
        settings.EMAIL_HOST_PASSWORD,
        settings.METRICS_TOKEN,
        settings.DEMO_TOKEN,
    }
    values |= {str(database.get("PASSWORD") or "") for database in settings.DATABASES.values()}
    urls = f"{settings.MQTT_URL},{settings.MQTT_PUBLIC_URL},{settings.REDIS_URL}"
    for url in urls.split(","):
        _, found, password = urlsplit(url.strip()).netloc.rpartition("@")[0].partition(":")
        values |= {password, unquote(password)} if found else set()
    secrets = [value for value in values if len(value) >= MIN_SECRET_LENGTH]
    return tuple(sorted(secrets, key=len, reverse=True))
