"""The agreement of a study's coders on the sessions that several of them have finished."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from typing import Any

from experiments.coding import store
from experiments.coding.agreement import Reliability, SessionCodings, reliability
from experiments.models import Coding, CodingSchemeVersion
from sessions.models import Session


@dataclass(frozen=True)
class StudyAgreement:
    """`coders` are the numbers of the coders, by the places that `found` has; `sessions` is how
    many were compared, and `waiting` how many are still being coded.
    """

    coders: tuple[int, ...]
    sessions: int
    waiting: int
    found: Reliability


def agreement_of(scheme: CodingSchemeVersion, only: Any = None) -> StudyAgreement:
    """Return the agreement by one scheme; with a user as `only`, on this coder's sessions."""
    every = groupby(store.released(scheme), attrgetter("session"))  # ordered by session
    sessions = [
        (session, codings)
        for session, codings in ((session, list(codings)) for session, codings in every)
        if len(codings) > 1 and (only is None or only.pk in [one.coder_id for one in codings])
    ]
    numbers = sorted({coding.number for _session, codings in sessions for coding in codings})
    definition = store.read_scheme(scheme)
    waiting = Coding.objects.filter(scheme=scheme, done_at=None).values_list("session", flat=True)
    parts = [_codings(session, codings, numbers) for session, codings in sessions]
    codes, tolerance = [code.code for code in definition.codes], definition.tolerance
    reliabilities = reliability(parts, codes, width=definition.bin, tolerance=tolerance)
    return StudyAgreement(tuple(numbers), len(sessions), len(set(waiting)), reliabilities)


def _codings(session: Session, codings: Sequence[Coding], numbers: Sequence[int]) -> SessionCodings:
    """Return a session's duration, to its end or the last event, with each coder's events."""
    events = {coding.number: store.events_of(coding) for coding in codings}
    begin, end = session.granted_at or session.queued_at, session.ended_at
    ended = (end - begin).total_seconds() if end is not None else 0.0
    last = [one.end or one.begin for some in events.values() for one in some]
    return max([ended, *last]), [events.get(number) for number in numbers]
