"""The end of our processes: on SIGINT and SIGTERM, and of children with their parent.

A process inherits the ignored signals of its parent. Shells start background processes with SIGINT
ignored, and so do many CI systems. Python then installs no handler (`signal`: "SIGINT is translated
into a KeyboardInterrupt exception if the parent process has not changed it"), and Ctrl-C and
`kill -INT` do nothing. Every process that must clean up therefore installs its own handlers.
"""

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from types import FrameType
from typing import Any

import structlog

log = structlog.stdlib.get_logger(__name__)
PR_SET_PDEATHSIG = 1  # <linux/prctl.h>
END_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def interrupted_by_signals() -> AbstractContextManager[None]:
    """Let the first SIGINT or SIGTERM raise KeyboardInterrupt inside, and ignore later ones. For
    the main thread.

    A second Ctrl-C thus cannot interrupt the clean-up and leave processes running; the clean-up
    must therefore have time limits.
    """
    return _handled_by(_interrupt)


def ended_by_signals() -> AbstractContextManager[None]:
    """Let SIGINT and SIGTERM end the process at once, without clean-up. For the main thread."""
    return _handled_by(signal.SIG_DFL)


@contextlib.contextmanager
def _handled_by(
    handler: Callable[[int, FrameType | None], None] | signal.Handlers,
) -> Iterator[None]:
    before = {number: signal.signal(number, handler) for number in END_SIGNALS}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier or signal.SIG_DFL)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    ignore_end_signals()
    raise KeyboardInterrupt


def ignore_end_signals() -> None:
    """Ignore SIGINT and SIGTERM, because this process is ending."""
    for number in END_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def tied_to_parent() -> Callable[[], None] | None:
    """Return the `preexec_fn` of a child that receives SIGTERM when its parent dies, and does not
    ignore SIGINT and SIGTERM. None where `preexec_fn` is not supported.

    Only Linux signals the child (prctl(2), PR_SET_PDEATHSIG): elsewhere, the children of a killed
    parent stay. The parent is the *thread* that starts the child, which must live as long as the
    process.
    """
    if os.name != "posix":
        return None
    if sys.platform != "linux":
        return _accept_end_signals
    # Loaded before the fork: after it, this could wait for another thread's lock for ever.
    prctl, parent = ctypes.CDLL(None).prctl, os.getpid()

    def tie() -> None:
        _accept_end_signals()
        prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:  # it died before the line above, so no signal will come
            os.kill(os.getpid(), signal.SIGKILL)

    return tie


def _accept_end_signals() -> None:
    for number in END_SIGNALS:
        signal.signal(number, signal.SIG_DFL)


def wait_or_kill(child: subprocess.Popen[Any], within: float) -> None:
    """Wait `within` seconds for a child that is ending, then kill it."""
    try:
        child.wait(within)
    except subprocess.TimeoutExpired:
        log.warning("child_killed", pid=child.pid)
        child.kill()
        child.wait()
