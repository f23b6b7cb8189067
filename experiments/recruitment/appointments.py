"""When participants drive: slots in a study's opening hours, one participant at a time on each
robot.

An appointment keeps other participants of studies off a slot. Visitors who drive for themselves are
kept off only by a study with exclusive use of its robots.
"""

import datetime
from collections.abc import Sequence
from dataclasses import dataclass

from django.db import IntegrityError, transaction

from experiments.definition import opening_hours
from experiments.definition.recruitment.recruiting import Appointments
from experiments.models import Appointment, Contact, Participant, ParticipantKind, Study
from robots.models import Robot

ALWAYS = ({"days": list(range(7)), "start": "00:00", "end": "00:00"},)
EARLY = datetime.timedelta(minutes=10)  # before an appointment, the robot may be taken


@dataclass(frozen=True)
class Slot:
    """A time at which a participant can drive; UTC."""

    starts_at: datetime.datetime
    ends_at: datetime.datetime


def times(study: Study, asked: Appointments, now: datetime.datetime) -> list[Slot]:
    """Return all slots of a study that begin after a moment, free or taken, in order."""
    length = datetime.timedelta(minutes=asked.minutes)
    last = now + datetime.timedelta(days=asked.days_ahead)
    spans = opening_hours.spans(
        study.opening_hours or ALWAYS, study.time_zone, now, asked.days_ahead
    )
    found = set()
    for start, end in spans:
        for n in range((end - start) // length):
            at = start + n * length
            if now < at <= last:
                found.add(Slot(at, at + length))
    return sorted(found, key=lambda one: one.starts_at)


def free(
    study: Study, asked: Appointments, robots: Sequence[Robot], now: datetime.datetime
) -> list[Slot]:
    """Return the slots at which at least one robot is free."""
    taken = list(
        Appointment.objects.filter(robot__in=robots, ends_at__gt=now).values_list(
            "robot_id", "starts_at", "ends_at"
        )
    )
    return [
        slot
        for slot in times(study, asked, now)
        if len({pk for pk, start, end in taken if start < slot.ends_at and end > slot.starts_at})
        < len(robots)
    ]


def current(participant: Participant) -> Appointment | None:
    """Return the appointment of a participant's visit, past or to come."""
    rows = Appointment.objects.filter(participant=participant, visit=participant.visit)
    return rows.select_related("robot").order_by("-starts_at").first()


def may_drive(participant: Participant, now: datetime.datetime) -> bool:
    """Tell whether a participant may drive now as far as appointments say; bots need none."""
    asked = participant.study.as_definition().appointments
    if asked is None or not asked.required or participant.kind == ParticipantKind.BOT:
        return True
    own = current(participant)
    return own is not None and own.starts_at - EARLY <= now < own.ends_at


def book(
    participant: Participant,
    robots: Sequence[Robot],
    starts_at: datetime.datetime,
    now: datetime.datetime,
) -> Appointment | None:
    """Give a participant a slot on a free robot, instead of an earlier appointment of this visit;
    None when it has been taken or is not a slot of the study.
    """
    asked = participant.study.as_definition().appointments
    known = free(participant.study, asked, robots, now) if asked is not None else []
    slot = next((one for one in known if one.starts_at == starts_at), None)
    made = _on_some_robot(participant, robots, slot) if slot is not None else None
    if made is not None:
        others = Appointment.objects.filter(participant=participant, visit=participant.visit)
        others.exclude(pk=made.pk).delete()
    return made


def _on_some_robot(
    participant: Participant, robots: Sequence[Robot], slot: Slot
) -> Appointment | None:
    for robot in robots:
        overlapping = Appointment.objects.filter(
            robot=robot, starts_at__lt=slot.ends_at, ends_at__gt=slot.starts_at
        )
        if overlapping.exists():
            continue
        try:
            with transaction.atomic():
                return Appointment.objects.create(
                    participant=participant,
                    robot=robot,
                    visit=participant.visit,
                    starts_at=slot.starts_at,
                    ends_at=slot.ends_at,
                    slot=f"{robot.pk}:{slot.starts_at:%Y%m%dT%H%M}",
                )
        except IntegrityError:  # another participant has just taken it
            continue
    return None


def plan_second_session(participant: Participant, now: datetime.datetime) -> None:
    """Note when a participant who has finished the first visit is invited to the second, if they
    gave an address.
    """
    asked = participant.study.as_definition().appointments
    if asked is None or asked.second_after_days is None or participant.visit != 1:
        return
    at = now + datetime.timedelta(days=asked.second_after_days)
    Contact.objects.filter(participant=participant, invite_at=None).update(invite_at=at)
