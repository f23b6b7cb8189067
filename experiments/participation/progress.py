"""Enrolment and a participant's current step; advance.py moves them on.

A place is changed only where it is still the one that was seen, and a user has one row a study
(`Participant.slot`), so that nothing here happens twice under a reload, the back button, a second
tab or another device. Nothing rests on transactions.
"""

import datetime
from collections.abc import Mapping
from typing import Any

from django.db import IntegrityError, transaction
from django.db.models import Q, QuerySet

from experiments.definition import opening_hours
from experiments.definition.schema import Condition, StudyDefinition
from experiments.definition.step import Step
from experiments.models import (
    SCREENED_OUT,
    Participant,
    ParticipantKind,
    StepVisit,
    Study,
    StudyMember,
)
from experiments.participation import assignment, completion, journey, places
from experiments.participation.assignment import Access
from experiments.participation.journey import JourneyPlace
from experiments.recruitment import recognition
from surveys.documents import spoken

Status = Participant.Status
MOST_PARAMETERS, LONGEST_PARAMETER = 10, 100


# --- which study ----------------------------------------------------------------------------------


def visible_studies(now: datetime.datetime) -> list[Study]:
    """Return the studies to which everybody is invited, published and with an open link: those that
    are open now first, then the newest.
    """
    found = Study.objects.filter(
        status=Study.Status.PUBLISHED, entry__in=(Study.Entry.OPEN, Study.Entry.CODE)
    ).order_by("-published_at")
    return sorted(found, key=lambda study: not is_open(study, now))


def is_open(study: Study, now: datetime.datetime) -> bool:
    return opening_hours.is_open(study.opening_hours, study.time_zone, now)


def is_member(user: Any, slug: str) -> bool:
    """Tell whether somebody does research in a study: they see its drafts, and what they do in it
    never counts.
    """
    return bool(
        user.is_authenticated
        and user.is_active
        and (user.is_superuser or _researchers(slug).filter(user=user).exists())
    )


def _researchers(slug: str) -> "QuerySet[StudyMember]":
    return StudyMember.objects.filter(slug=slug).exclude(role=StudyMember.Role.WIZARD)


def study_for(user: Any, slug: str) -> Study | None:
    """Return the version of a study that somebody gets to see; None when there is none for them.

    Who takes part goes on with the version that they began; researchers see the newest, all others
    the one that is published, or was.
    """
    versions = Study.objects.filter(slug=slug).order_by("-version")
    own = _under_way_in(user, slug)
    if own is not None and own.kind != ParticipantKind.PILOT:
        return own.study
    if is_member(user, slug):
        return versions.first()
    return (
        versions.filter(status=Study.Status.PUBLISHED).first()
        or versions.filter(status=Study.Status.CLOSED).first()
    )


def _under_way_in(user: Any, slug: str) -> Participant | None:
    if not user.is_authenticated:
        return None
    # a bot comes again to the version that it was made for, be it a draft; and an id of a
    # recruitment site takes part in one version only
    under_way = Q(status=Status.ACTIVE) | Q(kind=ParticipantKind.BOT) | ~Q(recruitment_id="")
    own = Participant.objects.filter(under_way, user=user, study__slug=slug).select_related("study")
    return own.order_by("-created_at").first()


def found(study: Study, user: Any) -> Participant | None:
    if not user.is_authenticated:
        return None
    return (
        Participant.objects.filter(slot=_slot(study, user)).select_related("study", "user").first()
    )


def _slot(study: Study, user: Any) -> str:
    return f"{study.pk}:{user.pk}"


# --- coming in ------------------------------------------------------------------------------------


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
    """Return somebody's row in a study, made when they have none; a second call changes nothing but
    a better access before assignment. An id of a recruitment site that another user has in this
    study leads to the row of that user.
    """
    definition = study.as_definition()
    way = journey.route(definition, journey.rounds(definition, access), 1)
    start = journey.begin(way)
    fields = {
        "access": access,
        "recruitment": kept_parameters(recruitment),
        **recognition.fields(study, recruitment, kind),
        "kind": kind,
        "language": language_of(definition, language),
        "visit": start.visit,
        "round": start.round,
        "step": start.step,
        "created_at": now,
        "seen_at": now,
        "user": user,
    }
    try:
        with transaction.atomic():
            Participant.objects.create(study=study, slot=_slot(study, user), **fields)
    except IntegrityError:
        if access == "invitation":
            Participant.objects.filter(slot=_slot(study, user), cell="", access="open").update(
                access=access
            )
    rows = Participant.objects.select_related("study", "user")
    participant = rows.filter(slot=_slot(study, user)).first()
    if participant is None:  # the id of a recruitment site is somebody's already
        return rows.get(recruited_as=fields["recruited_as"])
    see(participant, now)
    return participant


