"""One-time tokens: how the computer on a robot gets the robot's credentials without anybody copying
a file.

Made by the owner, shown once, kept as a hash, good for one robot, for some hours, and once.
"""

import datetime

from accounts.tokens import hash_of
from robots.enrol.credentials import Credentials, make_credentials, new_token
from robots.models import Enrolment, Robot

HOURS = 24.0


def make_token(robot: Robot, now: datetime.datetime, hours: float = HOURS) -> str:
    """Return a new token for a robot, for the only time; the one before leads nowhere any more."""
    token = new_token()
    Enrolment.objects.filter(robot=robot, used_at=None).delete()
    Enrolment.objects.create(
        robot=robot,
        token_sha256=hash_of(token),
        made_at=now,
        expires_at=now + datetime.timedelta(hours=hours),
    )
    return token


def redeem(name: str, token: str, now: datetime.datetime) -> Credentials | None:
    """Exchange a token for new credentials, once; None for one that was used, has expired, or is
    another robot's.

    The credentials before stop working at once: whoever enrols a robot anew has perhaps lost the
    old computer.
    """
    rows = Enrolment.objects.filter(
        token_sha256=hash_of(token),
        robot__name=name,
        robot__enabled=True,
        used_at=None,
        expires_at__gt=now,
    )
    found = rows.select_related("robot").first()
    if found is None or not Enrolment.objects.filter(pk=found.pk, used_at=None).update(used_at=now):
        return None  # of two who come at once the second finds it used
    return make_credentials(found.robot, now)


def open_enrolment(robot: Robot, now: datetime.datetime) -> str:
    """Return the id of the enrolment whose token still works, empty when none does: credentials
    that are made delete it.
    """
    rows = Enrolment.objects.filter(robot=robot, used_at=None, expires_at__gt=now)
    found = rows.values_list("pk", flat=True).first()
    return "" if found is None else str(found)
