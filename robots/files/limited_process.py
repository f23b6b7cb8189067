"""Reads files of other people in a child process with limits on memory and time.

A file of a few kilobytes can unpack to gigabytes or keep a parser busy for minutes, and a nested
one can overflow the stack of a parser that is written in C. In a child only that import fails, and
the other threads of the web process go on. The child gets no environment variables that hold
secrets, and answers with plain data (MessagePack).
"""

import contextlib
import importlib
import os
import re
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import django
import msgspec
import structlog
from django.conf import settings
from django.utils.translation import activate, get_language, gettext as _

PASSED_ON = ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "TMPDIR", "TEMP", "SYSTEMROOT")
ROOT = Path(__file__).parents[2]
IMPORT_FAILED = 3  # the child's exit code when a module or library cannot be loaded
NO_ANSWER = msgspec.msgpack.encode(None)  # made before memory is limited
# the dynamic loader's words, of a library that finds no room
OUT_OF_MEMORY = re.compile(r"failed to map|annot allocate memory|cannot create.*segment")
log = structlog.stdlib.get_logger(__name__)
_one_at_a_time = threading.Lock()  # several would need several times the memory


@dataclass(frozen=True)
class ChildLimits:
    """The resources that a child may use. Windows has only the limit on elapsed time."""

    memory: int = 768 * 1024**2  # bytes of address space, of which libraries take about a third
    processor: int = 10  # s
    elapsed: float = 30.0  # s, and as long again to wait for another import


@dataclass(frozen=True)
class Request:
    """The child's task: call a function of a module, in the language of the user."""

    module: str
    function: str
    arguments: list[Any]
    limits: ChildLimits
    language: str
    catalogues: list[str]


class ImportRefusedError(Exception):
    """A file cannot be imported; `problems` has a sentence for each reason."""

    def __init__(self, problems: list[str]) -> None:
        super().__init__(" ".join(problems))
        self.problems = problems


def run_limited(
    function: Callable[..., Any], *arguments: Any, limits: ChildLimits | None = None
) -> Any:
    """Return what a function returns for these arguments.

    Args:
        function: of a module that needs none of Django's apps, models and settings.
        arguments: None, numbers, texts, bytes, and lists and dicts of them; so is the result.
        limits: what it may use.

    Raises:
        ImportRefusedError: the function raised an exception with `problems`, reached a limit, or
            could not be imported, or another import took too long.
        RuntimeError: it failed otherwise; the text is the child's traceback.
    """
    request = Request(
        function.__module__,
        function.__name__,
        list(arguments),
        limits or ChildLimits(),
        get_language() or settings.LANGUAGE_CODE,
        [str(path) for path in settings.LOCALE_PATHS],
    )
    answer = _answer(request)
    if answer is None:
        raise ImportRefusedError(
            [_("The file needs too much memory or time, or is nested too deeply.")]
        )
    if "problems" in answer:
        raise ImportRefusedError(answer["problems"])
    return answer["result"]


def _answer(request: Request) -> dict[str, Any] | None:
    """Return what a child answers, None when it reached a limit."""
    if not _one_at_a_time.acquire(timeout=request.limits.elapsed):
        raise ImportRefusedError(
            [_("Another import is running on the server. Try again in a minute.")]
        )
    try:
        child = subprocess.run(
            [sys.executable, "-m", "robots.files.limited_process"],
            input=msgspec.msgpack.encode(request),
            capture_output=True,
            timeout=request.limits.elapsed,
            cwd=ROOT,
            env={name: os.environ[name] for name in PASSED_ON if name in os.environ}
            | {"OPENBLAS_NUM_THREADS": "1"},  # each thread takes address space
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None
    finally:
        _one_at_a_time.release()
    reason = child.stderr.decode(errors="replace")
    if child.returncode == IMPORT_FAILED:
        log.error("import_not_possible", module=request.module, reason=reason)
        raise ImportRefusedError(
            [_("The server cannot read such files just now. Tell the site's staff.")]
        )
    if child.returncode > 0 and "MemoryError" not in reason:
        raise RuntimeError(reason)
    if child.returncode != 0:  # or a signal: processor time, or a stack that overflowed
        return None
    answer: dict[str, Any] | None = msgspec.msgpack.decode(child.stdout)
    return answer


def _main() -> None:
    """Answer the request on the standard input."""
    request = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Request)
    try:
        answer = msgspec.msgpack.encode({"result": _called(request)})
    except (MemoryError, RecursionError):
        answer = NO_ANSWER
    except ImportError as error:
        if OUT_OF_MEMORY.search(str(error)) is None:
            traceback.print_exc()
            sys.exit(IMPORT_FAILED)
        answer = NO_ANSWER
    except Exception as error:
        if not hasattr(error, "problems"):
            raise  # with a traceback on the standard error
        answer = msgspec.msgpack.encode({"problems": [str(one) for one in error.problems]})
    sys.stdout.buffer.write(answer)


def _called(request: Request) -> Any:
    _limit(request.limits)
    settings.configure(LOCALE_PATHS=request.catalogues, USE_I18N=True)
    django.setup()
    activate(request.language)
    function = getattr(importlib.import_module(request.module), request.function)
    return function(*request.arguments)


def _limit(limits: ChildLimits) -> None:
    with contextlib.suppress(ImportError):  # Windows
        import resource  # noqa: PLC0415

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (limits.memory, limits.memory))
        resource.setrlimit(resource.RLIMIT_CPU, (limits.processor, limits.processor + 1))


if __name__ == "__main__":
    _main()
