"""How our processes end: on SIGINT and SIGTERM, and children with their parent.

A process inherits which signals are ignored. A shell starts what it runs in the background with
SIGINT ignored, and so do many CI systems; Python then installs no handler of its own (`signal`:
"SIGINT is translated into a KeyboardInterrupt exception if the parent process has not changed it"),
so that Ctrl-C and `kill -INT` do nothing. Every process with an end of its own installs its
handlers.
"""

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from types import FrameType

PR_SET_PDEATHSIG = 1  # <linux/prctl.h>
END_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def interrupted_by_signals() -> AbstractContextManager[None]:
    """Let the first SIGINT or SIGTERM raise KeyboardInterrupt inside, and ignore those that follow.
    For the main thread alone.

    A second Ctrl-C thus cannot interrupt the clean-up that the first one began, and leave processes
    behind; the clean-up must therefore have time limits.
    """
    return _handled_by(_interrupt)


def ended_by_signals() -> AbstractContextManager[None]:
    """Let SIGINT and SIGTERM end the process at once inside, which has nothing to clean up. For the
    main thread alone.
    """
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
    """Let SIGINT and SIGTERM do nothing any more: this process is ending."""
    for number in END_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def tied_to_parent() -> Callable[[], None] | None:
    """Return the `preexec_fn` of a child that receives SIGTERM when its parent dies, and that does
    not ignore SIGINT and SIGTERM. None where there is no `preexec_fn`.

    Only Linux signals the child (prctl(2), PR_SET_PDEATHSIG): elsewhere a parent that is killed
    leaves its children. The parent is the *thread* that starts the child, so start it from one that
    lives as long as the process.
    """
    if os.name != "posix":
        return None
    if sys.platform != "linux":
        return _accept_end_signals
    # Found before the fork: to load a library between fork and exec may wait for ever for another
    # thread's lock.
    prctl, parent = ctypes.CDLL(None).prctl, os.getpid()

    def tie() -> None:
        _accept_end_signals()
        prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:  # it died before the line above, and will not die again
            os.kill(os.getpid(), signal.SIGKILL)

    return tie


def _accept_end_signals() -> None:
    for number in END_SIGNALS:
        signal.signal(number, signal.SIG_DFL)