def kind_of(user: Any, study: Study) -> str:
    """Return as what somebody takes part who comes by a page: researchers try their study out."""
    return ParticipantKind.PILOT if is_member(user, study.slug) else ParticipantKind.PARTICIPANT


def kept_parameters(given: Mapping[str, str]) -> dict[str, str]:
    """Return the recruitment parameters of a link that are kept: the first ones, cut, without what
    cannot be seen.
    """
    clean = {
        name[:LONGEST_PARAMETER]: value[:LONGEST_PARAMETER]
        for name, value in given.items()
        if (name + value).isprintable() and name
    }
    return dict(list(clean.items())[:MOST_PARAMETERS])


def language_of(study: StudyDefinition, wanted: str) -> str:
    """Return the language in which a study speaks to somebody who reads `wanted`
    ("es", "es-mx").
    """
    names = (wanted, wanted.split("-", maxsplit=1)[0], *study.languages)
    return next(name for name in names if name in study.languages)


def title_of(study: Study, wanted: str) -> str:
    definition = study.as_definition()
    return spoken(definition.title, language_of(definition, wanted))


def is_full(
    study: Study, access: Access, now: datetime.datetime, kind: str = ParticipantKind.PARTICIPANT
) -> bool:
    """Tell whether nobody new can get a place: every cell has its quota, or there is none for those
    who came that way.
    """
    return not places.free_cells(study, kind, assignment.cells(study.as_definition(), access), now)


# --- where they are -------------------------------------------------------------------------------


def place(participant: Participant) -> JourneyPlace:
    return JourneyPlace(participant.visit, participant.round, participant.step)


def step_of(participant: Participant) -> Step:
    return journey.step_at(participant.study.as_definition(), place(participant))


def way_of(participant: Participant) -> tuple[JourneyPlace, ...]:
    definition = participant.study.as_definition()
    number = len(participant.conditions) or journey.rounds(definition, access_of(participant))
    return journey.route(definition, number, participant.visit)


def step_count(participant: Participant) -> tuple[int, int]:
    """Return the number of a participant's step, from 1, and how many steps this visit has: each as
    often as it is gone through, and without what an earlier visit has done for good.
    """
    skipped: set[str] = set()
    if participant.visit > 1:
        steps = participant.study.as_definition().steps
        seen = StepVisit.objects.filter(participant=participant, visit=participant.visit)
        for_good = {step.key for step in steps if step.is_for_good}
        skipped = for_good - set(seen.values_list("step", flat=True))
    return journey.share_done(way_of(participant), place(participant), skipped)


def access_of(participant: Participant) -> Access:
    """Return how somebody came in, and so which cells are open to them."""
    return "invitation" if participant.access == "invitation" else "open"


def wanted_condition(participant: Participant, study: StudyDefinition) -> Condition | None:
    """Return the condition of a participant's round; None without a place."""
    if not has_place(participant) or participant.round >= len(participant.conditions):
        return None
    return study.condition(participant.conditions[participant.round])


def has_place(participant: Participant) -> bool:
    """Tell whether somebody holds a place in a cell; those who were not exposed gave it back, and
    are drawn again.
    """
    return participant.stage not in {Participant.Stage.UNASSIGNED, Participant.Stage.FREED}


def keeps_place(participant: Participant) -> bool:
    """Tell whether a participant's place is theirs however long they wait: they hold it, or there
    is no end of places.
    """
    return has_place(participant) or participant.study.as_definition().allocation.quota is None


def open_conditions(participant: Participant) -> tuple[Condition, ...]:
    """Return the conditions that a participant may get in this round: the one that was assigned,
    else all that are open to them.
    """
    definition = participant.study.as_definition()
    assigned = wanted_condition(participant, definition)
    if assigned is not None:
        return (assigned,)
    return tuple(one for one in definition.conditions if one.access == access_of(participant))


def see(participant: Participant, now: datetime.datetime) -> None:
    """Note that a participant is looking at their step: the first time it began."""
    Participant.objects.filter(pk=participant.pk).update(seen_at=now)
    where = {"visit": participant.visit, "round": participant.round, "step": participant.step}
    StepVisit.objects.get_or_create(participant=participant, **where, defaults={"began_at": now})


def screen_out(participant: Participant, now: datetime.datetime) -> None:
    """Turn away somebody whom the study's rules exclude."""
    completion.close(participant, Status.SCREENED_OUT, SCREENED_OUT, now)


def of_user(user: Any) -> "QuerySet[Participant]":
    """Return everything in which somebody takes part, the newest first."""
    return Participant.objects.filter(user=user).select_related("study").order_by("-created_at")
