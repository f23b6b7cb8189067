"""Mail to researchers when a robot of their study cannot admit visitors: once a pause, and once for
each participant who waits for its start condition.

Also in the system log, as the events `queue_paused` (sessions/manager/return_to_dock.py) and
`robot_not_ready` (sessions/manager/scheduler.py).
"""

import datetime
from typing import Any

import structlog
from django.conf import settings
from django.core.mail import EmailMessage, get_connection
from django.http import HttpRequest
from django.utils.translation import gettext as _

from experiments.models import Study, StudyMember
from experiments.participation.grants import is_for, pending_drive
from experiments.research.study_access import shown_time
from robots.models import Robot
from robots.readiness_text import in_words
from sessions.models import Session

log = structlog.stdlib.get_logger(__name__)

MAIL_SECONDS = 5.0  # that a mail server may keep the session manager waiting


def publish_pause(*, robot: Robot, reason: str, at: datetime.datetime, **_more: Any) -> None:
    if reason == "stopped":  # it waits at its place, and takes visitors
        return
    subject = _("%(study)s: the queue for %(robot)s is paused")
    text = _(
        "%(robot)s has admitted no visitors since %(at)s because it couldn't get ready for the "
        "next visit: %(reason)s.\n\nThe system "
        "tries again every two minutes. You get one e-mail for each pause."
    )
    for study in studies_with(robot):
        _send(study, subject, text, robot, reason, at)


def publish_not_ready(
    *, robot: Robot, session: Session, reason: str, at: datetime.datetime, **_more: Any
) -> None:
    drive = pending_drive(session.visitor, robot)
    if drive is None:
        return
    subject = _("%(study)s: %(robot)s is not ready for the next participant")
    text = _(
        "A participant has been waiting for %(robot)s since %(at)s. Nobody is "
        "driving the robot: %(reason)s.\n\nPut the robot in its charging station "
        "or drive it there. The participant's drive then starts automatically. "
        "You get one e-mail for each participant who waits."
    )
    _send(drive.participant.study, subject, text, robot, reason, at)


def studies_with(robot: Robot) -> list[Study]:
    published = Study.objects.filter(status=Study.Status.PUBLISHED)
    return [
        study
        for study in published
        if any(is_for(condition, robot) for condition in study.as_definition().conditions)
    ]


def addresses_of(study: Study) -> list[str]:
    """Return the addresses of a study's owners and researchers, who can help."""
    roles = (StudyMember.Role.OWNER, StudyMember.Role.RESEARCHER)
    members = StudyMember.objects.filter(slug=study.slug, user__is_active=True, role__in=roles)
    return sorted({address for address in members.values_list("user__email", flat=True) if address})


def mail_to_owner(_request: HttpRequest, robot: Robot) -> str:
    """Tell a robot's owner whether they get such mail: only as a member of a study."""
    owner = robot.owner
    if owner is None:
        return _("This robot has no owner.")
    if not owner.email:
        return _("No: the owner's account has no e-mail address.")
    titles = [study.title for study in studies_with(robot) if owner.email in addresses_of(study)]
    if not titles:
        return _(
            "No. Only researchers of a published study get an e-mail when its robot can't get "
            "ready. The system log lists all problems."
        )
    text = _("Yes, when the robot can't get ready, as a researcher of: %(studies)s.")
    return text % {"studies": ", ".join(titles)}


def _send(
    study: Study, subject: str, text: str, robot: Robot, reason: str, at: datetime.datetime
) -> None:
    addresses = addresses_of(study)
    if not addresses:
        return
    about = {"study": study.title, "robot": robot}
    values = about | {"reason": in_words(reason), "at": shown_time(at)}
    sender, connection = settings.DEFAULT_FROM_EMAIL, get_connection(timeout=MAIL_SECONDS)
    subject, text = subject % values, text % values
    mail = EmailMessage(subject, text, sender, bcc=addresses, connection=connection)
    try:
        mail.send()
    except OSError as error:  # SMTP's errors are these
        log.error("staff_not_notified", study=study.slug, robot=robot.name, reason=str(error))
