"""The ids of request, session and robot that are added to each log line of the current task.

A function that returns the ids is stored, not the ids themselves: a page's session changes during
the life of its socket, and the ids are looked up only when a line is written.
`telepresence_site/ops/log_lines.py` puts them into the lines.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar, Token

Ids = Callable[[], Mapping[str, object]]
NAMES = ("request", "session", "robot")

_process: dict[str, object] = {}
_about: ContextVar[Ids] = ContextVar("log_ids", default=dict)


def of_process(**ids: object) -> None:
    """Name what every line of this process is about, in all of its threads: a robot's agent its
    robot.
    """
    _process.update(ids)


def current() -> dict[str, object]:
    """Return the ids that a line written here and now carries; unknown ones are left out."""
    found = {**_process, **_about.get()()}
    return {name: found[name] for name in NAMES if found.get(name)}


def captured() -> Ids:
    """Return what names the ids of lines written here, for another task that works for the same
    request.
    """
    return _about.get()


def bind(ids: Ids) -> Token[Ids]:
    """Have lines carry what `ids` returns, besides what they carry already, until `unbind`."""
    outer = _about.get()
    return _about.set(lambda: {**outer(), **ids()})


def unbind(token: Token[Ids]) -> None:
    """Undo a `bind` of the same task."""
    _about.reset(token)


@contextmanager
def about(**ids: object) -> Iterator[None]:
    """Have the lines of a block carry these ids."""
    token = bind(lambda: ids)
    try:
        yield
    finally:
        unbind(token)
