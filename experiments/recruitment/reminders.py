"""E-mails to participants who gave an address: a reminder of an appointment, and an invitation to
the second session. `manage.py send_reminders` sends those that are due and deletes addresses that
are no longer needed.

An e-mail is marked as sent before it is sent, so that two processes do not send it twice. After a
failure the mark is removed, and the next call tries again.
"""

import datetime
from collections.abc import Iterator
from zoneinfo import ZoneInfo

import structlog
from django.core.mail import EmailMessage
from django.db.models import Q
from django.urls import reverse
from django.utils import timezone, translation
from django.utils.formats import date_format
from django.utils.translation import gettext as _

from experiments.models import Appointment, Contact, Participant, Study
from surveys.documents import spoken

log = structlog.stdlib.get_logger(__name__)
Status = Participant.Status
# an address is deleted when its participant was not seen for so long in an unfinished session
KEPT_FOR = datetime.timedelta(days=1)


def send_due(now: datetime.datetime) -> int:
    """Send every e-mail that is due, delete unneeded addresses, and return how many were sent."""
    sent = sum([*_remind(now), *_invite(now)])
    clear(now)
    return sent


def _remind(now: datetime.datetime) -> Iterator[bool]:
    rows = Appointment.objects.filter(
        starts_at__gt=now, reminded_at=None, participant__contact__isnull=False
    ).select_related("participant__study", "participant__contact", "robot")
    for row in rows:
        asked = row.participant.study.as_definition().appointments
        if asked is None or row.starts_at - datetime.timedelta(hours=asked.reminder_hours) > now:
            continue
        if Appointment.objects.filter(pk=row.pk, reminded_at=None).update(reminded_at=now):
            is_sent = _send(row.participant.contact, row)
            if not is_sent:
                Appointment.objects.filter(pk=row.pk).update(reminded_at=None)
            yield is_sent


def _invite(now: datetime.datetime) -> Iterator[bool]:
    rows = Contact.objects.filter(invite_at__lte=now).select_related("participant__study")
    for row in rows:
        if row.participant.study.status == Study.Status.CLOSED:
            Contact.objects.filter(pk=row.pk).update(invite_at=None)
        elif Contact.objects.filter(pk=row.pk, invite_at=row.invite_at).update(invite_at=None):
            is_sent = _send(row, None)
            if not is_sent:
                Contact.objects.filter(pk=row.pk).update(invite_at=row.invite_at)
            yield is_sent


def clear(now: datetime.datetime) -> None:
    due = Appointment.objects.filter(ends_at__gt=now).values("participant_id")
    waits = Q(participant__status=Status.ACTIVE, participant__seen_at__gt=now - KEPT_FOR)
    Contact.objects.filter(invite_at=None).exclude(participant__in=due).exclude(waits).delete()


def _send(contact: Contact, appointment: Appointment | None) -> bool:
    participant = contact.participant
    stop = contact.site + reverse("study_reminders_stop", args=[contact.token]).lstrip("/")
    one_click = {
        "List-Unsubscribe": f"<{stop}>",
        "List-Unsubscribe-Post": "List-Unsubscribe=One-Click",
    }
    with translation.override(participant.language or "en"):
        subject, text = _subject_and_text(contact, appointment, stop)
        message = EmailMessage(subject, text, to=[contact.email], headers=one_click)
        try:
            return bool(message.send())
        except OSError as error:  # SMTP's errors are these
            reason = type(error).__name__
            log.warning("reminder_failed", participant=participant.code, reason=reason)
            return False


def _subject_and_text(
    contact: Contact, appointment: Appointment | None, stop: str
) -> tuple[str, str]:
    participant = contact.participant
    definition = participant.study.as_definition()
    title = " ".join(spoken(definition.title, participant.language).split())
    address = contact.site + reverse("study", args=[participant.study.slug]).lstrip("/")
    if appointment is not None:
        at = appointment.starts_at.astimezone(ZoneInfo(participant.study.time_zone))
        when = f"{date_format(at, 'l, j F, H:i')} ({participant.study.time_zone})"
        subject = _("Your appointment: %(title)s") % {"title": title}
        first = _("You have an appointment to drive the robot on %(when)s.") % {"when": when}
    else:
        subject = _("Your second session: %(title)s") % {"title": title}
        first = _("You can now take part in the second session of the study.")
    visit = _("Open the study: %(address)s") % {"address": address}
    end = _("Stop these e-mails and delete your address: %(address)s") % {"address": stop}
    return subject, f"{first}\n\n{visit}\n\n{end}\n"


def stop(token: str) -> None:
    Contact.objects.filter(token=token).delete()


def keep_address(participant: Participant, email: str, site: str) -> None:
    """Store the address of a participant who asked for reminders; `site` is the site's address."""
    fields = {"email": email, "site": site, "given_at": timezone.now()}
    Contact.objects.update_or_create(participant=participant, defaults=fields)
