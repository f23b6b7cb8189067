"""Participants and the pages that they went through, as rows of a dataset."""

import datetime
from collections.abc import Iterable, Mapping

from experiments.analysis.dataset.levels import TURNED_AWAY, WITHDREW
from experiments.analysis.dataset.records import PageRecord, ParticipantRecord
from experiments.models import SCREENED_OUT, Drive, StepVisit, Study
from experiments.models import Participant as Row

NAN = float("nan")
LEFT = {Row.Status.SCREENED_OUT: TURNED_AWAY, Row.Status.WITHDRAWN: WITHDREW}
# after these a participant goes on by themself
NO_REASON = frozenset({"", "completed", "timed_out"})
Round = tuple[object, int, int]  # participant, visit and round


def participants_of(study: Study, drives: Iterable[Drive]) -> list[ParticipantRecord]:
    """Return everybody who came, by code; whoever withdrew is a row with the step at which that
    was.
    """
    begun = dict(
        StepVisit.objects.filter(participant__study=study)
        .order_by("began_at")
        .values_list("participant_id", "step")
    )
    outcomes = {drive.participant_id: drive.outcome or drive.session.outcome for drive in drives}
    rows = Row.objects.filter(study=study).order_by("code")
    return [_participant(row, begun.get(row.pk, ""), outcomes.get(row.pk, "")) for row in rows]


def _participant(row: Row, begun: str, outcome: str) -> ParticipantRecord:
    withdrawn = row.status == Row.Status.WITHDRAWN
    turned_away = row.completion == SCREENED_OUT  # whoever comes again has finished all the same
    lost = outcome if row.status == Row.Status.ACTIVE and outcome not in NO_REASON else ""
    return ParticipantRecord(
        row.code,
        kind=row.kind,
        age=NAN if row.age is None or withdrawn else float(row.age),
        cell=row.cell,
        place=row.stage,
        reached=row.withdrawn_step or row.step or begun,
        left=LEFT.get(row.status, lost),
        finished=bool(row.completion) and not turned_away,
        withdrawn=withdrawn,
    )


def pages_of(study: Study, sessions: Mapping[Round, str]) -> list[PageRecord]:
    """Return every page that was seen, by participant and in order; `sessions` has the code of each
    round's drive.
    """
    visits = StepVisit.objects.filter(participant__study=study).exclude(
        participant__status=Row.Status.WITHDRAWN
    )
    columns = (
        "participant_id",
        "participant__code",
        "visit",
        "round",
        "step",
        "began_at",
        "finished_at",
    )
    found = visits.order_by("participant__code", "began_at", "id").values_list(*columns)
    definition = study.as_definition()
    own = {step.key for step in definition.steps if step.repeat or step == definition.task}
    return [
        PageRecord(
            code,
            step,
            sessions.get((who, visit, turn), "") if step in own else "",
            _seconds(began, ended),
            finished=ended is not None,
        )
        for who, code, visit, turn, step, began, ended in found
    ]


def _seconds(began: datetime.datetime, ended: datetime.datetime | None) -> float:
    return NAN if ended is None else round((ended - began).total_seconds(), 6)
