"""The ids of request, session and robot that telepresence_site/ops/log_lines.py adds to each log
line of the current task.

A function that returns the ids is stored, not the ids themselves, and called when a line is
written: a page's session changes during the life of its socket.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar, Token

Ids = Callable[[], Mapping[str, object]]
NAMES = ("request", "session", "robot")

_process: dict[str, object] = {}
_about: ContextVar[Ids] = ContextVar("log_ids", default=dict)


def of_process(**ids: object) -> None:
    """Add ids to every line of this process, in all threads: an agent adds its robot."""
    _process.update(ids)


def current() -> dict[str, object]:
    """Return the ids of a line that is written now, without unknown ones."""
    found = {**_process, **_about.get()()}
    return {name: found[name] for name in NAMES if found.get(name)}


def captured() -> Ids:
    """Return the function of the current task, for another task of the same request."""
    return _about.get()


def bind(ids: Ids) -> Token[Ids]:
    """Add the ids that `ids` returns to lines until `unbind`."""
    outer = _about.get()
    return _about.set(lambda: {**outer(), **ids()})


def unbind(token: Token[Ids]) -> None:
    """Undo a `bind` of the same task."""
    _about.reset(token)


@contextmanager
def about(**ids: object) -> Iterator[None]:
    """Add ids to the lines of a block."""
    token = bind(lambda: ids)
    try:
        yield
    finally:
        unbind(token)
