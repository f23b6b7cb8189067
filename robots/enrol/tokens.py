"""One-time tokens, with which a robot's computer gets the robot's credentials without copying a
file.

The owner creates a token. It is shown once, stored as a hash, and valid for one robot, some hours,
and one use.
"""

import datetime

from accounts.tokens import hash_of
from robots.enrol.credentials import Credentials, make_credentials, new_token
from robots.models import Enrolment, Robot

HOURS = 24.0


def make_token(robot: Robot, now: datetime.datetime, hours: float = HOURS) -> str:
    """Return a new token for a robot; an earlier unused one becomes invalid."""
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
    """Exchange a token for new credentials, once; None if it was used, has expired, or is another
    robot's. The old credentials become invalid at once, because their computer may be lost.
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
        return None  # the second of two simultaneous requests finds it used
    return make_credentials(found.robot, now)


def open_enrolment(robot: Robot, now: datetime.datetime) -> str:
    """Return the id of the enrolment with a valid token, or an empty text. New credentials delete
    it.
    """
    rows = Enrolment.objects.filter(robot=robot, used_at=None, expires_at__gt=now)
    found = rows.values_list("pk", flat=True).first()
    return "" if found is None else str(found)
