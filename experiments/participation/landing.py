"""What the front page of a study says: what it is, what is needed, and what somebody can do about
it now.
"""

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from django.utils.dates import WEEKDAYS_ABBR
from django.utils.translation import gettext as _

from experiments.definition import opening_hours
from experiments.definition.design import Controller
from experiments.definition.schema import Condition, StudyDefinition
from experiments.models import DONE, TIMED_OUT, Participant, Study
from experiments.participation import journey, progress
from experiments.participation.drive_status import longest_wait, robots_of
from surveys.documents import spoken

# In the order in which they are asked: the first that holds decides.
Stand = Literal[
    "recognized",
    "other_account",
    "finished",
    "under_way",
    "screened_out",
    "closed",
    "shut",
    "personal",
    "full",
    "device",
    "anonymous",
    "stranger",
    "welcome",
]
_WEEK = 7


@dataclass(frozen=True)
class Landing:
    """The front page of a study for one visitor. `minutes` is how long driving takes at most,
    `wait` how long one waits at most before, in minutes, while others have the robots; `opens_at`
    is in the study's own time of day.
    """

    title: str
    intro: str
    language: str
    languages: tuple[str, ...]
    minutes: int
    wait: int
    minimum_age: int
    minors_with_guardian: bool
    controllers: tuple[str, ...]
    is_draft: bool
    stand: Stand
    opens_at: datetime.datetime | None
    hours: tuple[str, ...]
    time_zone: str
    devices: tuple[str, ...] = ()
    browsers: tuple[str, ...] = ()
    may_come_again: bool = False
    is_recruited: bool = False


def landing(
    study: Study,
    user: Any,
    own: Participant | None,
    *,
    known: Participant | None = None,
    has_device: bool = True,
    is_recruited: bool = False,
    language: str,
    now: datetime.datetime,
) -> Landing:
    """Return the front page of a study for one visitor.

    Args:
        study: the version that they see.
        user: whom the browser has signed in.
        own: their participation.
        known: that of another user with the id that their link names.
        has_device: whether the study allows their device and browser.
        is_recruited: whether their link names an id of a recruitment site.
        language: which they read.
        now: the time.
    """
    definition = study.as_definition()
    spoken_in = progress.language_of(definition, language)
    consent = definition.consent
    return Landing(
        title=spoken(definition.title, spoken_in),
        intro=spoken(definition.intro, spoken_in),
        language=spoken_in,
        languages=definition.languages,
        minutes=driving_minutes(definition),
        wait=longest_wait(robots_of(_conditions_for(own, definition)), now),
        minimum_age=consent.minimum_age if consent else 0,
        minors_with_guardian=consent is not None and consent.minors == "guardian",
        controllers=controllers(definition),
        is_draft=study.status == Study.Status.DRAFT,
        stand=stand(study, user, own, now, known=known, has_device=has_device),
        devices=definition.devices,
        browsers=definition.browsers,
        may_come_again=own is not None and may_come_again(own, now),
        is_recruited=is_recruited,
        opens_at=opening_hours.opens_on_the_wall(study.opening_hours, study.time_zone, now),
        hours=tuple(in_words(study.opening_hours)),
        time_zone=study.time_zone,
    )


def _conditions_for(own: Participant | None, definition: StudyDefinition) -> tuple[Condition, ...]:
    """Return the conditions that somebody may get: a newcomer those that are open to everybody, if
    there are any.
    """
    if own is not None:
        return progress.open_conditions(own)
    is_open = tuple(one for one in definition.conditions if one.access == "open")
    return is_open or definition.conditions


@dataclass(frozen=True)
class StudyInvitation:
    """A study on the home page; `opens_at` is when one that is closed opens, by the clock in its
    own `time_zone`.
    """

    slug: str
    title: str
    intro: str
    language: str
    opens_at: datetime.datetime | None
    time_zone: str


