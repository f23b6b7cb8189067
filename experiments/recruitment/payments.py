"""The table of a study's participants by recruitment id, from which researchers pay them."""

import datetime
from collections.abc import Iterator, Sequence
from typing import Any

from experiments.models import LEFT, Participant, ParticipantKind, Study
from experiments.recruitment.recognition import arrival_of

HEAD = (
    *("id", "submission", "participant", "version", "status", "outcome", "code"),
    *("started", "finished", "minutes", "flags"),
)


def payment_rows(study: Study) -> Iterator[Sequence[Any]]:
    """Yield the table of all versions, head first. Those who withdrew are lines without id and
    times: what they got stays due, and the recruitment site knows who entered their code.
    """
    # with NumPy, which pages about other things need not load
    from experiments.recruitment.quality import flag_cells  # noqa: PLC0415

    yield HEAD
    for version in Study.objects.filter(slug=study.slug).order_by("version"):
        people = version.participants.filter(kind=ParticipantKind.PARTICIPANT)
        rows = list(people.exclude(status=Participant.Status.WITHDRAWN).order_by("created_at"))
        flags = flag_cells(version) if rows else {}
        yield from (_row(one, version, flags.get(one.code, "")) for one in rows)
        for one in people.filter(status=Participant.Status.WITHDRAWN).order_by("withdrawn_at"):
            ending = (one.status, one.completion or LEFT, one.completion_code)
            yield ("", "", "", version.version, *ending, "", "", None, "")


def _row(one: Participant, study: Study, flags: str) -> Sequence[Any]:
    submission, minutes = arrival_of(study, one.recruitment).session, minutes_of(one)
    ending = (one.status, one.completion, one.completion_code)
    times = (_iso(one.created_at), _iso(one.finished_at), minutes)
    return (one.recruitment_id, submission, one.code, study.version, *ending, *times, flags)


def minutes_of(one: Participant) -> float | None:
    """Return the minutes between joining and the end; None without an end."""
    if one.finished_at is None:
        return None
    return round((one.finished_at - one.created_at).total_seconds() / 60.0, 1)


def _iso(at: datetime.datetime | None) -> str:
    return "" if at is None else at.isoformat(timespec="seconds")
