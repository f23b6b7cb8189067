"""Bounds the exit of a web process that is answering requests.

A request's thread passes asynchronous work to the event loop and waits for it. After the loop has
stopped, the thread would wait for ever, and Python at its exit for the thread. Databases roll back
what such a thread has not committed.
"""

import logging
import os
import sys
import threading
import time

EXIT_SECONDS = 3.0  # in which threads can still end


def bound_exit() -> None:
    """End this process EXIT_SECONDS after its reactor. Without daphne, do nothing."""
    if "daphne.server" not in sys.modules:  # it installs the reactor
        return
    from twisted.internet import reactor  # noqa: PLC0415 -- an import would install another one

    reactor.addSystemEventTrigger("after", "shutdown", _exit_soon)  # type: ignore[attr-defined]


def _exit_soon() -> None:
    threading.Thread(target=_exit, daemon=True).start()


def _exit() -> None:
    time.sleep(EXIT_SECONDS)
    logging.shutdown()
    os._exit(0)
