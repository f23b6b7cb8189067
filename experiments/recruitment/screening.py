"""Who may take part in a study: by device and browser on arrival, by answers as soon as a
questionnaire is finished.
"""

from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any

from django.db.models import Q

from experiments.definition.recruitment.recruiting import AnswerQuota, admits, names_answer
from experiments.definition.schema import StudyDefinition
from experiments.definition.step import AskingStep
from experiments.models import Participant, ParticipantKind, StepResponse

Status = Participant.Status
FIRST = Q(visit=1, round=0)  # of several answers to a questionnaire, those that are judged


def device_kind(device: Mapping[str, Any]) -> str:
    """Return the kind of a device (sessions.devices.device_of): computer, tablet or phone. An iPad
    whose browser asks for desktop pages says that it is a Mac and counts as a computer.
    """
    if "iPad" in device["user_agent"] or (device["os"] == "Android" and not device["mobile"]):
        return "tablet"
    return "phone" if device["mobile"] else "computer"


def has_device(study: StudyDefinition, device: Mapping[str, Any]) -> bool:
    browser = device["product"].rpartition(" ")[0]
    fits = not study.devices or device_kind(device) in study.devices
    return fits and (not study.browsers or browser in study.browsers)


def is_screened_out(participant: Participant, step: AskingStep, now: datetime) -> bool:
    """Tell whether a participant's answers at a step that is done screen them out: by a rule, or
    because a quota is full. Only the first answers are judged: of the first visit and round, before
    the task. Bots answer at random and are never screened out.
    """
    definition, questionnaire = participant.study.as_definition(), step.questionnaire
    rules = [one for one in definition.screening if one.questionnaire == questionnaire]
    quotas = [one for one in definition.answer_quotas if one.questionnaire == questionnaire]
    is_first = (participant.visit, participant.round) == (1, 0)
    is_judged = is_first and definition.screening_steps.get(questionnaire) == step
    if participant.kind == ParticipantKind.BOT or not is_judged or not (rules or quotas):
        return False
    finished = StepResponse.objects.filter(FIRST, response__finished_at__isnull=False)
    own = finished.filter(participant=participant, step=step.key)
    asked = own.select_related("response__questionnaire").first()
    if asked is None:
        return False
    values = {item: given.value for item, given in asked.response.given().items()}
    if not all(admits(rule, values.get(rule.item)) for rule in rules):
        return True
    return any(
        names_answer(quota.answers, values.get(quota.item))
        and _earlier(participant, quota, asked, now) >= quota.most
        for quota in quotas
    )


def newest_finished(participant: Participant, questionnaire: str) -> StepResponse | None:
    """Return a participant's newest finished response to a questionnaire; None without one."""
    rows = StepResponse.objects.filter(participant=participant)
    own = rows.filter(response__questionnaire__slug=questionnaire)
    finished = own.exclude(response__finished_at=None).order_by("-response__finished_at")
    return finished.select_related("response__questionnaire").first()


def _earlier(participant: Participant, quota: AnswerQuota, own: StepResponse, now: datetime) -> int:
    """Count the participants who gave such an answer before this one and hold a place: they have
    finished, or were seen lately. The id breaks ties of the time, so that of two participants
    exactly one is the later.
    """
    study, own_order = participant.study, (own.response.finished_at, str(own.response_id))
    last_seen = now - timedelta(hours=study.as_definition().allocation.left_after_hours)
    rows = StepResponse.objects.filter(
        FIRST,
        step=own.step,
        participant__study=study,
        participant__kind=participant.kind,
        participant__status__in=(Status.ACTIVE, Status.FINISHED),
        response__finished_at__isnull=False,
        response__answers__item=quota.item,
    ).exclude(participant=participant)
    columns = (
        *("participant_id", "participant__status", "participant__seen_at"),
        *("response__finished_at", "response_id", "response__answers__value"),
    )
    holders = {
        holder
        for holder, status, seen, at, key, value in rows.values_list(*columns)
        if (status == Status.FINISHED or seen >= last_seen)
        and value is not None
        and names_answer(quota.answers, value)
        and (at, str(key)) < own_order
    }
    return len(holders)
