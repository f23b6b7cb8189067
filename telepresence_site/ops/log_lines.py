"""Log lines for machines: one event a line, as JSON or as key=value, with what it is about and
without secrets.

Our own messages are `event_name field=%s other=%.1f`: event and fields are read from the template
and its arguments, so that a value with spaces stays one value. Whatever other libraries say becomes
the field `message`.

Secrets are not meant to be logged anywhere. As a second line of defence the values that this site
keeps secret, passwords in addresses, cookies, and fields with such names are struck out here, and
paths, which may hold one-time links, are replaced by the route they match.
"""

import json
import logging
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any
from urllib.parse import unquote, urlsplit

from robots import log_ids
from telepresence_site.web.request_log import route_of

STRUCK = "***"
_EVENT = re.compile(r"[a-z][a-z0-9_]*")
_FIELD = re.compile(r"([A-Za-z_]\w*)=(%[-+# 0-9.]*[a-zA-Z]|[^\s%]*)")
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
_PLAIN = re.compile(r"[^\s\"=]+")
LEAST_SECRET = 6  # characters: what is shorter would strike out ordinary words


def fields_of(record: logging.LogRecord) -> tuple[str, dict[str, Any]]:
    """Return the event's name and its fields; for a message that is no event of ours, the logger's
    last name and the message.
    """
    if record.name == "django.request" and isinstance(record.args, tuple) and len(record.args) > 1:
        return "request_problem", {
            "reason": record.args[0],
            "route": route_of(str(record.args[1])),
            "status": getattr(record, "status_code", None),
        }
    event, *words = str(record.msg).split(" ")
    found = [_FIELD.fullmatch(word) for word in words]
    # logging unpacks a lone mapping.
    arguments = [record.args] if isinstance(record.args, Mapping) else list(record.args or ())
    if (
        not _EVENT.fullmatch(event)
        or not all(found)
        or sum(match[2].startswith("%") for match in found if match) != len(arguments)
    ):
        return record.name.rpartition(".")[2], {"message": record.getMessage()}
    rest = iter(arguments)
    return event, {match[1]: _value(match[2], rest) for match in found if match}


def _value(word: str, rest: Any) -> Any:
    if not word.startswith("%"):
        return word
    value = next(rest)
    if value is None or (isinstance(value, bool | int | str) and word in {"%s", "%d"}):
        return value
    if isinstance(value, float) and word.endswith("f"):
        return float(word % value)
    return (
        {str(name): count for name, count in value.items()}
        if isinstance(value, dict)
        else word % (value,)
    )


class _Line(logging.Formatter):
    """Collects what a line says; a subclass writes it down."""

    def __init__(self, *_: Any, **__: Any) -> None:
        super().__init__()
        self._known_secrets: tuple[str, ...] | None = None

    def fields(self, record: logging.LogRecord) -> dict[str, Any]:
        """Return everything that a line says, in order."""
        event, own = fields_of(record)
        at = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line = {
            "time": at.replace("+00:00", "Z"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "event": event,
        }
        line |= {**log_ids.current(), **own}
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return {name: self._clean(name, value) for name, value in line.items()}

    def _clean(self, name: str, value: Any) -> Any:
        if _SECRET_NAME.search(name) and isinstance(value, str):
            return STRUCK
        if value is None or isinstance(value, bool | int | float):
            return value
        return (
            {key: self._clean(str(key), inner) for key, inner in value.items()}
            if isinstance(value, dict)
            else self._struck(str(value))
        )

    def _struck(self, text: str) -> str:
        if self._known_secrets is None:
            self._known_secrets = known_secrets()
        for secret in self._known_secrets:
            text = text.replace(secret, STRUCK)
        for pattern, instead in _SECRETS:
            text = pattern.sub(instead, text)
        return text


class JsonLine(_Line):
    """One JSON object a line."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        return json.dumps(self.fields(record), ensure_ascii=False, default=str)


class KeyValueLine(_Line):
    """`key=value` pairs; what holds spaces, quotes or line ends is quoted as in JSON. A traceback
    follows on lines of its own.
    """

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        fields = self.fields(record)
        traceback = fields.pop("traceback", None)
        line = " ".join(
            f"{name}={_quoted(value)}" for name, value in fields.items() if value is not None
        )
        return line if traceback is None else f"{line}\n{traceback}"


def _quoted(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)
    return text if _PLAIN.fullmatch(text) else json.dumps(text, ensure_ascii=False)


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
    for url in (settings.MQTT_URL, *settings.MQTT_PUBLIC_URL.split(","), settings.REDIS_URL):
        _, found, password = urlsplit(url).netloc.rpartition("@")[0].partition(":")
        values |= {password, unquote(password)} if found else set()
    return tuple(
        sorted((value for value in values if len(value) >= LEAST_SECRET), key=len, reverse=True)
    )
