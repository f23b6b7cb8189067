"""When participants drive: slots in a study's opening hours, one participant at a time on each
robot.

An appointment reserves a slot against participants of all studies. Visitors without a study can
still take the robot, unless the study has exclusive use of its robots.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from typing import Any

from django.db import IntegrityError, transaction

from experiments.definition import opening_hours
from experiments.definition.recruitment.recruiting import Appointments
from experiments.models import Appointment, Contact, Participant, ParticipantKind, Study
from robots.models import Robot

ALWAYS = ({"days": list(range(7)), "start": "00:00", "end": "00:00"},)
EARLY = timedelta(minutes=10)  # before an appointment, the robot may be taken


@dataclass(frozen=True)
class Slot:
    starts_at: datetime
    ends_at: datetime


def times(study: Study, asked: Appointments, now: datetime) -> list[Slot]:
    """Return all slots (UTC) of a study that begin after `now`, free or taken, in order."""
    length = timedelta(minutes=asked.minutes)
    last = now + timedelta(days=asked.days_ahead)
    hours = study.opening_hours or ALWAYS
    starts = {
        start + n * length
        for start, end in opening_hours.spans(hours, study.time_zone, now, asked.days_ahead)
        for n in range((end - start) // length)
    }
    return [Slot(at, at + length) for at in sorted(starts) if now < at <= last]


def free(study: Study, asked: Appointments, robots: Sequence[Robot], now: datetime) -> list[Slot]:
    """Return the slots at which at least one robot is free."""
    rows = Appointment.objects.filter(robot__in=robots, ends_at__gt=now)
    taken = list(rows.values_list("robot_id", "starts_at", "ends_at"))

    def busy(slot: Slot) -> set[Any]:
        return {pk for pk, start, end in taken if start < slot.ends_at and end > slot.starts_at}

    return [slot for slot in times(study, asked, now) if len(busy(slot)) < len(robots)]


def current(participant: Participant) -> Appointment | None:
    """Return the appointment of a participant's visit, past or future."""
    rows = Appointment.objects.filter(participant=participant, visit=participant.visit)
    return rows.select_related("robot").order_by("-starts_at").first()


def may_drive(participant: Participant, now: datetime) -> bool:
    """Tell whether a participant may drive now as far as appointments say; bots need none."""
    asked = participant.study.as_definition().appointments
    if asked is None or not asked.required or participant.kind == ParticipantKind.BOT:
        return True
    own = current(participant)
    return own is not None and own.starts_at - EARLY <= now < own.ends_at


def book(
    participant: Participant,
    robots: Sequence[Robot],
    starts_at: datetime,
    now: datetime,
) -> Appointment | None:
    """Give a participant a slot on a free robot, instead of an earlier appointment of this visit;
    None when it has been taken or is not a slot of the study.
    """
    asked = participant.study.as_definition().appointments
    known = free(participant.study, asked, robots, now) if asked is not None else []
    slot = next((one for one in known if one.starts_at == starts_at), None)
    if slot is None:
        return None
    overlapping = Appointment.objects.filter(starts_at__lt=slot.ends_at, ends_at__gt=slot.starts_at)
    owner = {"participant": participant, "visit": participant.visit}
    for robot in robots:
        if overlapping.filter(robot=robot).exists():
            continue
        key = f"{robot.pk}:{slot.starts_at:%Y%m%dT%H%M}"
        try:
            with transaction.atomic():
                made = Appointment.objects.create(robot=robot, slot=key, **owner, **asdict(slot))
        except IntegrityError:  # another participant has just taken it
            continue
        Appointment.objects.filter(**owner).exclude(pk=made.pk).delete()
        return made
    return None


def plan_second_session(participant: Participant, now: datetime) -> None:
    """Set when to send the invitation to the second session, if there is an address."""
    asked = participant.study.as_definition().appointments
    if asked is None or asked.second_after_days is None or participant.visit != 1:
        return
    at = now + timedelta(days=asked.second_after_days)
    Contact.objects.filter(participant=participant, invite_at=None).update(invite_at=at)
