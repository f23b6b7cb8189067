"""Log lines are written in a thread of their own, which may be held up."""

import logging
import threading
import time

import pytest

from robots.process.logs import LINES_OF_EVENT, LogEvent, ThreadedHandler


class StuckHandler(logging.Handler):
    """Writes nothing until `resume` is set, as a terminal after Ctrl-S."""

    def __init__(self):
        super().__init__()
        self.resume, self.lines = threading.Event(), []

    def emit(self, record):
        self.resume.wait()
        self.lines.append(record.getMessage())


@pytest.fixture
def log():
    logger = logging.getLogger("of a test")
    logger.setLevel(logging.INFO)
    logger.propagate = False
    yield logger
    logger.handlers.clear()


def test_a_blocked_terminal_does_not_block_logging(log):
    stuck = StuckHandler()
    log.addHandler(ThreadedHandler([stuck], most=100))
    began = time.monotonic()
    for number in range(5000):
        log.info(f"line {number}")
    assert time.monotonic() - began < 2.0
    assert stuck.lines == []
    stuck.resume.set()


def test_lines_that_find_no_room_are_counted(log, caplog):
    stuck = StuckHandler()
    handler = ThreadedHandler([stuck], most=100)
    log.addHandler(handler)
    for number in range(151):
        log.info(f"line {number}")
    stuck.resume.set()
    handler.flush()
    kept = len(stuck.lines)
    # the thread may take its one line, and make room for another, at any time
    assert stuck.lines[:100] == [f"line {number}" for number in range(100)]
    assert kept in {100, 101}, "one is in the thread's hands"
    log.info("later")
    handler.flush()
    assert f"lines_dropped count={151 - kept}" in caplog.text


@pytest.mark.slow
def test_flush_does_not_wait_for_ever(log):
    stuck = StuckHandler()
    handler = ThreadedHandler([stuck])
    log.addHandler(handler)
    log.info("line")
    began = time.monotonic()
    handler.flush()
    assert 0.5 < time.monotonic() - began < 5.0
    stuck.resume.set()


def test_a_handler_gets_only_lines_of_its_level(log):
    quiet = StuckHandler()
    quiet.setLevel(logging.ERROR)
    quiet.resume.set()
    handler = ThreadedHandler([quiet])
    log.addHandler(handler)
    log.info("small")
    log.error("large")
    handler.flush()
    assert quiet.lines == ["large"]


def test_an_event_that_happens_often_leaves_room_in_the_log_for_others(log, monkeypatch):
    monkeypatch.setattr(time, "time", lambda: 1_000_000_020.0)
    written = StuckHandler()
    written.resume.set()
    handler = ThreadedHandler([written])
    log.addHandler(handler)
    for number in range(1000):
        log.warning(LogEvent(event="offer_unusable", peer=number))
    log.warning(LogEvent(event="message_failed"))
    for _ in range(100):
        log.critical("thread_failed")
    handler.flush()
    assert len([line for line in written.lines if "offer_unusable" in line]) == LINES_OF_EVENT
    assert "message_failed" in written.lines
    assert written.lines.count("thread_failed") == 100
    monkeypatch.setattr(time, "time", lambda: 1_000_000_090.0)
    log.warning(LogEvent(event="offer_unusable", peer=1000))
    handler.flush()
    assert written.lines[-1] == "offer_unusable peer=1000", "a minute later it is written again"
