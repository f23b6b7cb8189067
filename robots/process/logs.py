"""Logging with structlog: an event has a name and fields.

    log = structlog.stdlib.get_logger(__name__)
    log.info("robot_connected", robot=name, attempt=attempt)

Events go through the standard library's logging, which also has the lines of other libraries.
"""

import json
import logging
import queue
import re
import sys
import threading
from collections import Counter
from collections.abc import Mapping, MutableMapping
from typing import Any

# structlog imports these, if they are installed, for features that we do not use: half of its
# import time, in every process.
_UNUSED = [name for name in ("rich", "twisted") if name not in sys.modules]
sys.modules.update(dict.fromkeys(_UNUSED))  # type: ignore[arg-type] # None: not to be found
import structlog  # noqa: E402 -- without the above

for _name in _UNUSED:
    del sys.modules[_name]

MOST_WAITING = 2000  # lines that a slow terminal or journal has not accepted
LINES_OF_EVENT = 30  # a minute
FLUSH_S = 1.0
_PLAIN = re.compile(r"[^\s\"=]+")
TRACEBACK = "exc_info"


class LogEvent(dict[str, Any]):
    """The fields of an event; as text `name key=value …`, for formatters without fields."""

    def __str__(self) -> str:
        kept = [name for name in self if name not in {"event", TRACEBACK}]
        fields = pairs({name: self[name] for name in kept})
        return f"{self['event']} {fields}" if fields else str(self["event"])


def pairs(fields: Mapping[str, Any]) -> str:
    """Return `key=value` pairs; values with spaces, quotes or line ends are quoted as in JSON."""
    return " ".join(f"{name}={_quoted(value)}" for name, value in fields.items())


def _quoted(value: Any) -> str:
    if isinstance(value, bool | int | float | Mapping | list | tuple) or value is None:
        value = json.dumps(value, ensure_ascii=False, default=str)
    text = str(value)
    return text if _PLAIN.fullmatch(text) else json.dumps(text, ensure_ascii=False)


def to_standard_library(
    logger: Any, name: str, event: MutableMapping[str, Any]
) -> tuple[tuple[LogEvent], dict[str, Any]]:
    """Return the arguments of the standard library's logger, with those that structlog's
    ProcessorFormatter needs; the last processor.
    """
    if event.get(TRACEBACK) is True:
        event[TRACEBACK] = sys.exc_info()
    passed_on = {"extra": {"_logger": logger, "_name": name}, TRACEBACK: event.get(TRACEBACK)}
    return (LogEvent(event),), passed_on


def reason_of(error: BaseException) -> str:
    """Return the message of an error, or its class if it has none, such as TimeoutError."""
    return str(error) or type(error).__name__


def configure() -> None:
    """Let structlog pass events to the standard library, unless the program has configured it."""
    if structlog.is_configured():
        return
    structlog.configure(
        processors=[structlog.stdlib.filter_by_level, to_standard_library],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=True,
    )


class ThreadedHandler(logging.Handler):
    """Lets other handlers write in a separate thread: a blocked terminal or journal must not stop
    the thread that logs. Lines are dropped and counted when the queue is full, and, unless
    critical, when an event is frequent, so that a client cannot fill the log.

    Args:
        handlers: write the lines.
        most: length of the queue.
    """

    def __init__(self, handlers: list[logging.Handler], most: int = MOST_WAITING) -> None:
        super().__init__()
        self._handlers, self._dropped = handlers, 0
        self._minute, self._events = 0, Counter[tuple[str, str]]()
        self._lines: queue.Queue[logging.LogRecord] = queue.Queue(most)
        threading.Thread(target=self._write, name="log", daemon=True).start()

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a line; called with the handler's lock, which also protects the count."""
        full = self._lines.full()
        if full or (record.levelno < logging.CRITICAL and self._is_frequent(record)):
            self._dropped += 1
        else:
            self._lines.put_nowait(record)

    def _is_frequent(self, record: logging.LogRecord) -> bool:
        minute = int(record.created // 60)
        if minute != self._minute or len(self._events) > MOST_WAITING:
            self._minute = minute
            self._events.clear()
        event = record.msg["event"] if isinstance(record.msg, LogEvent) else record.msg
        self._events[record.name, str(event)] += 1
        return self._events[record.name, str(event)] > LINES_OF_EVENT

    def flush(self) -> None:
        """Wait until all lines are written, at most `FLUSH_S` seconds."""
        with self._lines.all_tasks_done:
            self._lines.all_tasks_done.wait_for(lambda: not self._lines.unfinished_tasks, FLUSH_S)

    def _write(self) -> None:
        while True:
            record = self._lines.get()
            for handler in self._handlers:
                if record.levelno >= handler.level:
                    handler.handle(record)
            self._lines.task_done()
            self.acquire()
            dropped, self._dropped = self._dropped, 0
            self.release()
            if dropped:
                logging.getLogger(__name__).warning(LogEvent(event="lines_dropped", count=dropped))


def write_in_a_thread() -> None:
    """Let the root logger's handlers write in a thread; idempotent."""
    root = logging.getLogger()
    if not any(isinstance(handler, ThreadedHandler) for handler in root.handlers):
        root.handlers = [ThreadedHandler(root.handlers)]


def flush() -> None:
    """Wait until all lines are written, at most `FLUSH_S` seconds."""
    for handler in logging.getLogger().handlers:
        if isinstance(handler, ThreadedHandler):
            handler.flush()
