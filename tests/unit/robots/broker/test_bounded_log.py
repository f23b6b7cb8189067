"""A log that nobody can fill."""

import logging
from functools import partial
from types import SimpleNamespace

from robots.broker.bounded_log import LINES_OF_EVENT, LINES_OF_SUBJECT, PERIOD_S, BoundedLog
from robots.logs import LogEvent


class Journal:
    """A bounded log, its lines and its clock."""

    def __init__(self):
        self.now, self.lines = 0.0, []
        logger = SimpleNamespace(log=self._log, warning=partial(self._log, logging.WARNING))
        self.bounded = BoundedLog(logger, clock=lambda: self.now)

    def _log(self, _level, event, **fields):
        self.lines.append(str(LogEvent(event=event, **fields)))

    def note(self, event, subject):
        self.bounded.write(logging.WARNING, subject, event, user=subject)


def test_of_one_event_about_one_user_a_few_lines_are_written_and_those_about_others_still_are():
    journal = Journal()
    for _ in range(10_000):
        journal.note("broker_publish_refused", "hostile")
    journal.note("broker_publish_refused", "giraff")
    journal.note("broker_will_refused", "hostile")
    assert journal.lines == ["broker_publish_refused user=hostile"] * LINES_OF_SUBJECT + [
        "broker_publish_refused user=giraff",
        "broker_will_refused user=hostile",
    ]


def test_one_event_about_ever_others_is_bounded_too_and_nothing_is_kept_of_each():
    journal = Journal()
    for number in range(10_000):
        journal.note("broker_password_refused", f"10.0.{number // 256}.{number % 256}")
    assert len(journal.lines) == LINES_OF_EVENT
    assert len(journal.bounded._lines) <= LINES_OF_EVENT + 1 + LINES_OF_EVENT


def test_how_many_were_left_out_is_said_after_each_period_also_when_nobody_writes_any_more():
    journal = Journal()
    for period in range(2):
        for _ in range(100):
            journal.note("broker_publish_refused", "hostile")
        journal.now += PERIOD_S
        journal.bounded.flush()
        journal.bounded.flush()
        assert journal.lines[(LINES_OF_SUBJECT + 1) * period :] == [
            *["broker_publish_refused user=hostile"] * LINES_OF_SUBJECT,
            (
                f"broker_log_left_out what=broker_publish_refused lines={100 - LINES_OF_SUBJECT}"
                " seconds=60"
            ),
        ]


def test_where_nothing_was_left_out_nothing_is_said():
    journal = Journal()
    journal.note("broker_publish_refused", "giraff")
    journal.now += PERIOD_S
    journal.bounded.flush()
    assert journal.lines == ["broker_publish_refused user=giraff"]
