"""Mail to researchers when a robot of their study cannot go on: once a pause, with what the robot says.

Also stands in the system log, as the event `queue_paused` (sessions/homecoming.py).
"""

import datetime
import logging
import smtplib
from typing import Any

from django.conf import settings
from django.core.mail import EmailMessage, get_connection
from django.utils import timezone
from django.utils.translation import gettext as _

from experiments.grants import is_for
from experiments.models import Study, StudyMember
from robots.between import in_words
from robots.models import Robot

log = logging.getLogger(__name__)

MAIL_SECONDS = 5.0  # that a mail server may keep the session manager waiting


def tell_pause(*, robot: Robot, reason: str, at: datetime.datetime, **_more: Any) -> None:
    """Tell the researchers of every open study that uses a robot that its queue is paused."""
    for study in studies_with(robot):
        addresses = addresses_of(study)
        if addresses:
            _send(study, robot, reason, at, addresses)


def studies_with(robot: Robot) -> list[Study]:
    """Return the published studies that drive a robot."""
    published = Study.objects.filter(status=Study.Status.PUBLISHED)
    return [study for study in published if any(is_for(condition, robot) for condition in study.as_definition().conditions)]


def addresses_of(study: Study) -> list[str]:
    """Return the addresses of a study's owners and researchers; who only looks at it cannot help."""
    members = StudyMember.objects.filter(slug=study.slug, user__is_active=True).exclude(role=StudyMember.Role.VIEWER)
    return sorted({address for address in members.values_list("user__email", flat=True) if address})


def _send(study: Study, robot: Robot, reason: str, at: datetime.datetime, addresses: list[str]) -> None:
    names = {"study": study.title, "robot": str(robot), "reason": in_words(reason), "at": timezone.localtime(at).strftime("%Y-%m-%d %H:%M %Z")}
    text = _(
        "Since %(at)s nobody is admitted to %(robot)s, because it could not be made ready for the next visit: %(reason)s.\n\n"
        "It goes on trying every two minutes. You get this mail once for each pause."
    )
    subject = _("%(study)s: the queue of %(robot)s is paused")
    try:
        connection = get_connection(timeout=MAIL_SECONDS)
        EmailMessage(subject % names, text % names, settings.DEFAULT_FROM_EMAIL, to=[], bcc=addresses, connection=connection).send()
    except (OSError, smtplib.SMTPException) as error:
        log.error("pause_not_told study=%s robot=%s reason=%s", study.slug, robot.name, error)  # noqa: TRY400 -- the reason says it
