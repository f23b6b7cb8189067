"""Participants and the pages that they went through, as rows of a dataset."""

import datetime
from bisect import bisect_right
from collections.abc import Iterable, Mapping

from django.db.models import Q, QuerySet

from experiments.dataset.levels import AGE_BANDS, AGE_LIMITS, TURNED_AWAY, WITHDREW
from experiments.dataset.records import PageRecord, ParticipantRecord
from experiments.definition.schema import StudyDefinition
from experiments.extraction.selection import Selection
from experiments.extraction.stages import stages_of
from experiments.models import SCREENED_OUT, ConsentReceipt, Draw, Drive, StepVisit, Study
from experiments.models import Participant as Row

NAN = float("nan")
LEFT = {Row.Status.SCREENED_OUT: TURNED_AWAY, Row.Status.WITHDRAWN: WITHDREW}
# after these a participant goes on by themself
NO_REASON = frozenset({"", "completed", "timed_out"})
Round = tuple[object, int, int]  # participant, visit and round


def people_of(study: Study, choice: Selection) -> "QuerySet[Row]":
    """Return everybody who is in a dataset; in a public one, where the consent asks for it, those
    who agreed to publishing, and the rows without a person of those who withdrew.
    """
    rows = Row.objects.filter(study=study).order_by("code")
    if not (choice.public and asks_for_sharing(study.as_definition())):
        return rows
    agreed = ConsentReceipt.objects.filter(participant__study=study, sharing=True)
    keys = list(agreed.values_list("participant_id", flat=True))
    return rows.filter(Q(pk__in=keys) | Q(status=Row.Status.WITHDRAWN))


def asks_for_sharing(study: StudyDefinition) -> bool:
    return study.consent is not None and any(study.consent.sharing.values())


def participants_of(
    study: Study, drives: Iterable[Drive], choice: Selection
) -> list[ParticipantRecord]:
    """Return everybody who came, by code; of participants who withdrew only what is kept."""
    begun = dict(
        StepVisit.objects.filter(participant__study=study)
        .order_by("began_at")
        .values_list("participant_id", "step")
    )
    outcomes = {drive.participant_id: drive.outcome or drive.session.outcome for drive in drives}
    first_cells = dict(
        Draw.objects.filter(study=study, nth=1).values_list("participant_id", "cell")
    )
    rows = list(people_of(study, choice))
    stages = stages_of(study, rows)
    return [
        _participant(
            row,
            begun.get(row.pk, ""),
            outcomes.get(row.pk, ""),
            first_cells.get(row.pk, ""),
            stages[row.pk],
            is_exact=not choice.public,
        )
        for row in rows
    ]


def _participant(
    row: Row, begun: str, outcome: str, first_cell: str, stage: str, *, is_exact: bool
) -> ParticipantRecord:
    withdrawn = row.status == Row.Status.WITHDRAWN
    turned_away = row.completion == SCREENED_OUT  # whoever comes again has finished all the same
    lost = outcome if row.status == Row.Status.ACTIVE and outcome not in NO_REASON else ""
    age = None if withdrawn else row.age
    return ParticipantRecord(
        row.code,
        kind=row.kind,
        age=float(age) if age is not None and is_exact else NAN,
        age_band=age_band(age),
        cell=row.cell,
        first_cell=first_cell or row.cell,
        draws=row.draws_applied,
        stage=stage,
        place=row.stage,
        reached=row.withdrawn_step or row.step or begun,
        left=LEFT.get(row.status, lost),
        finished=bool(row.completion) and not turned_away,
        withdrawn=withdrawn,
    )


def age_band(age: int | None) -> str:
    """Return the range of an age in years; empty when it is unknown."""
    return "" if age is None else tuple(AGE_BANDS)[bisect_right(AGE_LIMITS, age)]


def pages_of(study: Study, sessions: Mapping[Round, str], choice: Selection) -> list[PageRecord]:
    """Return every page that was seen, by participant and in order; `sessions` has the code of each
    round's drive.
    """
    visits = StepVisit.objects.filter(participant__in=people_of(study, choice)).exclude(
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
