"""Logging by structlog: an event has a name and fields, given where it happens.

    log = structlog.stdlib.get_logger(__name__)
    log.info("robot_connected", robot=name, attempt=attempt)

Events go through the standard library's logging, so that handlers, levels and lines of others
stay in one place.
"""

import json
import re
import sys
from collections.abc import Mapping, MutableMapping
from typing import Any

# Where they are installed, structlog loads these for features that nothing here uses: half of the
# time that it takes to load, in every process.
_UNUSED = [name for name in ("rich", "twisted") if name not in sys.modules]
sys.modules.update(dict.fromkeys(_UNUSED))  # type: ignore[arg-type] # None: not to be found
import structlog  # noqa: E402 -- without the above

for _name in _UNUSED:
    del sys.modules[_name]

_PLAIN = re.compile(r"[^\s\"=]+")
TRACEBACK = "exc_info"


class LogEvent(dict[str, Any]):
    """The fields of an event; as text `name key=value …`, for formatters that know no fields."""

    def __str__(self) -> str:
        kept = [name for name in self if name not in {"event", TRACEBACK}]
        fields = pairs({name: self[name] for name in kept})
        return f"{self['event']} {fields}" if fields else str(self["event"])


def pairs(fields: Mapping[str, Any]) -> str:
    """Return `key=value` pairs; what holds spaces, quotes or line ends is quoted as in JSON."""
    return " ".join(f"{name}={_quoted(value)}" for name, value in fields.items())


def _quoted(value: Any) -> str:
    if isinstance(value, bool | int | float | Mapping | list | tuple) or value is None:
        value = json.dumps(value, ensure_ascii=False, default=str)
    text = str(value)
    return text if _PLAIN.fullmatch(text) else json.dumps(text, ensure_ascii=False)


def to_standard_library(
    logger: Any, name: str, event: MutableMapping[str, Any]
) -> tuple[tuple[LogEvent], dict[str, Any]]:
    """Return the arguments of the standard library's logger; the last processor. What structlog's
    own formatter needs goes along (structlog.stdlib.ProcessorFormatter).
    """
    if event.get(TRACEBACK) is True:
        event[TRACEBACK] = sys.exc_info()
    passed_on = {"extra": {"_logger": logger, "_name": name}, TRACEBACK: event.get(TRACEBACK)}
    return (LogEvent(event),), passed_on


def configure() -> None:
    """Have every logger of structlog hand its events to the standard library, unless the program
    around has set it up in its own way.
    """
    if structlog.is_configured():
        return
    structlog.configure(
        processors=[structlog.stdlib.filter_by_level, to_standard_library],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=True,
    )
