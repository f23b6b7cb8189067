"""Log lines for machines: one event a line, as JSON or as key=value, with what it is about and
without secrets. Processors of structlog, for its formatter; whatever other libraries say becomes
the field `message`.

Secrets are not meant to be logged anywhere. As a second line of defence the values that this site
keeps secret, passwords in addresses, cookies, and fields with such names are struck out here, and
paths, which may hold one-time links, are replaced by the route they match.
"""

import functools
import logging
import re
from collections.abc import Mapping, MutableMapping
from datetime import UTC, datetime
from typing import Any
from urllib.parse import unquote, urlsplit

import structlog

from robots import log_ids
from robots.logs import TRACEBACK, pairs
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
LEAST_SECRET = 6  # characters: what is shorter would strike out ordinary words
Fields = MutableMapping[str, Any]


def of_other_libraries(_logger: Any, _name: str, event: Fields) -> Fields:
    """Name the event of a line that is none of ours."""
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
    """Say when, how grave and by whom, then what, and what it is about."""
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
    # What Django refuses is the client's fault, and its message says all.
    if error and not record.name.startswith("django.security."):
        line["traceback"] = logging.Formatter().formatException(error)
    return line


class Redaction:
    @functools.cached_property
    def _known(self) -> tuple[str, ...]:
        return known_secrets()  # there are none before the settings are read

    def __call__(self, _logger: Any, _name: str, event: Fields) -> Fields:
        return {name: self._clean(name, value) for name, value in event.items()}

    def _clean(self, name: str, value: Any) -> Any:
        if _SECRET_NAME.search(name) and isinstance(value, str):
            return STRUCK
        if value is None or isinstance(value, bool | int | float):
            return value
        if isinstance(value, Mapping):
            return {str(key): self._clean(str(key), inner) for key, inner in value.items()}
        text = str(value)
        for secret in self._known:
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


def _urls() -> list[str]:
    from django.conf import settings  # noqa: PLC0415 -- the settings name this module

    brokers = f"{settings.MQTT_URL},{settings.MQTT_PUBLIC_URL}".split(",")
    return [url.strip() for url in (*brokers, settings.REDIS_URL)]


def known_secrets() -> tuple[str, ...]:
    """Return the values of this site's settings that nobody may read in a log, longest first."""
    from django.conf import settings  # noqa: PLC0415 -- the settings name this module

    values = {
        settings.SECRET_KEY,
        settings.TURN_SECRET,
        settings.EMAIL_HOST_PASSWORD,
        settings.METRICS_TOKEN,
        settings.DEMO_TOKEN,
    }
    values |= {str(database.get("PASSWORD") or "") for database in settings.DATABASES.values()}
    for url in _urls():
        _, found, password = urlsplit(url).netloc.rpartition("@")[0].partition(":")
        values |= {password, unquote(password)} if found else set()
    return tuple(
        sorted((value for value in values if len(value) >= LEAST_SECRET), key=len, reverse=True)
    )
