"""Enrolment and a participant's current step; advance.py moves them on.

A place is changed only if it is still the one that was read, and a user has one row a study
(`Participant.slot`), so that a reload, the back button, a second tab or another device does nothing
twice. Nothing relies on transactions.
"""

import datetime
from collections.abc import Mapping
from dataclasses import asdict
from itertools import islice
from typing import Any

from django.db import IntegrityError, transaction
from django.db.models import Q, QuerySet

from experiments.access import role_of
from experiments.definition import opening_hours
from experiments.definition.schema import Condition, StudyDefinition
from experiments.definition.step import Step
from experiments.models import SCREENED_OUT, Participant, ParticipantKind, StepVisit, Study
from experiments.participation import assignment, completion, journey, places
from experiments.participation.assignment import Access
from experiments.participation.journey import JourneyPlace
from experiments.recruitment import appointments, recognition
from surveys.documents import spoken

Status = Participant.Status
MAX_PARAMETERS, MAX_PARAMETER_LENGTH = 10, 100


def visible_studies(now: datetime.datetime) -> list[Study]:
    """Return the studies with an open link: those that are open now first, then the newest."""
    entries = (Study.Entry.OPEN, Study.Entry.CODE)
    found = Study.objects.filter(status=Study.Status.PUBLISHED, entry__in=entries)
    return sorted(found.order_by("-published_at"), key=lambda study: not is_open(study, now))


def is_open(study: Study, now: datetime.datetime) -> bool:
    return study.status != Study.Status.CLOSED and opening_hours.is_open(
        study.opening_hours, study.time_zone, now
    )


def may_begin_drive(participant: Participant, now: datetime.datetime) -> bool:
    return is_open(participant.study, now) and appointments.may_drive(participant, now)


def is_member(user: Any, slug: str) -> bool:
    """Tell whether a user does research in a study; their participation never counts."""
    return role_of(user, slug) not in {None, "wizard"}


def study_for(user: Any, slug: str) -> Study | None:
    """Return the version of a study for a user: the one in which they take part; for researchers
    the newest; for all others the published one, else the newest closed one.
    """
    versions = Study.objects.filter(slug=slug).order_by("-version")
    own = _continued(user, slug)
    if own is not None and own.kind != ParticipantKind.PILOT:
        return own.study
    if is_member(user, slug):
        return versions.first()
    return (
        versions.filter(status=Study.Status.PUBLISHED).first()
        or versions.filter(status=Study.Status.CLOSED).first()
    )


def _continued(user: Any, slug: str) -> Participant | None:
    if not user.is_authenticated:
        return None
    # a bot returns to the version that it was made for, even a draft; and an id of a recruitment
    # site takes part in one version only
    continues = Q(status=Status.ACTIVE) | Q(kind=ParticipantKind.BOT) | ~Q(recruitment_id="")
    own = Participant.objects.filter(continues, user=user, study__slug=slug).select_related("study")
    return own.order_by("-created_at").first()


def found(study: Study, user: Any) -> Participant | None:
    if not user.is_authenticated:
        return None
    rows = Participant.objects.select_related("study", "user")
    return rows.filter(slot=_slot(study, user)).first()


def _slot(study: Study, user: Any) -> str:
    return f"{study.pk}:{user.pk}"


def enter(
    study: Study,
    user: Any,
    *,
    access: Access,
    recruitment: Mapping[str, str],
    kind: str = ParticipantKind.PARTICIPANT,
    language: str = "",
    now: datetime.datetime,
) -> Participant:
    """Return a user's row in a study, made at the first call; a second call only raises the access
    before assignment. An id of a recruitment site that another user has in this study leads to the
    row of that user.
    """
    definition = study.as_definition()
    start = journey.begin(journey.route(definition, journey.rounds(definition, access), 1))
    fields = {
        "access": access,
        "recruitment": kept_parameters(recruitment),
        **recognition.fields(study, recruitment, kind),
        "kind": kind,
        "language": language_of(definition, language),
        **asdict(start),
        "created_at": now,
        "seen_at": now,
        "user": user,
    }
    slot = _slot(study, user)
    try:
        with transaction.atomic():
            Participant.objects.create(study=study, slot=slot, **fields)
    except IntegrityError:
        if access == "invitation":
            Participant.objects.filter(slot=slot, cell="", access="open").update(access=access)
    participant = found(study, user)
    if participant is None:  # another user has the id of a recruitment site
        rows = Participant.objects.select_related("study", "user")
        return rows.get(recruited_as=fields["recruited_as"])
    see(participant, now)
    return participant


