"""A provider of terms that answers what a test has set."""

import contextlib
from collections.abc import Iterator
from typing import Any

from sessions.leases import terms


class FixedTerms:
    """`terms` are given to every visit, `reason` is against every visit, `lacks` has them wait,
    `refusal` ends it when it is granted; `asked` counts grants. Users who are called as one of the
    `watchers` may watch a private visit.
    """

    def __init__(self) -> None:
        self.terms: terms.Terms | None = None
        self.reason = self.refusal = self.lacks = ""
        self.task: dict[str, Any] = {}
        self.asked = 0
        self.watchers: frozenset[str] = frozenset()

    def why_not(self, _user, _robot, _now) -> str:
        return self.reason

    def not_ready(self, _user, _robot, _now) -> str:
        return self.lacks

    def granted(self, _session, _now) -> terms.Terms | None:
        self.asked += 1
        if self.refusal:
            raise terms.NotGranted(self.refusal)
        return self.terms

    def claims(self, _user, _robot) -> bool:
        return self.terms is not None

    def may_watch(self, user, _session) -> bool:
        return user.username in self.watchers

    def shown(self, _session) -> dict[str, Any]:
        return self.task


@contextlib.contextmanager
def provided() -> Iterator[FixedTerms]:
    """The one provider that is asked, for as long as the test lasts."""
    before, double = terms._providers[:], FixedTerms()
    terms._providers[:] = [double]
    try:
        yield double
    finally:
        terms._providers[:] = before
