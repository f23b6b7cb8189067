"""The front page of a study: description, requirements, and the visitor's next action."""

import datetime
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, Literal

from django.utils.dates import WEEKDAYS_ABBR
from django.utils.translation import gettext as _

from experiments.definition import opening_hours
from experiments.definition.design import Controller
from experiments.definition.schema import Condition, StudyDefinition
from experiments.models import DONE, TIMED_OUT, Participant, Study
from experiments.participation import completion, journey, progress
from experiments.participation.drive_status import longest_wait, robots_of
from surveys.documents import spoken

# In the order in which they are checked: the first that holds decides.
OfPerson = Literal["withdrawn", "recognized", "other_account"]
OfParticipant = Literal["finished", "under_way", "screened_out"]
OfStudy = Literal["closed", "shut", "personal", "full"]
Admission = Literal[OfPerson, OfParticipant, OfStudy, "device", "anonymous", "stranger", "welcome"]
_WEEK = 7


def landing(
    study: Study,
    user: Any,
    own: Participant | None,
    *,
    known: Participant | None = None,
    has_withdrawn: bool = False,
    has_device: bool = True,
    is_recruited: bool = False,
    language: str,
    now: datetime.datetime,
) -> dict[str, Any]:
    """Return the context `page` of the front page of a study for one visitor: `minutes` is the
    maximal time of driving, `wait` the maximal wait for a robot, in minutes, while others have the
    robots; `opens_at` is in the study's time zone. `own` is the visitor's participation, `known`
    that of another user with the id of a recruitment site that their link names; `is_recruited`
    tells whether it names one, `has_withdrawn` whether they took part before and withdrew.
    """
    definition = study.as_definition()
    if has_withdrawn:
        admission: Admission = "withdrawn"
    elif known is not None:
        is_guest = known.user is not None and known.user.is_guest
        admission = "recognized" if is_guest else "other_account"
    else:
        admission = _admission(study, user, own, now, has_device=has_device)
    return {
        **_in_language(study, language, now),
        "study": study,
        "definition": definition,
        "minutes": driving_minutes(definition),
        "wait": longest_wait(robots_of(_conditions_for(own, definition)), now),
        "controllers": controllers(definition),
        "hours": in_words(study.opening_hours),
        "admission": admission,
        "may_take_part_again": own is not None and may_take_part_again(own, now),
        "is_recruited": is_recruited,
    }


def invitations(language: str, now: datetime.datetime) -> list[dict[str, Any]]:
    return [
        {"slug": one.slug, "time_zone": one.time_zone, **_in_language(one, language, now)}
        for one in progress.visible_studies(now)
    ]


def _in_language(study: Study, language: str, now: datetime.datetime) -> dict[str, Any]:
    definition = study.as_definition()
    spoken_in = progress.language_of(definition, language)
    return {
        "language": spoken_in,
        "title": spoken(definition.title, spoken_in),
        "intro": spoken(definition.intro, spoken_in),
        "opens_at": opening_hours.opens_on_the_wall(study.opening_hours, study.time_zone, now),
    }


def _conditions_for(own: Participant | None, definition: StudyDefinition) -> tuple[Condition, ...]:
    if own is not None:
        return progress.open_conditions(own)
    is_open = tuple(one for one in definition.conditions if one.access == "open")
    return is_open or definition.conditions


def _admission(
    study: Study, user: Any, own: Participant | None, now: datetime.datetime, *, has_device: bool
) -> Admission:
    if own is not None and own.status != Participant.Status.FINISHED:
        return "under_way" if own.status == Participant.Status.ACTIVE else "screened_out"
    if study.status == Study.Status.CLOSED:
        return "closed"
    if not progress.is_open(study, now):
        return "shut"
    if own is not None:
        return "finished"
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


def may_take_part_again(participant: Participant, now: datetime.datetime) -> bool:
    """Tell whether a participant who has finished may take part again. A recruitment site pays
    once, so its participants may only after a failure, if they left before they drove, or for a
    second session.
    """
    study, asked = participant.study, participant.study.as_definition().appointments
    if not progress.is_open(study, now):
        return False
    has_second = asked is not None and asked.second_after_days is not None
    ending, is_over = participant.completion, False
    if participant.recruitment_id:
        is_over = ending in {DONE, TIMED_OUT} or completion.has_left_drive(participant)
    return not is_over or (has_second and participant.visit == 1)


def driving_minutes(definition: StudyDefinition) -> int:
    """Return the maximal time of driving with open access, in minutes."""
    often = journey.rounds(definition, "open")
    return round(sum(step.minutes * (often if step.repeat else 1) for step in definition.drives))


def controllers(definition: StudyDefinition) -> tuple[Controller, ...]:
    """Return the controllers that all conditions allow, in the order of the first."""
    allowed = [condition.controllers for condition in definition.conditions] or [()]
    return tuple(name for name in allowed[0] if all(name in names for names in allowed))


def in_words(hours: Sequence[Mapping[str, Any]]) -> list[str]:
    lines = []
    for span in hours:
        days = _("every day") if len(set(span["days"])) == _WEEK else days_in_words(span["days"])
        lines.append(f"{days}, {span['start']}–{span['end']}")
    return lines


def days_in_words(days: Sequence[int], dash: str = "–") -> str:
    """Return days of the week, 0 is Monday, as text: `Mon–Wed, Fri`."""
    # consecutive days keep their distance to their index
    runs = groupby(enumerate(sorted(set(days))), key=lambda pair: pair[1] - pair[0])
    names = [[str(WEEKDAYS_ABBR[day]) for _, day in run] for _, run in runs]
    return ", ".join(run[0] if len(run) == 1 else f"{run[0]}{dash}{run[-1]}" for run in names)