def kind_of(user: Any, study: Study) -> str:
    """Return the kind of a participant who comes by a page: researchers are pilots."""
    return ParticipantKind.PILOT if is_member(user, study.slug) else ParticipantKind.PARTICIPANT


def kept_parameters(given: Mapping[str, str]) -> dict[str, str]:
    """Return the recruitment parameters that are stored: the first ones, cut, if printable."""
    clean = {
        name[:MAX_PARAMETER_LENGTH]: value[:MAX_PARAMETER_LENGTH]
        for name, value in given.items()
        if name and (name + value).isprintable()
    }
    return dict(islice(clean.items(), MAX_PARAMETERS))


def language_of(study: StudyDefinition, wanted: str) -> str:
    """Return the language of a study for a reader of `wanted` ("es", "es-mx")."""
    names = (wanted, wanted.split("-", maxsplit=1)[0], *study.languages)
    return next(name for name in names if name in study.languages)


def title_of(study: Study, wanted: str) -> str:
    definition = study.as_definition()
    return spoken(definition.title, language_of(definition, wanted))


def is_full(
    study: Study, access: Access, now: datetime.datetime, kind: str = ParticipantKind.PARTICIPANT
) -> bool:
    return not places.free_cells(study, kind, assignment.cells(study.as_definition(), access), now)


def place(participant: Participant) -> JourneyPlace:
    return JourneyPlace(participant.visit, participant.round, participant.step)


def step_of(participant: Participant) -> Step:
    return journey.step_at(participant.study.as_definition(), place(participant))


def route_of(participant: Participant, visit: int | None = None) -> journey.Route:
    definition = participant.study.as_definition()
    number = len(participant.conditions) or journey.rounds(definition, access_of(participant))
    return journey.route(definition, number, visit or participant.visit)


def step_count(participant: Participant) -> tuple[int, int]:
    """Return (number, total) of a participant's step, without steps that this visit skips."""
    skipped: set[str] = set()
    if participant.visit > 1:
        steps = participant.study.as_definition().steps
        seen = StepVisit.objects.filter(participant=participant, visit=participant.visit)
        for_good = {step.key for step in steps if step.is_for_good}
        skipped = for_good - set(seen.values_list("step", flat=True))
    return journey.share_done(route_of(participant), place(participant), skipped)


def access_of(participant: Participant) -> Access:
    return "invitation" if participant.access == "invitation" else "open"


def wanted_condition(participant: Participant, study: StudyDefinition) -> Condition | None:
    """Return the condition of a participant's round; None without a place."""
    if not has_place(participant) or participant.round >= len(participant.conditions):
        return None
    return study.condition(participant.conditions[participant.round])


def has_place(participant: Participant) -> bool:
    """Tell whether a participant has a place. The unexposed gave it up and are drawn again."""
    return participant.stage not in {Participant.Stage.UNASSIGNED, Participant.Stage.FREED}


def keeps_place(participant: Participant) -> bool:
    """Tell whether waiting cannot cost a participant their place."""
    return has_place(participant) or participant.study.as_definition().allocation.quota is None


def open_conditions(participant: Participant) -> tuple[Condition, ...]:
    definition = participant.study.as_definition()
    if (assigned := wanted_condition(participant, definition)) is not None:
        return (assigned,)
    return tuple(one for one in definition.conditions if one.access == access_of(participant))


def see(participant: Participant, now: datetime.datetime) -> None:
    """Store that a participant looks at their step; the first time it begins."""
    Participant.objects.filter(pk=participant.pk).update(seen_at=now)
    where = asdict(place(participant))
    StepVisit.objects.get_or_create(participant=participant, **where, defaults={"began_at": now})


def screen_out(participant: Participant, now: datetime.datetime) -> None:
    """Turn a participant away. Those who finished an earlier visit, or drove, finish instead."""
    if participant.completion or completion.has_driven(participant):
        completion.conclude(participant, now)
    else:
        completion.close(participant, Status.SCREENED_OUT, SCREENED_OUT, now)


def of_user(user: Any) -> "QuerySet[Participant]":
    """Return a user's participations, the newest first."""
    return Participant.objects.filter(user=user).select_related("study").order_by("-created_at")
