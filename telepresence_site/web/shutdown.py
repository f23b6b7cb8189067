"""A web process that is told to end ends, also while it answers requests.

A request's thread hands asynchronous work to the event loop and waits for it. Once the loop has
stopped nobody does that work, the thread waits for ever, and Python waits for the thread at its
exit. Databases roll back what such a thread has not committed.
"""

import logging
import os
import sys
import threading
import time

EXIT_SECONDS = 3.0  # for threads that are still able to end


def bound_exit() -> None:
    """Have this process end soon after its reactor. Without daphne, do nothing."""
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