def invitations(language: str, now: datetime.datetime) -> list[StudyInvitation]:
    """Return the studies that everybody may take part in, now or when they open, in a language as
    near as they have it.
    """
    return [_invitation(study, language, now) for study in progress.visible_studies(now)]


def _invitation(study: Study, language: str, now: datetime.datetime) -> StudyInvitation:
    definition = study.as_definition()
    spoken_in = progress.language_of(definition, language)
    opens_at = opening_hours.opens_on_the_wall(study.opening_hours, study.time_zone, now)
    return StudyInvitation(
        study.slug,
        spoken(definition.title, spoken_in),
        spoken(definition.intro, spoken_in),
        spoken_in,
        opens_at,
        study.time_zone,
    )


def stand(
    study: Study,
    user: Any,
    own: Participant | None,
    now: datetime.datetime,
    *,
    known: Participant | None = None,
    has_device: bool = True,
) -> Stand:
    """Return what somebody can do about a study now; arguments as in `landing`."""
    if known is not None:
        return "recognized" if known.user is not None and known.user.is_guest else "other_account"
    if own is not None and own.status != Participant.Status.FINISHED:
        return "under_way" if own.status == Participant.Status.ACTIVE else "screened_out"
    shut = _shut(study, now)
    if shut is not None or own is not None:
        return shut or "finished"
    return _to_first_time_visitors(study, user, now, has_device=has_device)


def may_come_again(participant: Participant, now: datetime.datetime) -> bool:
    """Tell whether somebody who has finished may take part again. A recruitment site pays once, so
    its participants do so only after a failure, or for a second session.
    """
    study, asked = participant.study, participant.study.as_definition().appointments
    if _shut(study, now) is not None:
        return False
    has_second = asked is not None and asked.second_after_days is not None
    is_paid = bool(participant.recruitment_id) and participant.completion in {DONE, TIMED_OUT}
    return not is_paid or (has_second and participant.visit == 1)


def _shut(study: Study, now: datetime.datetime) -> Literal["closed", "shut"] | None:
    if study.status == Study.Status.CLOSED:
        return "closed"
    return None if progress.is_open(study, now) else "shut"


def _to_first_time_visitors(
    study: Study, user: Any, now: datetime.datetime, *, has_device: bool
) -> Stand:
    kind = progress.kind_of(user, study)
    if study.entry == Study.Entry.PERSONAL and kind != "pilot":
        return "personal"
    if progress.is_full(study, "open", now, kind):
        return "full"
    if not has_device:
        return "device"
    if user.is_authenticated and not user.is_guest:
        return "welcome"
    return "anonymous" if study.entry == Study.Entry.CODE else "stranger"


def driving_minutes(definition: StudyDefinition) -> int:
    """Return how many minutes somebody drives at most."""
    often = journey.rounds(definition, "open")
    return round(sum(step.minutes * (often if step.repeat else 1) for step in definition.drives))


def controllers(definition: StudyDefinition) -> tuple[Controller, ...]:
    """Return with what somebody can drive in every condition, in the order of the first."""
    allowed = [condition.controllers for condition in definition.conditions]
    return tuple(
        name for name in (allowed[0] if allowed else ()) if all(name in names for names in allowed)
    )


def in_words(hours: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return opening hours as lines to read."""
    return [f"{_days(span['days'])}, {span['start']}–{span['end']}" for span in hours]


def _days(days: Sequence[int]) -> str:
    ordered = sorted(set(days))
    if len(ordered) == _WEEK:
        return _("every day")
    runs: list[list[int]] = []
    for day in ordered:
        if runs and runs[-1][-1] == day - 1:
            runs[-1].append(day)
        else:
            runs.append([day])
    return ", ".join(
        str(WEEKDAYS_ABBR[run[0]])
        if len(run) == 1
        else f"{WEEKDAYS_ABBR[run[0]]}–{WEEKDAYS_ABBR[run[-1]]}"
        for run in runs
    )
