"""Participants and the pages that they went through, as rows of a dataset."""

import math
from bisect import bisect_right
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from django.db.models import Q, QuerySet

from experiments.dataset.levels import AGE_BANDS, AGE_LIMITS, TURNED_AWAY, WITHDREW
from experiments.dataset.records import PageRecord, ParticipantRecord
from experiments.definition.factors import steps_about_drive
from experiments.definition.schema import StudyDefinition
from experiments.extraction.selection import Selection
from experiments.models import (
    SCREENED_OUT,
    ConsentReceipt,
    Draw,
    Drive,
    Participant as Row,
    ParticipantKind,
    StepResponse,
    StepVisit,
    Study,
)

LEFT_BY_STATUS = {Row.Status.SCREENED_OUT: TURNED_AWAY, Row.Status.WITHDRAWN: WITHDREW}
# Outcomes of the last drive after which the study goes on, so that they are no reason for leaving.
# Practice is voluntary, and its participants end it themselves.
NO_REASON_TO_LEAVE = frozenset({"", "completed", "timed_out"})
NONE_AFTER_PRACTICE = NO_REASON_TO_LEAVE | {"cancelled"}
Round = tuple[object, int, int]  # participant, visit and round
# the page showed the robot's video; before a drive is settled, also: the robot moved
EXPOSED = Q(exposed_at__isnull=False) | Q(session__first_motion_at__isnull=False)


def people_of(study: Study, choice: Selection) -> "QuerySet[Row]":
    """Return the participants in a dataset; in a public one those who did not withdraw and, where
    the consent asks for it, agreed to publishing.
    """
    rows = Row.objects.filter(study=study).order_by("code")
    if choice.public:
        rows = rows.exclude(status=Row.Status.WITHDRAWN)
    if not (choice.public and asks_for_sharing(study.as_definition())):
        return rows
    receipts = ConsentReceipt.objects.filter(participant__study=study).order_by("agreed_at")
    newest = dict(receipts.values_list("participant_id", "sharing"))
    agreed = [key for key, shares in newest.items() if shares]
    return rows.filter(pk__in=agreed)


def numbers_of_public(study: Study) -> tuple[int, int]:
    """Return how many participants, pilots and bots aside, a public dataset has, and how many one
    of everybody; those who withdrew are in neither.
    """
    everybody = Row.objects.filter(kind=ParticipantKind.PARTICIPANT)
    everybody = everybody.exclude(status=Row.Status.WITHDRAWN)
    kinds = (people_of(study, Selection(public=public)) for public in (True, False))
    public, whole = ((rows & everybody).count() for rows in kinds)
    return public, whole


def asks_for_sharing(study: StudyDefinition) -> bool:
    return study.consent is not None and any(study.consent.sharing.values())


def participants_of(
    study: Study, drives: Iterable[Drive], choice: Selection
) -> list[ParticipantRecord]:
    """Return all participants, by code; those who withdrew have only the fields that are kept."""
    visits = StepVisit.objects.filter(participant__study=study).order_by("began_at")
    begun = dict(visits.values_list("participant_id", "step"))
    practice = study.as_definition().practice_keys
    reasons = {drive.participant_id: _reason_to_leave(drive, practice) for drive in drives}
    first_draws = Draw.objects.filter(study=study, nth=1)
    first_cells = dict(first_draws.values_list("participant_id", "cell"))
    rows = list(people_of(study, choice))
    stages = stages_of(study, rows)
    found = []
    for row in rows:
        withdrawn = row.status == Row.Status.WITHDRAWN
        reason = reasons.get(row.pk, "") if row.status == Row.Status.ACTIVE else ""
        age = None if withdrawn else row.age
        participant = ParticipantRecord(
            row.code,
            kind=row.kind,
            age=math.nan if age is None or choice.public else float(age),
            age_band="" if age is None else tuple(AGE_BANDS)[bisect_right(AGE_LIMITS, age)],
            cell=row.cell,
            first_cell=first_cells.get(row.pk) or row.cell,
            draws=row.draws_applied,
            stage=stages[row.pk],
            place=row.stage,
            reached=row.withdrawn_step or row.step or begun.get(row.pk, ""),
            left=LEFT_BY_STATUS.get(row.status, reason),
            finished=row.completion not in {"", SCREENED_OUT},
            withdrawn=withdrawn,
        )
        found.append(participant)
    return found


def _reason_to_leave(drive: Drive, practice: Collection[str]) -> str:
    """Return the outcome of a participant's last drive, if it may be why they left."""
    outcome = drive.outcome or drive.session.outcome
    none = NONE_AFTER_PRACTICE if drive.step in practice else NO_REASON_TO_LEAVE
    return "" if outcome in none else outcome


def stages_of(study: Study, rows: Iterable[Row]) -> dict[Any, str]:
    """Return the last stage that each participant reached (experiments.dataset.levels STAGES), by
    key; for those who withdrew, the stage at that time.

    `drove` needs a drive of the task in which the robot moved for them, `ended` the outcome of such
    a drive, and `answered` also a finished response to the questionnaire of the study's table.
    """
    rows, definition = list(rows), study.as_definition()
    own = Q(participant__in=[row.pk for row in rows])
    seen = Drive.objects.filter(own & EXPOSED).exclude(step__in=definition.practice_keys)
    exposed, drove, ended = set(), set(), set()
    needed = ("participant", "moved", "outcome", "session__outcome", "session__first_motion_at")
    for drive in seen.select_related("session").only(*needed):
        exposed.add(drive.participant_id)
        if drive.has_moved:
            drove.add(drive.participant_id)
            ended.update([drive.participant_id] if drive.outcome or drive.session.outcome else [])
    responses = StepResponse.objects.filter(own, response__finished_at__isnull=False)
    step = definition.asked.get(definition.statements)
    asked = responses.filter(step=step.key if step is not None else "")
    answered = set(asked.values_list("participant_id", flat=True))

    def stage(row: Row) -> str:
        if row.withdrawn_stage:
            return str(row.withdrawn_stage)
        if row.pk not in exposed:
            return "assigned" if row.cell else "arrived"
        if row.pk not in ended:
            return "drove" if row.pk in drove else "exposed"
        return "answered" if row.pk in answered else "ended"

    return {row.pk: stage(row) for row in rows}


def pages_of(study: Study, sessions: Mapping[Round, str], choice: Selection) -> list[PageRecord]:
    """Return the displayed pages in order; `sessions` has the code of each round's drive."""
    visits = StepVisit.objects.filter(participant__in=people_of(study, choice))
    rows = visits.exclude(participant__status=Row.Status.WITHDRAWN).select_related("participant")
    own = steps_about_drive(study.as_definition())
    found = []
    for row in rows.order_by("participant__code", "began_at", "id"):
        place = (row.participant_id, row.visit, row.round)
        ended, code = row.finished_at, row.participant.code
        taken = math.nan if ended is None else round((ended - row.began_at).total_seconds(), 6)
        session = sessions.get(place, "") if row.step in own else ""
        found.append(PageRecord(code, row.step, session, taken, finished=ended is not None))
    return found
